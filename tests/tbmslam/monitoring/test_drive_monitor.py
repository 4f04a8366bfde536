"""What goes wrong in drives: a right map, or a warning that names the time."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.robot.simulation import poses_at
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.drive_monitor import LOST, LOST_WITHOUT_ODOMETRY
from tbmslam.sensing.laser_scan import Corrections, Reading
from tbmslam.slam import Slam
from tests.tbmslam.monitoring.monitored import carried, mapped, said


def test_an_ordinary_drive_has_no_incident(robot):
    slam, _ = mapped(robot.readings)
    assert said(slam) == []


def test_a_carried_robot_is_reported_and_no_scan_is_discarded(robot, caplog):
    readings = carried(robot, 60, 120)
    slam, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    np.testing.assert_array_equal(drive.trajectory.stamps, [r.scan.stamp for r in readings])
    lost = [i for i in slam.incidents if i.what == LOST]
    assert lost[0].stamp == readings[61].scan.stamp
    assert "--interval" in LOST
    assert any(LOST in line for line in caplog.messages)
    before = align_trajectories(robot.truth, mapped(readings[:61])[1].trajectory, 0.01).errors_m
    assert before.max() < 0.1


def test_the_warning_of_a_robot_carried_without_odometry_does_not_mention_odometry(robot):
    readings = [replace(each, T_odom_robot=None, T_odom_swept=None) for each in carried(robot, 60, 120)]
    slam, _ = mapped(readings)
    assert any(LOST_WITHOUT_ODOMETRY in text for text in said(slam))
    assert not any(LOST in text for text in said(slam))


def test_a_drive_may_be_finished_again_and_go_on(robot):
    readings, slam = carried(robot, 60, 120), Slam()
    for reading in readings[:80]:
        slam.process(reading)
    told = []
    for _ in range(2):
        assert len(slam.finish().drives[0].trajectory) == 80
        told.append(said(slam))
    assert told[0] == told[1]
    for reading in readings[80:]:
        slam.process(reading)
    slam.finish()
    assert said(slam) == said(mapped(readings)[0])


def test_times_count_from_the_begin_of_the_recording(robot):
    readings = carried(robot, 60, 120)
    slam = Slam(start_stamp=readings[0].scan.stamp - 100.0)
    for reading in readings:
        slam.process(reading)
    slam.finish()
    assert any(text.startswith("at 124.0 s: ") and LOST in text for text in said(slam))


def test_the_laser_unplugged_for_a_while_costs_only_that_while(robot):
    readings = [*robot.readings[:60], *robot.readings[130:]]
    _, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.3


def test_odometry_that_jumps_is_reported_and_does_no_harm(robot):
    far = SE2(1e7, 0.0, 0.0)
    readings = [
        r if k < 60 else replace(r, T_odom_robot=(far if k == 60 else SE2(1.0, 2.0, 1.0)) @ r.T_odom_robot)
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    assert any("at 12.0 s: the odometry steps by 10000000 m, which is ignored" in line for line in said(slam))


def test_covered_beams_do_not_end_up_in_the_map(robot):
    readings = []
    for reading in robot.readings:
        ranges = reading.scan.ranges.copy()
        ranges[40:80] = 0.3
        readings.append(replace(reading, scan=replace(reading.scan, ranges=ranges)))
    slam, drive = mapped(readings)
    assert any(
        "at 0.0 s: a part of the robot, or something that moves with it, blocks 22% of the beams, -50 to -11°" in line
        for line in said(slam)
    )
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.2
    kept = np.concatenate([drive.keyframes.scan(k).ranges for k in range(len(drive.keyframes))])
    assert not (np.abs(kept - 0.3) < 1e-6).any()


def test_covered_beams_do_not_end_up_in_the_map_if_the_clock_steps_back(robot):
    readings = []
    for k, reading in enumerate(robot.readings):
        ranges = reading.scan.ranges.copy()
        if k < 90:
            ranges[40:80] = 0.3
        stamp = reading.scan.stamp - (1000.0 if k >= 60 else 0.0)
        readings.append(reading.with_scan(replace(reading.scan, stamp=stamp, ranges=ranges)))
    _, drive = mapped(readings)
    kept = np.concatenate([drive.keyframes.scan(k).ranges for k in range(len(drive.keyframes))])
    assert not (np.abs(kept - 0.3) < 1e-6).any()


def test_odometry_that_starts_later_is_no_motion_past_near_walls(robot):
    """Its frame is not that of the map."""
    slam, reading = Slam(changed(SlamConfig(), {"keyframes": {"distance": 0.0}})), robot.readings[0]
    ranges = np.where(np.arange(181) < 40, 0.3, reading.scan.ranges)
    for k in range(20):
        scan = replace(reading.scan, stamp=0.2 * k, ranges=ranges)
        slam.process(replace(reading, scan=scan, T_odom_robot=SE2(100.0, 0.0, 2.0) if k >= 10 else None))
    slam.finish()
    assert not any("a part of the robot" in text for text in said(slam))


def test_many_incidents_are_not_all_listed(robot, caplog):
    slam = Slam(name="robot_7")
    for number in range(30):
        slam.incidents.add(100.0 * number, f"incident {number}")
    slam.process(robot.readings[0])
    with caplog.at_level(logging.WARNING):
        slam.finish()
    assert len(caplog.messages) == 21
    assert caplog.messages[-1] == "robot_7: and 10 more"


def test_what_happens_again_and_again_is_one_line(robot, caplog):
    slam = Slam(name="robot_7")
    for number in range(120):
        slam.incidents.add(100.0 * number, "odometry and scans disagree", 2.0)
    slam.incidents.add(50.0, "the odometry steps by 9 m, which is ignored")
    slam.process(robot.readings[0])
    start = slam.start_stamp
    with caplog.at_level(logging.WARNING):
        slam.finish()
    times = ", ".join(f"{100.0 * number - start:.1f}" for number in range(5))
    assert caplog.messages == [
        f"robot_7: at {times} s and 95 more times: odometry and scans disagree",
        "robot_7: and 21 more",
    ]
    assert len(slam.incidents) == 100  # which the report shows on the map


def test_odometry_in_a_bag_that_stops_for_a_while(robot):
    stamps = robot.truth.stamps
    odometry = poses_at(robot.odometry, stamps)
    readings = [
        Reading(r.scan, None if 40 <= k < 110 else SE2.from_array(pose), r.T_robot_sensor)
        for k, (r, pose) in enumerate(zip(robot.readings, odometry, strict=True))
    ]
    _, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.2


def test_frozen_odometry_is_reported_and_overruled(robot):
    stopped = robot.readings[60].T_odom_robot
    last = robot.readings[120].T_odom_robot
    readings = [
        r if k < 60 else replace(r, T_odom_robot=stopped @ last.inverse() @ (last if k < 120 else r.T_odom_robot))
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    assert any("odometry and scans disagree" in incident.what for incident in slam.incidents)


def test_scaled_ranges_are_detected_by_the_odometry(robot):
    readings = [replace(r, scan=r.scan.with_ranges(1.1 * r.scan.ranges)) for r in robot.readings]
    slam, _ = mapped(readings)
    slam.finish()
    (told,) = [line for line in said(slam) if "scale" in line]
    assert told.startswith("the scans go 1.1")
    assert "times as far as the odometry: one of them has a wrong scale; if it is the odometry, pass --od" in told


@pytest.mark.parametrize("unit", [100.0, 1000.0])
def test_odometry_in_another_unit_does_no_harm_and_is_reported_once(robot, unit):
    def measured(T_odom_robot):
        return SE2(unit * T_odom_robot.x, unit * T_odom_robot.y, T_odom_robot.theta)

    slam, drive = mapped([replace(r, T_odom_robot=measured(r.T_odom_robot)) for r in robot.readings])
    assert align_trajectories(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    slam.finish()
    assert f"--odometry-scale {1.0 / unit:g}" in said(slam)[0]
    steps = [incident for incident in slam.incidents if "steps by" in incident.what]
    assert len(steps) == 1
    assert steps[0].what.endswith(" m, which is ignored")


def test_a_scale_that_was_given_and_is_wrong_is_not_named_again(robot):
    slam = Slam(corrections=Corrections(odometry_scale=0.5))
    for r in robot.readings:
        slam.process(replace(r, T_odom_robot=SE2(0.5 * r.T_odom_robot.x, 0.5 * r.T_odom_robot.y, r.T_odom_robot.theta)))
    slam.finish()
    (told,) = [line for line in said(slam) if "scale" in line]
    assert told.startswith(("the scans go 2.0", "the scans go 1.99"))
    assert told.endswith("if it is the odometry, pass --odometry-scale 1.00")


@pytest.mark.parametrize("seed", [3, 6])
def test_a_sudden_change_of_the_floor_is_reported(robot, drive_in, seed):
    """As when a lift's door opens: little contradicts, and nothing agrees."""
    other = drive_in("halls", 30.0, odometry="good", seed=seed)
    there, first, last = other.readings, other.readings[0], robot.readings[60]
    moved = last.T_odom_robot @ first.T_odom_robot.inverse()
    later = last.scan.stamp + 0.2 - first.scan.stamp
    readings = [
        *robot.readings[:61],
        *(
            replace(r, scan=replace(r.scan, stamp=r.scan.stamp + later), T_odom_robot=moved @ r.T_odom_robot)
            for r in there
        ),
    ]
    slam, drive = mapped(readings)
    lost = [i for i in slam.incidents if i.what == LOST]
    assert lost[0].stamp == readings[61].scan.stamp
    assert len(drive.trajectory) == len(readings)


def test_a_hand_before_the_laser_is_a_continuation(robot):
    readings = [
        replace(r, scan=r.scan.with_ranges(np.where(np.arange(181) < 160, 0.4, r.scan.ranges))) if 60 <= k < 63 else r
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert not any(i.what == LOST for i in slam.incidents)
