import shutil

import cv2
import pytest

from tbmslam.report.page import Card, Page
from tools import screenshot

PAGE = Page("title", "verdict", cards=[Card("a", "b", True, "c")])


@pytest.fixture
def report(tmp_path):
    path = tmp_path / "report.html"
    path.write_text(PAGE.to_html(), encoding="utf-8")
    return path


def needs_a_browser():
    pytest.importorskip("playwright")
    if not any(map(shutil.which, screenshot.BROWSERS)):
        pytest.skip("no browser is installed: apt-get install chromium")


def test_a_page_and_a_part_of_it_are_pictured(report, tmp_path):
    needs_a_browser()
    whole, part = tmp_path / "deep" / "whole.png", tmp_path / "part.png"
    assert screenshot.main([str(report), "-o", str(whole), "--size", "800", "500"]) == 0
    assert cv2.imread(str(whole)).shape == (500, 800, 3)
    assert screenshot.main([str(report), "-o", str(part), "--element", ".card"]) == 0
    assert 100 < cv2.imread(str(part)).shape[1] < 800


def test_a_page_that_is_not_there_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: name)
    assert screenshot.main([str(tmp_path / "no.html"), "-o", str(tmp_path / "a.png")]) == 1
    assert capsys.readouterr().err == f"screenshot: {tmp_path / 'no.html'}: does not exist: give a report.html\n"


def test_the_error_without_a_browser_names_the_package(report, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    assert screenshot.main([str(report), "-o", str(tmp_path / "a.png")]) == 1
    assert capsys.readouterr().err == "screenshot: no browser is installed: install chromium\n"
