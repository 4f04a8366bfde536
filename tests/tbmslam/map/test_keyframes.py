import dataclasses
import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan

SCANS = [
    LaserScan(1.0, -1.0, 0.5, 0.1, 30.0, np.array([1.0, np.inf, np.nan])),
    LaserScan(2.0, 1.0, -0.25, 0.2, math.inf, np.array([])),
    LaserScan(3.0, 0.0, 0.1, 0.0, 10.0, np.array([4.5])),
]
POSES = [SE2(0.0, 0.0, 0.0), SE2(1.0, 2.0, 3.0), SE2(-1.0, 0.5, -3.0)]
MOUNTS = [SE2(0.2, 0.0, math.pi)] * 3


@pytest.fixture
def keyframes():
    return Keyframes.from_scans(SCANS, POSES, MOUNTS)


def test_scans_of_any_beam_count_come_back(keyframes):
    assert len(keyframes) == 3
    for index, scan in enumerate(SCANS):
        again = keyframes.scan(index)
        np.testing.assert_array_equal(again.ranges, scan.ranges)
        assert dataclasses.replace(again, ranges=scan.ranges) == scan


def test_poses_of_robot_and_laser(keyframes):
    for index, pose in enumerate(POSES):
        assert keyframes.pose(index) == pose
        assert keyframes.sensor_pose(index) == pytest.approx(pose @ MOUNTS[0])


def test_another_frame_moves_the_robot_and_not_the_laser_on_it(keyframes):
    T_new_old = SE2(4.0, -1.0, 2.0)
    moved = keyframes.transformed(T_new_old)
    for index in range(3):
        assert moved.pose(index) == pytest.approx(T_new_old @ keyframes.pose(index))
        assert moved.sensor_pose(index) == pytest.approx(T_new_old @ keyframes.sensor_pose(index))
    np.testing.assert_array_equal(moved.ranges, keyframes.ranges)


def test_there_may_be_none():
    none = Keyframes.from_scans([], [], [])
    assert len(none) == 0
    assert len(none.transformed(SE2(1.0, 1.0, 1.0))) == 0


@pytest.mark.parametrize("field", ["poses", "sensor_poses", "beams", "offsets", "indices"])
def test_arrays_of_different_length_are_refused(keyframes, field):
    with pytest.raises(ValueError, match="keyframe arrays must agree on 3 keyframes, got shapes"):
        dataclasses.replace(keyframes, **{field: getattr(keyframes, field)[:-1]})


@pytest.mark.parametrize("value", [-math.inf, -0.1])
def test_negative_ranges_are_refused(keyframes, value):
    with pytest.raises(ValueError, match="ranges must not be negative"):
        dataclasses.replace(keyframes, ranges=np.array([1.0, value, np.nan, 4.5], dtype=np.float32))


@pytest.mark.parametrize("offsets", [[1, 3, 3, 4], [0, 3, 2, 4], [0, 3, 3, 5]])
def test_offsets_outside_the_ranges_are_refused(keyframes, offsets):
    with pytest.raises(ValueError, match="offsets must rise from 0 to the 4 ranges"):
        dataclasses.replace(keyframes, offsets=np.array(offsets))


@pytest.mark.parametrize("indices", [[-1, 0, 1], [0, 2, 2], [3, 2, 4]])
def test_indices_that_do_not_rise_are_refused(keyframes, indices):
    with pytest.raises(ValueError, match="indices into the trajectory must rise from 0 or later, none of them twice"):
        dataclasses.replace(keyframes, indices=np.array(indices))


@pytest.mark.parametrize(
    ("field", "place", "value"),
    [
        ("stamps", 0, np.nan),
        ("poses", (0, 1), np.inf),
        ("sensor_poses", (0, 1), np.nan),
        ("beams", (0, 1), np.inf),
        ("beams", (0, 3), np.nan),
    ],
)
def test_what_is_no_number_is_refused(keyframes, field, place, value):
    values = getattr(keyframes, field).copy()
    values[place] = value
    with pytest.raises(ValueError, match="stamps, poses and beams must be finite"):
        dataclasses.replace(keyframes, **{field: values})
