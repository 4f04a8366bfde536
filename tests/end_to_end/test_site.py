"""The site of the documentation: every page, every public name, no warning."""

import re

import pytest

import merging
import tbmslam
from tests.processes import ROOT, python


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("sphinx", reason="sphinx is not installed")
    words = ["-W", "--keep-going", "-q", "-b", "html", "-c", ROOT / "docs" / "site", ROOT / "docs", tmp_path / "site"]
    done = python("-m", "sphinx", *words)
    assert (done.returncode, done.stderr) == (0, "")
    page = (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
    described = set(re.findall(r'<dt class="sig sig-object py" id="[\w.]*?(\w+)">', page))
    assert {"Slam", "process", "finish", "from_occupancy", "align", "merge", "load_map"} <= described


def test_every_public_name_and_every_page_is_on_it():
    names = (ROOT / "docs" / "api.rst").read_text(encoding="utf-8")
    listed = set(re.findall(r"::.*\.(\w+)$", names, re.MULTILINE))
    assert (set(tbmslam.__all__) | {"align", "merge", "Alignment"}) - listed == {
        "SlamConfig"
    }  # its parameters: options.md
    assert {"align", "merge"} <= set(merging.__all__)
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8").split()
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= set(index)
