"""What the README tells people to type."""

import importlib
import re
import shlex
from pathlib import Path

import pytest

from tbmslam.map_folder import load_map

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^python (tools/\w+\.py .+)$", README.replace("\\\n", " "), re.MULTILINE)

pytestmark = pytest.mark.xdist_group("flat")


def test_the_example_of_the_library_runs(flat, tmp_path, monkeypatch):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    for name in ("robot_0.bag", "robot_1.bag"):
        (tmp_path / name).symlink_to(flat / name)
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})  # noqa: S102 - our own text
    assert [drive.name for drive in load_map(tmp_path / "merged").drives] == ["robot_0", "robot_1"]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_are_understood(command):
    path, *words = shlex.split(command, comments=True)
    program = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    grammar = program.parser() if hasattr(program, "parser") else program._parser()
    grammar.parse_args(words)


def test_there_are_commands_and_every_link_leads_somewhere():
    assert len(COMMANDS) >= 8
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert links
    for link in links:
        assert link.startswith("https://") or (ROOT / link).is_file()
    targets = (ROOT / "Makefile").read_text()
    for target in re.findall(r"(?:^|`)make ([a-z][\w./-]*)", README, re.MULTILINE):
        assert f"\n{target}:" in targets
