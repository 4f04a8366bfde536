import json
import math

import numpy as np
import pytest

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_folder import save_map
from tools.map_pairs.pair_of_area import pair_of_area
from tools.mapping.truth_file import OWN_MAP
from tools.paper.detectors import AS_WRITTEN, DetectorResult, Setting, Study
from tools.paper.experiments import PaperResults, PaperSettings, load_pairs, record_of


def test_pairs_are_loaded_with_their_true_poses(tmp_path):
    cut = pair_of_area(500.0, 0.2)
    poses = {"robot_0": SE2(5.0, 1.0, 0.3), "robot_1": SE2(5.0, 1.0, 0.3) @ cut.T_target_source}
    for name, tbm_map in (("robot_0", cut.target), ("robot_1", cut.source)):
        save_map(tmp_path / name, tbm_map)
    truth = {name: {"T_reference_map": list(pose)} for name, pose in poses.items()}
    (tmp_path / "truth.json").write_text(json.dumps({"source": OWN_MAP, "robots": truth, "warnings": []}))
    (pair,) = load_pairs(tmp_path, 10, 0.2)
    assert pair.name == "robot_0 - robot_1"
    assert pair.T_target_source == pytest.approx(cut.T_target_source)
    with pytest.raises(TbmSlamError, match=r"no two of 2 maps share 100% of the smaller one"):
        load_pairs(tmp_path, 10, 1.0)


def test_a_doubtful_truth_causes_a_warning(tmp_path, caplog):
    cut = pair_of_area(500.0, 0.2)
    for name, tbm_map in (("robot_0", cut.target), ("robot_1", cut.source)):
        save_map(tmp_path / name, tbm_map)
    poses = {"robot_0": SE2.identity(), "robot_1": cut.T_target_source}
    robots = {name: {"T_reference_map": list(pose)} for name, pose in poses.items()}
    warning = {"at_s": 720.7, "what": "lost"}
    (tmp_path / "truth.json").write_text(json.dumps({"source": OWN_MAP, "robots": robots, "warnings": [warning]}))
    load_pairs(tmp_path, 10, 0.2)
    (line,) = caplog.messages
    assert line.endswith(
        f"truth.json is {OWN_MAP}, and may be wrong itself: its mapping gave a warning: at 720.7 s: lost"
    )


def test_no_number_is_null_in_the_record():
    setting = Setting(100, 0.7, "b")
    study = Study({setting: np.array([math.nan, 0.5])}, {setting: np.array([0, 2])}, {100: np.array([90, 95])})
    detectors = {"a - b": {"ORB": DetectorResult(0, math.nan, math.nan)}}
    results = PaperResults(detectors, {AS_WRITTEN: study}, {}, {}, None, None)
    record = record_of(results, PaperSettings((100,), (0.7,), 100, 0.7, 0.5, (), 2), "reproduce_paper -o out")
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["command"] == "reproduce_paper -o out"
    assert record["settings"]["keypoints"] == [100]
    assert record["table_1"]["a - b"]["ORB"] == {"matches": 0, "share_right": None, "share_inliers": None}
    (table,) = record["table_2"]
    assert (table["bits"], table["unknown"], table["found"]) == (128, "as it is", {"100": [90, 95]})
    assert table["rows"] == [
        {"keypoints": 100, "ratio": 0.7, "modification": "b", "shares": [None, 0.5], "matches": [0, 2]}
    ]
