"""What the README, and the pages it leads to, tell people to type."""

import importlib
import re
import shlex
from pathlib import Path

import pytest

from tbmslam.io.map_folder import load_map

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = (ROOT / "README.md", *sorted(set((ROOT / "docs").glob("*.md")) - {ROOT / "docs" / "index.md"}))
LONGEST = 150
COMMANDS = [
    command
    for page in PAGES
    for command in re.findall(
        r"^python (tools/\w+\.py .+)$", page.read_text("utf-8").replace("\\\n", " "), re.MULTILINE
    )
]

pytestmark = pytest.mark.xdist_group("flat")


def test_the_example_of_the_library_runs(flat, tmp_path, monkeypatch):
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text("utf-8"), re.DOTALL)
    for name in ("robot_0.bag", "robot_1.bag"):
        (tmp_path / name).symlink_to(flat / name)
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "docs/python.md", "exec"), {})  # noqa: S102 - our own text
    assert [drive.name for drive in load_map(tmp_path / "merged").drives] == ["robot_0", "robot_1"]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_are_understood(command):
    path, *words = shlex.split(command, comments=True)
    program = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    grammar = program.parser() if hasattr(program, "parser") else program._parser()
    grammar.parse_args(words)


def test_there_are_commands_and_every_link_leads_somewhere():
    assert len(COMMANDS) >= 8
    targets = (ROOT / "Makefile").read_text()
    for page in PAGES:
        for link in re.findall(r"\]\(([^)]+)\)", page.read_text("utf-8")):
            assert link.startswith("https://") or (page.parent / link).is_file(), link
        for target in re.findall(r"(?:^|`)make ([a-z][\w./-]*)", page.read_text("utf-8"), re.MULTILINE):
            assert f"\n{target}:" in targets


def test_the_readme_is_short():
    assert len(README.splitlines()) <= LONGEST


def test_every_page_is_led_to_from_the_readme():
    assert all(f"](docs/{page.name})" in README for page in PAGES[1:])
