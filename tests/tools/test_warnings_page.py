"""docs/warnings.md explains what the programs that map and merge warn of."""

import ast

import pytest

from tests.processes import ROOT
from tests.warnings_page import is_explained
from tools.mapping.truth_file import OWN_MAP, TruthFile

FILES = [
    *sorted((ROOT / "merging").rglob("*.py")),
    *(ROOT / path for path in ("tools/merge.py", "tools/mapping/run.py", "tbmslam/io/ros_map.py")),
]
PASSED_ON = {"%s: %s", "%s %s"}  # an error of a robot, and the doubt about truth.json


def warnings_of(path):
    """Return the format of each warning that a file logs."""
    return [
        ast.literal_eval(call.args[0])
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "logger.warning"
    ]


FORMATS = [text for path in FILES for text in warnings_of(path)]


def test_the_warnings_are_found():
    assert len(set(FORMATS)) >= 14
    assert set(FORMATS) >= PASSED_ON


@pytest.mark.parametrize("text", sorted({*FORMATS} - PASSED_ON))
def test_each_warning_is_explained(text):
    assert is_explained(text.replace("%%", "%"))


def test_the_doubt_about_the_truth_is_explained():
    assert is_explained(TruthFile({}, OWN_MAP, ({"at_s": 1.0, "what": "no scans"},)).doubt())
