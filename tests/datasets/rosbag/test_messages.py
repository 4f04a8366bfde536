import numpy as np
import pytest

from datasets import DatasetError, open_recording
from datasets.options import RecordingOptions
from datasets.rosbag.messages import ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, SCAN_TYPE, TF_TYPES, standard_md5_sum
from datasets.rosbag.messages import standard_types as types


@pytest.mark.parametrize("msgtype", [SCAN_TYPE, ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, *TF_TYPES])
def test_checksums_are_those_of_the_standard_definitions(msgtype):
    assert standard_md5_sum(msgtype) == types(is_ros1=True).generate_msgdef(msgtype)[1]


def test_what_is_no_standard_type_has_no_checksum():
    assert standard_md5_sum("odd/msg/Odd") is None


def test_names_cannot_steer_the_terminal(script, tmp_path, caplog):
    script.tf(100.0, "base_link", "las\x1b[2J\ner", topic="/tf_static").drive(100.0, 103.0)
    for k in range(20):
        script.scan(100.5 + 0.1 * k, np.full(181, 3.0), frame="las\x1b[2J\ner", step=0.01)
    recording = open_recording([script.in_time_order().write(tmp_path / "run.bag")])
    assert len(list(recording)) == 20
    with pytest.raises(DatasetError, match=r"las\\x1b\[2J\\ner"):
        open_recording([tmp_path / "run.bag"], RecordingOptions(laser_frame="other"))
    assert "\x1b" not in caplog.text
