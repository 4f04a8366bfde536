"""The notebooks, run from top to bottom in a folder of their own, and the outputs that lie in them."""

import base64
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def read(path):
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    return nbformat.read(path, as_version=4)


def pictures(notebook):
    return [
        cv2.imdecode(np.frombuffer(base64.b64decode(output.data["image/png"]), np.uint8), cv2.IMREAD_COLOR)
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if "image/png" in output.get("data", {})
    ]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_runs_and_shows_what_it_showed(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    before, notebook = read(path), read(path)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert len(pictures(notebook)) == len(pictures(before)) > 0
    for first, second in zip(pictures(before), pictures(notebook), strict=True):
        assert np.abs(np.subtract(first.shape, second.shape)).max() <= 20  # fonts and wheels differ a little
    said = [[output.text for output in cell.get("outputs", []) if "text" in output] for cell in notebook.cells]
    assert any("merged" in text for texts in said for text in texts) or path.stem == "one_bag"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_they_hold_their_outputs_and_nothing_of_the_machine(path):
    notebook = read(path)
    ran = [cell.execution_count for cell in notebook.cells if cell.cell_type == "code"]
    assert ran == list(range(1, len(ran) + 1))
    text = path.read_text(encoding="utf-8")
    assert not [word for word in ("/tmp/", "/home/", "/work/", "Traceback") if word in text]  # noqa: S108 - no file
    assert path.stat().st_size < 500_000


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["one_bag", "three_robots", "two_floor_plans"]
