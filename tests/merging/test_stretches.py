import math

import numpy as np
import pytest

from merging.alignment import Alignment, Alternative
from merging.bending_config import StretchConfig
from merging.config import GraphConfig
from merging.stretches import Stretch, elect, stretches_of
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import SE2
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.trajectory import Trajectory

HERE, ELSEWHERE = SE2(3.0, -4.0, 1.0), SE2(20.0, 7.0, -2.0)


def map_of_lengths(*lengths):
    """Drives straight on, a keyframe each metre that sees a wall two metres aside."""
    drives = []
    for number, length in enumerate(lengths):
        poses = [SE2(float(x), 10.0 * number, 0.0) for x in range(length + 1)]
        scans = [LaserScan(float(x), math.pi / 2 - 0.01, 0.01, 0.1, 20.0, np.full(3, 2.0)) for x in range(len(poses))]
        keyframes = Keyframes.from_scans(scans, poses, [SE2.identity()] * len(poses))
        drives.append(Drive(str(number), Trajectory(keyframes.stamps, keyframes.poses), keyframes))
    return TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 4, 4)), tuple(drives))


def test_a_drive_is_cut_into_stretches_of_the_same_length():
    stretches = stretches_of(map_of_lengths(80), StretchConfig(length_m=25.0))
    assert [len(stretch.points) for stretch in stretches] == [27, 27, 27]
    assert [stretch.way_m for stretch in stretches] == pytest.approx([13.0, 40.0, 67.0])
    for stretch in stretches:
        geometry = stretch.map.grid.geometry
        assert geometry.resolution == 0.1
        left, right = stretch.points[0, 0], stretch.points[-1, 0]
        assert geometry.origin_x == pytest.approx(left, abs=0.2)
        assert geometry.origin_x + geometry.cols * 0.1 == pytest.approx(right, abs=0.2)


def test_every_drive_is_cut_and_a_short_one_kept_whole():
    stretches = stretches_of(map_of_lengths(10, 60), StretchConfig(length_m=25.0))
    assert [len(stretch.points) for stretch in stretches] == [11, 30, 31]
    assert [stretch.way_m for stretch in stretches] == pytest.approx([5.0, 24.5, 55.0])


def test_long_drives_are_cut_into_longer_stretches():
    stretches = stretches_of(map_of_lengths(200, 200), StretchConfig(length_m=10.0, most=8))
    assert len(stretches) == 8


def along(*ways):
    return [Stretch(map_of_lengths(0), np.array([[way - 1.0, 0.0], [way + 1.0, 0.0]]), 0, 0, way) for way in ways]


def found(motion, confidence, others=()):
    alternatives = tuple(Alternative(other, confidence, 5.0) for other in others)
    accepted = confidence >= 0.7
    return Alignment(
        "correlation", accepted, "", motion, agreed_wall_m=9.0, confidence=confidence, alternatives=alternatives
    )


def elected(stretches, *answers):
    return elect(stretches, answers, GraphConfig(), StretchConfig())


def test_what_two_stretches_say_is_elected():
    one, near = found(HERE, 0.95), found(HERE @ SE2(0.3, 0.1, 0.01), 0.9)
    place = elected(along(0.0, 25.0, 50.0), one, found(ELSEWHERE, 0.1), near)
    assert list(place.motions) == [0, 2]
    middle = np.array([25.0, 0.0])
    assert np.hypot(*(place.motion.apply(middle) - HERE.apply(middle))) < 0.5


def test_an_alternative_may_agree():
    place = elected(along(0.0, 25.0), found(HERE, 0.95), found(ELSEWHERE, 0.2, others=[HERE]))
    assert list(place.motions) == [0, 1]
    assert place.motion == pytest.approx(HERE)


def test_one_stretch_is_not_enough():
    assert elected(along(0.0, 25.0), found(HERE, 0.999), found(None, 0.0)) is None


def test_doubtful_stretches_alone_elect_nothing():
    assert elected(along(0.0, 25.0), found(HERE, 0.4), found(HERE, 0.4)) is None


def test_three_doubtful_stretches_elect_what_nothing_speaks_against():
    answers = [found(HERE @ SE2(0.1 * number, 0.0, 0.0), 0.1) for number in range(3)]
    place = elected(along(0.0, 25.0, 50.0, 75.0), *answers, found(ELSEWHERE, 0.1))
    assert list(place.motions) == [0, 1, 2]


def test_doubtful_stretches_that_agree_on_several_places_elect_none():
    answers = [found(HERE, 0.2, others=[ELSEWHERE]) for _ in range(3)]
    assert elected(along(0.0, 25.0, 50.0), *answers) is None


def test_an_accepted_stretch_elsewhere_outweighs_a_doubtful_second():
    assert elected(along(0.0, 25.0, 50.0), found(HERE, 0.9), found(HERE, 0.1), found(ELSEWHERE, 0.999)) is None


@pytest.mark.parametrize(("apart", "agrees"), [(25.0, False), (100.0, True)])
def test_the_farther_apart_the_more_may_stretches_differ(apart, agrees):
    shifted = HERE @ SE2(3.0, 0.0, 0.0)
    place = elected(along(0.0, apart), found(HERE, 0.95), found(shifted, 0.95))
    assert (place is not None) == agrees
