import base64
import json
import re

import cv2
import numpy as np
import pytest

from tools.reproduce_paper import main


@pytest.mark.slow
def test_from_simulated_drives_to_the_report(tmp_path, capsys):
    small = [
        "--world",
        "apartment",
        "--drives",
        "3",
        "--duration",
        "40",
        "--keypoints",
        "100,300",
        "--ratios",
        "0.7,0.8",
    ]
    assert main([*small, "--areas", "600", "--repeat", "2", "-o", str(tmp_path)]) == 0
    assert capsys.readouterr().out.endswith(f"report -> {tmp_path / 'report.html'}\n")
    page = (tmp_path / "report.html").read_text()
    for title in (
        "Figure 1",
        "Table I:",
        "Table II:",
        "Figure 3",
        "Table III:",
        "Table IV:",
        "Figure 2",
        "Figure 4",
        "Settings",
    ):
        assert f"<h2>{title}" in page
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(pictures) == 4 + 3 + 1 + 6 + 2  # of two maps that show little, nothing is merged
    for picture in pictures:
        assert cv2.imdecode(np.frombuffer(base64.b64decode(picture), np.uint8), cv2.IMREAD_COLOR) is not None
    # Bags of the same name in different folders have each their own truth.
    truth = json.loads((tmp_path / "maps" / "truth.json").read_text())
    assert max(robot["ate_m"] for robot in truth["robots"].values()) < 0.5
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert list(figures["table_1"]) == [f"drive_{a}_robot_0 - drive_{b}_robot_0" for a, b in ((0, 1), (0, 2), (1, 2))]
    assert {(study["bits"], study["unknown"]) for study in figures["table_2"]} == {
        (bits, unknown) for bits in (128, 256) for unknown in ("as it is", "inverted")
    }
    assert len(figures["table_2"][0]["rows"]) == 2 * 2 * 5
    assert figures["table_4"]["cut for 600 m²"]["area_m2"] > 300.0

    again = ["--maps", str(tmp_path / "maps"), "--keypoints", "100", "--ratios", "0.7", "--areas", "", "--pairs", "1"]
    assert main([*again, "--repeat", "2", "-o", str(tmp_path / "again")]) == 0
    assert list(json.loads((tmp_path / "again" / "figures.json").read_text())["table_3"]) == [
        "drive_0_robot_0 - drive_1_robot_0"
    ]


def test_maps_without_truth_are_one_line_and_exit_1(tmp_path, capsys):
    assert main(["--maps", str(tmp_path), "-o", str(tmp_path / "out")]) == 1
    assert re.fullmatch(
        r"reproduce_paper: .*truth.json does not state the poses of maps .*: make them with `tbmslam map` .*\n",
        capsys.readouterr().err,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.bag", "--maps", "b"], "--maps replaces recordings: give one of them"),
        (["--pairs", "17"], "--pairs: must be a whole number within 1 and 16, got '17'"),
        (["--ratios", "0"], "--ratios: must be a number within 1e-06 and 1e+06, got '0'"),
        (["--tolerance", "nan"], "--tolerance: must be a number within 1e-06 and 1e+06, got 'nan'"),
        (["--keypoints", "many"], "--keypoints: must be a whole number of at least 1, got 'many'"),
        (["--ratios", ""], "--ratios: must be a number within 1e-06 and 1e+06, got ''"),
        (["--drives", "1000000"], "--drives: must be a whole number within 2 and 1000, got '1000000'"),
        (["--repeat", "1"], "--repeat: must be a whole number within 2 and 1000, got '1'"),
        (["--world", "nowhere"], "invalid choice: 'nowhere'"),
        (["--maps", ""], "the name of a file is empty"),
    ],
)
def test_wrong_usage_is_exit_2(tmp_path, usage_error, arguments, message):
    assert message in usage_error(main, [*arguments, "-o", str(tmp_path)])
