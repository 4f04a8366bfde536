import io
import sys

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tools import evaluate, merge
from tools.command_line.console import one_line, print_anything


def test_a_name_that_is_no_text_can_be_printed(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", stream)
    print_anything()
    stream.write("drive \udcff\n")
    stream.flush()
    assert stream.buffer.getvalue() == b"drive \\udcff\n"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("a\nb"), "a b"),
        (OSError(36, "File name too long", "x\ny"), "x y: File name too long: check that name, or choose another"),
        (OSError("odd"), "odd: check what is read and printed"),
    ],
)
def test_an_error_is_one_line(error, said):
    assert one_line(error) == said


def test_a_name_too_long_is_one_line(tmp_path, capsys):
    long, maps = str(tmp_path / ("x" * 300)), [tmp_path / "a", tmp_path / "b"]
    for folder in maps:
        save_map(folder, TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 3, 4))))
    assert merge.main([*map(str, maps), "-o", long]) == 1
    assert evaluate.main(["map", long, "--truth", long]) == 1
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in said] == ["merge", "evaluate"]
    assert "cannot be written into (File name too long): choose another folder with -o" in said[0]
    assert "File name too long: check that name, or choose another" in said[1]
