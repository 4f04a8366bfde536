import json

import pytest

from tbmslam.geometry.se2 import SE2
from tools.mapping.truth_file import GIVEN, OWN_MAP, TruthFile, TruthFileError, read_truth_file

SAID = {
    "source": OWN_MAP,
    "warnings": [
        {"at_s": 0.0, "what": "no loop was closed", "all_along": True},
        {"at_s": 10.2, "what": "the odometry jumps", "all_along": False},
    ],
    "robots": {"robot_0": {"T_reference_map": [1.0, 2.0, 0.5]}},
}


def read(folder, **other):
    (folder / "truth.json").write_text(json.dumps({**SAID, **other}))
    return read_truth_file(folder / "truth.json")


def test_it_holds_the_poses_and_the_reasons_to_doubt_them(tmp_path):
    found = read(tmp_path)
    assert found.poses == {"robot_0": SE2(1.0, 2.0, 0.5)}
    assert found.doubt() == (
        "is tbmslam's own map of the whole recording, not ground truth, and may be wrong itself: its mapping "
        "gave 2 warnings, first: no loop was closed"
    )
    late = TruthFile({}, OWN_MAP, tuple(SAID["warnings"][1:]))
    assert late.doubt().endswith("gave a warning: at 10.2 s: the odometry jumps")


def test_without_warnings_there_is_no_doubt(tmp_path):
    assert read(tmp_path, source=GIVEN, warnings=[]).doubt() is None


def test_the_truth_of_a_simulated_world_is_another_file(tmp_path):
    with pytest.raises(TruthFileError, match=r"truth.json is 'the simulated world, ground truth' and no place of maps"):
        read(tmp_path, source="the simulated world, ground truth", robots=[])


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"robots": []}', '{"robots": {"a": {"T_reference_map": 3}}}', '{"robots": {}, "warnings": 3}'],
)
def test_an_invalid_truth_file_is_reported_in_one_line(tmp_path, text):
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(TruthFileError, match=r"truth.json .*: make (it|them) with `tbmslam map`") as caught:
        read_truth_file(tmp_path / "truth.json")
    assert "\n" not in str(caught.value)
