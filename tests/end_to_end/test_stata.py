"""The MIT Stata Center as it is published: a PR2's bag with a wrong laser clock, and the laser's truth."""

import gc
import gzip
import json
import math
from functools import cache

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from datasets.synthetic.bag_writing import Messages
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam.geometry.se2 import SE2, compose
from tests.end_to_end.programs import build
from tools import benchmark, evaluate

# One worker records and maps the drive for both.
pytestmark = pytest.mark.xdist_group("stata")

LAG_S, LATENCY_S = 82.2, 0.030
TORSO, LASER = SE2(-0.05, 0.0, 0.0), SE2(0.275, 0.0, 0.0)


def nanoseconds(seconds):
    return round(seconds * 1e6) * 1000


class Pr2Bag:
    """What a PR2 records, frames with leading slashes: the base laser's stamps lag by 82.2 s, the others' do not."""

    def __init__(self, robot):
        self._robot, self._messages = robot, Messages(ros1=True)
        self._entries = []

    def write(self, path):
        store = self._messages.store
        for k, stamp in enumerate(self._robot.odometry.stamps.tolist()):
            self._add_motion(stamp, self._robot.odometry.pose(k))
        for reading in self._robot.readings:
            self._add_scans(reading.scan)
        writer = Writer(path)
        writer.set_compression(Writer.CompressionFormat.BZ2)
        with writer:
            known = {}
            for taken, topic, kind, data in sorted(self._entries, key=lambda entry: entry[0]):
                known[topic] = known.get(topic) or writer.add_connection(topic, kind, typestore=store)
                writer.write(known[topic], taken, data)

    def _add(self, seconds, topic, kind, data):
        self._entries.append((nanoseconds(seconds), topic, kind, data))

    def _add_motion(self, stamp, pose):
        """The localiser's jumping map frame, the wheels' drifting frame, torso and tilt joint, and two odometries."""
        now, messages, tf = nanoseconds(stamp), self._messages, self._messages.tf_type
        nod = SE2(0.0, 0.0, 0.4 * math.sin(3.0 * stamp))
        jumping = SE2(5.0 + 0.1 * math.sin(7.0 * stamp), 2.0, 0.3)
        for parent, child, motion in (
            ("/odom_combined", "/base_footprint", pose),
            ("/map", "/odom_combined", jumping),
            ("/base_footprint", "/base_link", SE2.identity()),
            ("/base_link", "/torso_lift_link", TORSO),
            ("/torso_lift_link", "/laser_tilt_link", nod),
            ("/base_link", "/base_laser_link", LASER),
        ):
            self._add(stamp + 0.001, "/tf", tf, messages.transform(now, parent, child, motion))
        slipping = SE2(1.03 * pose.x, 1.03 * pose.y, 1.02 * pose.theta)
        wheels = messages.odometry(now, "/odom", "/base_footprint", slipping, (0.0, 0.0, 0.0))
        self._add(stamp + 0.001, "/base_odometry/odom", "nav_msgs/msg/Odometry", wheels)
        kind, types = "geometry_msgs/msg/PoseWithCovarianceStamped", messages.store.types
        whole = messages.store.deserialize_ros1(
            messages.odometry(now, "/odom_combined", "", pose, (0.0, 0.0, 0.0)), "nav_msgs/msg/Odometry"
        )
        combined = types[kind](whole.header, whole.pose)
        data = bytes(messages.store.serialize_ros1(combined, kind))
        self._add(stamp + 0.002, "/robot_pose_ekf/odom_combined", kind, data)

    def _add_scans(self, scan):
        fields = {
            "angle_min": scan.angle_min,
            "angle_increment": scan.angle_increment,
            "angle_max": scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment,
            "time_increment": scan.time_increment,
            "scan_time": 0.05,
            "range_min": scan.range_min,
            "range_max": scan.range_max,
            "ranges": np.where(scan.is_hit(), scan.ranges, 65.533).astype(np.float32),
        }
        kind, taken = "sensor_msgs/msg/LaserScan", scan.stamp + LATENCY_S
        base = self._messages.scan(nanoseconds(scan.stamp - LAG_S), "/base_laser_link", fields)
        self._add(taken, "/base_scan", kind, base)
        floor = {**fields, "ranges": np.full(len(scan.ranges), 1.2, np.float32)}  # the nodding laser sees the floor
        self._add(taken, "/tilt_scan", kind, self._messages.scan(nanoseconds(scan.stamp), "/laser_tilt_link", floor))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A drive through an office as the data set publishes it, and its truth: CSV, microseconds, poses of the laser."""
    folder = tmp_path_factory.mktemp("stata")
    world, laser = make_world("office", 2), SimulatedLaser(beams=520, rate=10.0, sweep=0.018, T_robot_sensor=LASER)
    drives = plan_drives(world, 1, length=15.0, seed=2)
    (robot,) = simulate(world, drives, laser, OdometryNoise.preset("good"), 2)
    Pr2Bag(robot).write(folder / "run.bag")
    stamps = robot.truth.stamps - LAG_S
    poses = compose(robot.truth.poses, np.array(LASER))
    (folder / "run.gt.laser.poses").write_text(
        "".join(f"{round(t * 1e6)}, {x:.6f}, {y:.6f}, {a:.6f}\n" for t, (x, y, a) in zip(stamps, poses, strict=True))
    )
    return folder


@pytest.fixture(scope="module")
def maps(recording, tmp_path_factory):
    out = tmp_path_factory.mktemp("maps")
    truth = ("--reference", recording / "run.gt.laser.poses", "--frames", "odometry")
    return build(out, recording / "run.bag", "--profile", "stata", *truth)


def test_a_pr2_s_bag_is_mapped_by_its_base_laser(maps, recording, tmp_path):
    run = json.loads((maps / "run" / "run.json").read_text())
    read = run["recording"]
    assert (read["scan_topic"], read["odometry"], read["odom_frame"]) == ("/base_scan", "tf", "odom_combined")
    assert run["counts"]["dropped"] in ({}, {"before_odometry": 1})
    # The nodding laser, whose clock is right, tells that a scan takes 30 ms to arrive.
    assert read["clock_offset_s"] == pytest.approx(LAG_S, abs=0.002)
    packed = tmp_path / "run.bag.gz"
    packed.write_bytes(gzip.compress((recording / "run.bag").read_bytes(), 1))
    again = build(tmp_path / "again", packed, "--profile", "stata", "--frames", "odometry", "--no-truth")
    for name in ("trajectory.tum", "map.pgm"):
        assert (again / "run" / name).read_bytes() == (maps / "run" / name).read_bytes()


def test_every_program_scores_the_laser_s_truth_equally(maps, recording, tmp_path, capsys, monkeypatch):
    told = json.loads((maps / "truth.json").read_text())["robots"]["run"]["ate_m"]
    assert told < 0.005
    truth = recording / "run.gt.laser.poses"
    capsys.readouterr()
    estimate = maps / "run" / "trajectory.tum"
    assert evaluate.main(["trajectory", str(estimate), "--truth", str(truth), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ate_m"]["rmse"] == pytest.approx(told, abs=1e-6)
    tables = tmp_path / "tables.json"
    # In this process; the first run, which is not counted, is the second.
    monkeypatch.setattr("tools.benchmarks.slam.in_fresh_process", cache(lambda run, *words: run(*words)))
    assert benchmark.main(["slam", f"{recording / 'run.bag'},profile=stata", "--table", str(tables)]) == 0
    gc.unfreeze()
    table = json.loads(tables.read_text())["tables"]["drives"]
    (row,) = table["rows"]
    assert float(row[table["columns"].index("ATE m")]) == pytest.approx(told, abs=6e-4)
