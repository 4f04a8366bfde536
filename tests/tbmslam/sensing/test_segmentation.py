import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.segmentation import (
    Itinerary,
    Segment,
    SegmentationError,
    in_frame,
    private_frame,
    split_at_gaps,
    split_at_intervals,
    split_by_distance,
    split_by_time,
)


@pytest.fixture
def drive():
    """100 s at 1 Hz: standing for the first half, then 1 m/s."""
    stamps = np.arange(100.0) + 1000.0
    return Itinerary(stamps, np.maximum(np.arange(100.0) - 50.0, 0.0))


def test_equal_distances_with_overlap(drive):
    segments = split_by_distance(drive, 3, 0.25)
    lengths = [drive.travelled[s.stop - 1] - drive.travelled[s.start] for s in segments]
    np.testing.assert_allclose(lengths, 49.0 / 2.5, atol=1.5)
    shared = drive.travelled[segments[0].stop - 1] - drive.travelled[segments[1].start]
    assert shared == pytest.approx(0.25 * 49.0 / 2.5, abs=1.5)
    assert segments[0].start == 0
    assert segments[-1].stop == 100


def test_equal_times(drive):
    assert split_by_time(drive, 2, 0.0) == [Segment(0, 50), Segment(50, 100)]


def test_without_odometry_time_takes_the_place_of_distance():
    standing = Itinerary(np.arange(10.0), np.zeros(10))
    assert split_by_distance(standing, 2, 0.0) == split_by_time(standing, 2, 0.0)


def test_distance_adds_up_over_readings():
    poses = [SE2(0, 0, 0), SE2(3, 4, 1), None, SE2(9, 9, 0), SE2(9, 10, 0)]
    itinerary = Itinerary.from_poses(range(5), poses)
    np.testing.assert_allclose(itinerary.travelled, [0, 5, 5, 5, 6])


def test_gaps():
    itinerary = Itinerary(np.array([0.0, 1.0, 2.0, 60.0, 61.0, 200.0]), np.zeros(6))
    assert split_at_gaps(itinerary, 5.0) == [Segment(0, 3), Segment(3, 5), Segment(5, 6)]
    with pytest.raises(ValueError, match=r"gap_s must be positive, got 0"):
        split_at_gaps(itinerary, 0)


def test_wrong_stamps_take_no_time_from_other_robots():
    stamps = np.arange(100.0)
    stamps[5:50:10] -= 30.0
    assert split_by_time(Itinerary(stamps, np.zeros(100)), 2, 0.0) == [Segment(0, 50), Segment(50, 100)]
    assert split_by_time(Itinerary(np.array([5.0, 4.0, 3.0, 2.0]), np.zeros(4)), 2, 0.0)[0].start == 0


def test_a_clock_that_is_set_right_again_makes_no_gap():
    stamps = np.array([0.0, 1.0, 2.0, -30.0, 3.0, 4.0, -26.0, -25.0, 60.0, 61.0, 20.0, 50.0, 51.0])
    assert split_at_gaps(Itinerary(stamps, np.zeros(13)), 5.0) == [Segment(0, 8), Segment(8, 11), Segment(11, 13)]


def test_gaps_between_nearly_all_readings_are_none():
    itinerary = Itinerary(np.arange(0.0, 100.0, 0.2), np.zeros(500))
    with pytest.raises(SegmentationError, match=r"a gap of 0\.1 s is shorter than the usual 0\.2 s .*longer --gap"):
        split_at_gaps(itinerary, 0.1)
    assert split_at_gaps(itinerary, 0.3) == [Segment(0, 500)]


def test_intervals(drive):
    assert split_at_intervals(drive, [(0.0, 10.0), (5.0, 1e9)]) == [Segment(0, 10), Segment(5, 100)]
    with pytest.raises(SegmentationError, match=r"no reading lies between 200 s and 300 s: the recording lasts 99.0 s"):
        split_at_intervals(drive, [(200.0, 300.0)])


@pytest.mark.parametrize(("robots", "overlap", "message"), [(0, 0.1, "robots must be"), (2, 1.0, "overlap must lie")])
def test_wrong_arguments(drive, robots, overlap, message):
    with pytest.raises(ValueError, match=message):
        split_by_time(drive, robots, overlap)


def test_too_few_readings():
    with pytest.raises(SegmentationError, match=r"3 readings are too few for 2 robots"):
        split_by_time(Itinerary(np.arange(3.0), np.zeros(3)), 2, 0.0)


def test_private_frames_depend_on_seed_and_robot():
    frames = {private_frame(seed, robot) for seed in range(5) for robot in range(5)}
    assert len(frames) == 25
    assert private_frame(3, 1) == private_frame(3, 1)
    assert all(abs(f.x) <= 10 and abs(f.y) <= 10 for f in frames)
    for number in (0, 1, 2):  # shifted and turned every way
        own = np.array([frame[number] for frame in frames])
        assert own.std() == pytest.approx(np.pi / 3**0.5 if number == 2 else 10.0 / 3**0.5, rel=0.35)


def test_in_frame_moves_the_odometry_only():
    scan = LaserScan(0.0, 0.0, 0.1, 0.0, 10.0, np.ones(3))
    mount = SE2(0.2, 0.0, 0.1)
    moved = in_frame(Reading(scan, SE2(1, 0, 0), mount), SE2(0, 0, np.pi / 2))
    assert moved.T_odom_robot == pytest.approx((0.0, 1.0, np.pi / 2))
    assert moved.T_robot_sensor == mount
    assert moved.T_odom_swept is None
    swept = in_frame(Reading(scan, SE2(1, 0, 0), mount, SE2(2, 0, 0)), SE2(0, 0, np.pi / 2))
    assert swept.T_odom_swept == pytest.approx((0.0, 2.0, np.pi / 2))
    blind = Reading(scan, None)
    assert in_frame(blind, SE2(1, 1, 1)) is blind
