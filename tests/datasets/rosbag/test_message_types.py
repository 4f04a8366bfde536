import pytest

from datasets.rosbag.message_types import ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, SCAN_TYPE, TF_TYPES, standard_md5_sum
from datasets.rosbag.message_types import standard_types as types


@pytest.mark.parametrize("msgtype", [SCAN_TYPE, ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, *TF_TYPES])
def test_checksums_are_those_of_the_standard_definitions(msgtype):
    assert standard_md5_sum(msgtype) == types(is_ros1=True).generate_msgdef(msgtype)[1]


def test_what_is_no_standard_type_has_no_checksum():
    assert standard_md5_sum("odd/msg/Odd") is None
