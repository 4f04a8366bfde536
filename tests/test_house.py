"""The limits of CONTRIBUTING.md that keep the code readable."""

import re
from collections import Counter

from tests.processes import ROOT
from tools.command_line.configuration import read_configuration, whole_text

ROOMS = ("tbmslam", "merging", "datasets", "tools", "tests", "examples")
MODULES = [path for room in ROOMS for path in (ROOT / room).rglob("*.py")]


def lines_of(name):
    return len((ROOT / name).read_text(encoding="utf-8").splitlines())


def test_no_folder_has_more_than_twenty_modules():
    assert {path: number for path, number in Counter(path.parent for path in MODULES).items() if number > 20} == {}


def test_no_module_has_more_than_400_lines():
    assert [path for path in MODULES if lines_of(path) > 400] == []
    assert max(lines_of("tbmslam/slam.py"), lines_of("merging/merger.py")) <= 200


def test_each_listed_ablation_is_a_test():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.findall(r"`([\w/]+\.py)::(\w+)`", text)
    assert len(listed) > 15
    for path, name in listed:
        folder = ROOT / "tests" if path.startswith(("merging/", "end_to_end/")) else ROOT / "tests" / "tbmslam"
        assert f"def {name}(" in (folder / path).read_text(encoding="utf-8")


def test_users_see_at_most_sixty_parameters():
    lines = whole_text(read_configuration(None, None)).splitlines()
    assert sum(" = " in line or line.endswith(" is not set") for line in lines) <= 60
