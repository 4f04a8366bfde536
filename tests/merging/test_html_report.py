import base64
import math
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.alignment import Alignment
from merging.html_report import html_report
from merging.merger import Merge
from merging.report import WALL_COLOURS, write_report
from merging.warping import warp
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap

NASTY = '<script>alert("1")</script>&'


class Page(HTMLParser):
    """The tags, the words and the pictures of a page; every tag that is opened must be closed."""

    VOID = ("meta", "img")

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.words, self.pictures = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "img":
            self.pictures.append(dict(attrs)["src"])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def refusal(name="there", reason="too few walls agree"):
    alignment = Alignment("features", accepted=False, reason=reason, scale=math.nan, matches=9, inliers=2)
    left_out = {"here": "no other", name: "no other"}
    return Merge(None, {}, {("here", name): alignment}, left_out, None)


def test_a_merge_is_told_with_pictures_poses_and_figures(rooms, tmp_path):
    maps = {"here": TbmMap(rooms(1)), "there": TbmMap(warp(rooms(1), SE2(1.0, 2.0, 0.5), rooms(1).geometry))}
    maps["foreign"] = TbmMap(rooms(2))
    config = MergeConfig(method="features")
    result = merge(maps, config)
    write_report(tmp_path, result, maps, config)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    said = " ".join(page.words)
    assert "2 of 3 maps were merged." in said
    assert page.words.count("accepted") == 1
    assert result.alignments["here", "there"].reason in said
    assert result.left_out["foreign"] in said
    pose = result.poses["there"]
    assert f"{pose.x:.3f} {pose.y:.3f} {math.degrees(pose.theta):.2f}" in said
    pictures = [base64.b64decode(source.removeprefix("data:image/png;base64,")) for source in page.pictures]
    assert len(pictures) == 3
    assert pictures[1] == (tmp_path / "overlay.png").read_bytes()
    assert pictures[2] == (tmp_path / "contradictions.png").read_bytes()
    merged = cv2.imdecode(np.frombuffer(pictures[0], np.uint8), cv2.IMREAD_COLOR)
    assert merged.shape[:2] == result.fusion.conflict.shape


def test_a_refusal_is_told_with_its_reason_and_without_a_pose():
    page = Page(html_report(refusal(), {}, {}, WALL_COLOURS))
    said = " ".join(page.words)
    assert "No two maps could be merged." in said
    assert "too few walls agree" in said
    assert "2 of 9" in said
    assert "nan" not in said
    assert page.pictures == []


@pytest.mark.parametrize("place", ["name", "reason"])
def test_what_came_from_outside_is_text_and_never_markup(place):
    page = Page(html_report(refusal(**{place: NASTY}), {NASTY: 1.0}, {NASTY: (b"png", NASTY)}, WALL_COLOURS))
    assert "script" not in page.tags
    assert "".join(page.words).count(NASTY) >= 4


def test_the_page_needs_nothing_else():
    text = html_report(refusal(), {}, {"map": (b"png", "a map")}, WALL_COLOURS)
    assert "default-src 'none'" in text
    assert not re.search(r"https?://|<script|<link|@import|url\(", text)
