import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry
from tbmslam.report.page import Card, Page, Picture, Table, downloads, versions
from tbmslam.report.sheet import Palette, Raster, Sheet, Switch

NASTY = '<script>alert("1")</script>&</style>'
TWO = Palette(((255, 255, 255), (10, 20, 30)))


class Reader(HTMLParser):
    """The tags and the words of a page; every tag that is opened must be closed."""

    VOID = ("meta", "img", "input")

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.words = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):  # noqa: ARG002  # its base class says what it takes
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in {"script", "style"}:
            self.words.append(data)


def page_of(text):
    raster = Raster(
        Switch(text, text, note=text), GridGeometry(1.0, 0.0, 0.0, 1, 1), np.zeros((1, 1), dtype=np.uint8), TWO
    )
    return Page(
        title=text,
        verdict=text,
        figures={text: text},
        sheets=[Sheet(text, (raster,), text), Sheet(text)],
        warnings=[text],
        tables=[Table(text, (text, "#n"), [(text, "1")], text, ["red"])],
        downloads={text: ["a%20b/map.yaml", text]},
        cards=[Card(text, text, True, text, {text: text}, [Picture(b"png", text)])],
        cards_title=text,
        cards_note=text,
        seconds={text: 1.5},
        command=text,
        versions={text: text},
        config={text: {text: text}},
    )


def test_the_page_shows_everything():
    said = " ".join(Reader(page_of("Ünsinn").to_html()).words)
    assert said.count("Ünsinn") >= 25
    assert "Ünsinn.Ünsinn" in said
    assert "1.50" in said
    assert "map.yaml" in said


def test_what_came_from_outside_is_text_and_never_markup():
    ours = Reader(page_of("plain").to_html())
    theirs = Reader(page_of(NASTY).to_html())
    assert theirs.tags == ours.tags
    assert "".join(theirs.words).count(NASTY) >= 20


def test_the_page_needs_nothing_else_and_may_run_nothing_else():
    text = page_of("a").to_html()
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-" in text
    assert not re.search(r"<link|@import|sourceMappingURL|<script[^>]+src", text)
    assert "url(" not in text.partition("<body>")[0]
    assert len(re.findall(r"'sha256-[\w+/]{43}='", text)) == 3


@pytest.mark.parametrize("page", [Page("t", "v"), Page("t", "v", good=False)])
def test_a_page_may_hold_next_to_nothing(page):
    said = Reader(page.to_html())
    assert "t" in said.words
    assert "table" not in said.tags


def test_the_licence_of_what_is_inlined_lies_beside_it():
    from importlib.resources import files

    assert "BSD 2-Clause" in (files("tbmslam.report") / "assets" / "LEAFLET-LICENSE").read_text(encoding="utf-8")


def test_files_are_offered_where_they_are_and_others_are_not(tmp_path):
    folder = tmp_path / "robot #1"
    folder.mkdir()
    for name in ("map.npz", "map.yaml", "trajectory_b%.tum", "trajectory_a.tum", "mine.txt", "unknown.png"):
        (folder / name).touch()
    (folder / "map.tif").mkdir()
    assert downloads(tmp_path, folder) == [
        "robot%20%231/map.yaml",
        "robot%20%231/map.npz",
        "robot%20%231/trajectory_a.tum",
        "robot%20%231/trajectory_b%25.tum",
    ]
    assert downloads(folder, folder)[0] == "map.yaml"
    assert downloads(tmp_path, tmp_path) == []


def test_addresses_have_forward_slashes_also_where_paths_have_others(tmp_path, monkeypatch):
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "map.yaml").touch()
    monkeypatch.setattr(Path, "__bytes__", lambda path: str(path).replace("/", "\\").encode())  # as on Windows
    assert downloads(tmp_path, folder) == ["robot/map.yaml"]


def test_packages_that_results_depend_on_are_named():
    assert {"python", "numpy", "scipy", "numba", "opencv-python-headless", "rosbags"} <= versions().keys()
