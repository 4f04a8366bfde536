"""What the README, and the pages it leads to, tell people to type."""

import importlib
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from datasets import downloading
from tbmslam.commands import PROGRAMS
from tbmslam.io.map_folder import load_map, save_map
from tests.end_to_end.programs import report
from tests.end_to_end.test_dependencies import NO_REGISTRY

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = (ROOT / "README.md", *sorted(set((ROOT / "docs").glob("*.md")) - {ROOT / "docs" / "index.md"}))
LONGEST = 150
COMMANDS = [
    command
    for page in PAGES
    for block in re.findall(r"```\w*\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    for command in re.findall(r"^(?:python tools/\w+\.py|tbmslam) .+$", block.replace("\\\n", " "), re.MULTILINE)
]
INSTALLATION = ("python3 -m venv .venv && . .venv/bin/activate", "pip install --no-compile .")
SOURCES = (
    "tbmslam",
    "merging",
    "datasets",
    "tools",
    "docs",
    "pyproject.toml",
    "hatch_build.py",
    "README.md",
    "LICENSE",
)

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
    program, words = program_of(command)
    grammar = program.parser() if hasattr(program, "parser") else program._parser()
    grammar.parse_args(words)


def program_of(command):
    """Return the program that a command starts, and its arguments."""
    first, second, *words = shlex.split(command.partition(" > ")[0], comments=True)
    module = f"tools.{PROGRAMS[second][0]}" if first == "tbmslam" else second.removesuffix(".py").replace("/", ".")
    return importlib.import_module(module), words


@pytest.fixture
def recordings(flat, tmp_path, monkeypatch):
    """The files that the README speaks of, in the current folder: simulated ones, also for what is downloaded."""

    def fetched(_address, path, *_):
        path.parent.mkdir(parents=True)
        path.symlink_to(flat / "robot_0.bag")
        return True

    monkeypatch.setattr(downloading, "download", fetched)
    monkeypatch.chdir(tmp_path)
    for name, bag in (("run", 0), ("monday", 0), ("tuesday", 1), ("wednesday", 1)):
        (tmp_path / f"{name}.bag").symlink_to(flat / f"robot_{bag}.bag")


def write_plan(folder, monday):
    """Write a floor plan on which Monday's map lies as the README says: X 12.5, Y -3, 90 degrees."""
    save_map(folder / "plan", load_map(monday).rotate(math.pi / 2))
    told = yaml.safe_load((folder / "plan" / "map.yaml").read_text())
    told["origin"] = [told["origin"][0] + 12.5, told["origin"][1] - 3.0, 0.0]
    told["image"] = "plan/map.pgm"
    (folder / "plan.yaml").write_text(yaml.safe_dump(told))


def test_every_line_of_the_readme_does_what_it_says(recordings, tmp_path):
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    assert len(lines) >= 8
    for line in lines:
        if line in INSTALLATION:  # see below
            continue
        if "plan.yaml" in line:
            write_plan(tmp_path, tmp_path / "out" / "week" / "monday")
        program, words = program_of(line)
        assert program.main(words) == 0, line
        if "-o" in words:
            assert (tmp_path / words[words.index("-o") + 1] / "report.html").is_file()
    for opened in re.findall(r"(?:[Oo]pen|is in) `(out/[\w/.-]+)`", README):
        assert (tmp_path / opened).exists(), opened
    told = report(tmp_path / "out" / "on-plan")["maps"]["monday"]["T_merged_map"]
    assert told == pytest.approx([12.5, -3.0, math.pi / 2], abs=0.1)
    assert report(tmp_path / "out" / "room-merged")["merged"] is True


@pytest.mark.slow
def test_the_first_lines_install_what_the_others_run(tmp_path):
    folder, bin_folder = tmp_path / "clone", tmp_path / "bin"
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / name, folder / name)
    bin_folder.mkdir()
    (bin_folder / "python3").symlink_to(sys.executable)
    assert all(line in README.splitlines() for line in INSTALLATION)
    lines = [
        *INSTALLATION,
        "tbmslam --version",
        *(f"python tools/{name}.py --help" for name in ("build_maps", "merge")),
    ]
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(  # noqa: S603 - the README's own lines
        ["/bin/bash", "-e", "-c", "\n".join(lines)],
        cwd=folder, env=environment | {"PATH": f"{bin_folder}:{environment['PATH']}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if any(what in done.stderr for what in NO_REGISTRY):
        pytest.skip("no package registry can be reached")
    assert done.returncode == 0, done.stderr
    assert [word for word in ("tbmslam 0.", "usage: build_maps", "usage: merge") if word not in done.stdout] == []


def test_no_page_needs_a_clone_where_the_installed_program_does_the_same():
    programs = {program for program, _ in PROGRAMS.values()} - {"benchmark"}  # whose figures are made in a clone
    assert not [command for command in COMMANDS if command.split()[1].removeprefix("tools/")[:-3] in programs]


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
    assert max(map(len, README.splitlines())) <= 120


def test_every_page_is_led_to_from_the_readme():
    assert all(f"](docs/{page.name})" in README for page in PAGES[1:])
