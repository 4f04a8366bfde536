"""Every report of section D of the field notes has a test with its number in its name."""

import re
from pathlib import Path

REPORTS = 33
TESTS = Path(__file__).resolve().parents[1]


def test_every_report_has_a_test():
    sources = [path.read_text(encoding="utf-8") for path in TESTS.glob("*/test_field_notes_d.py")]
    names = re.findall(r"^def test_((?:d\d\d_)+)", "\n".join(sources), re.MULTILINE)
    tested = {int(number) for name in names for number in re.findall(r"d(\d\d)", name)}
    assert tested == set(range(1, REPORTS + 1))
