import math
import pickle

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.configuration.parameters import ConfigError
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import read_tum
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tools.benchmark import main
from tools.benchmarks.perturb import (
    UNPERTURBED,
    Perturbation,
    Score,
    begun_later,
    config_with,
    perturbations,
    poses_of,
    run_perturbed,
    score,
    summary,
    with_laser_moved,
    with_odometry_reversed,
    with_range_noise,
    with_scans_dropped,
)
from tools.benchmarks.recordings import DriveErrors, SimulatedRecording, parse_recording_spec

# One worker simulates the drive for all of them.
pytestmark = pytest.mark.xdist_group("perturbations")


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    world = "office:2:good,beams=91,rate=5,duration=30"
    return SimulatedRecording.parse(world).write(tmp_path_factory.mktemp("drive"))


def test_a_laser_stated_elsewhere_is_scored_by_where_the_laser_was(spec):
    before = run_perturbed(spec, UNPERTURBED)
    assert before.kind == "poses"
    assert before.scored().all()
    for one in perturbations():
        if one.name.startswith("laser"):
            after = run_perturbed(spec, one)
            # Unless it were scored there, turns of the robot would leave centimetres.
            assert after.error_m(after.scored()) < before.error_m(before.scored()) + 0.005


def test_scans_taken_away_are_known(spec):
    dropped = next(one for one in perturbations() if "dropped" in one.name)
    errors = run_perturbed(spec, dropped)
    truth = read_tum(spec.path.with_suffix(".truth.tum"))
    assert len(errors.metres) == len(truth)
    np.testing.assert_array_equal(errors.scored(), errors.has_scans)
    assert 0 < (~errors.has_scans).sum() < 0.15 * len(truth)


def test_all_drives_of_a_map_are_scored():
    def drive(stamps):
        poses = np.column_stack((stamps, np.zeros(2), np.full(2, math.pi / 2)))
        return Drive("robot", Trajectory(np.array(stamps), poses), Keyframes.from_scans([], [], []))

    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 1, 1))
    moved = next(one for one in perturbations() if one.name == "laser +4 cm in x")
    poses = poses_of(TbmMap(grid, (drive([0.0, 1.0]), drive([7.0, 8.0]))), moved)
    assert poses.stamps.tolist() == [0.0, 1.0, 7.0, 8.0]
    np.testing.assert_allclose(poses.poses[:, 0], poses.stamps, atol=1e-12)
    np.testing.assert_allclose(poses.poses[:, 1], 0.04)  # the robot was ahead of where it is stated
    assert len(poses_of(TbmMap(grid), moved)) == 0


NAN = np.nan


def errors(metres, has_scans=None, kind="relations"):
    metres = np.array(metres, dtype=np.float64)
    has = np.ones(len(metres), dtype=np.bool_) if has_scans is None else np.array(has_scans, dtype=np.bool_)
    return DriveErrors(kind, metres, 10.0 * metres, has)


def scored(metres, before, ratio=1.1, **more):
    return score(Perturbation("a little", ratio=ratio), errors(metres, **more), errors(before))


@pytest.mark.parametrize(
    ("metres", "before", "verdict"),
    [
        ([0.10, 0.12], [0.1, 0.1], "ok"),
        ([0.10, 0.13], [0.1, 0.1], "MISS"),
        ([0.013, 0.013], [0.01, 0.01], "ok"),  # 3 mm more
        ([0.0131, 0.0131], [0.01, 0.01], "MISS"),
        ([0.003, 0.003], [0.0005, 0.0005], "ok"),  # six times, yet not 3 mm more
        ([0.6, 0.6], [0.1, 0.1], "LOST"),
        ([0.1, NAN], [0.1, 0.1], "LOST"),
        ([NAN, NAN], [0.1, 0.1], "LOST"),
        ([0.1, NAN], [0.1, NAN], "ok"),
        ([0.1, 0.1], [0.1, NAN], "ok"),
        ([0.1, 9.0], [0.1, NAN], "LOST"),  # what could not be scored before is torn now
    ],
)
def test_verdicts(metres, before, verdict):
    assert scored(metres, before).verdict == verdict


def test_a_perturbation_may_be_allowed_more():
    assert scored([0.14], [0.1]).verdict == "MISS"
    assert scored([0.14], [0.1], ratio=1.5).verdict == "ok"


def test_relations_of_scans_that_were_taken_away_do_not_count():
    found = scored([NAN, 0.1, NAN, 5.0], [7.0, 0.1, 0.1, 0.1], has_scans=[False, True, True, False])
    assert (found.left_out, found.unscored, found.verdict) == (2, 1, "LOST")
    assert found.error_m == pytest.approx(0.1)
    assert found.error_deg == pytest.approx(1.0)
    assert found.ratio == pytest.approx(1.0)


def test_true_poses_between_the_scans_do_not_count():
    before = errors([0.1, NAN, 0.1], [True, False, True], "poses")
    found = score(Perturbation("a little"), errors([0.1, NAN, 0.1], [True, False, True], "poses"), before)
    assert (found.unscored, found.left_out, found.verdict, found.error_deg) == (0, 0, "ok", None)
    relations = errors([0.1, NAN], [True, False])  # while relations without scans cannot be scored
    assert score(UNPERTURBED, relations, relations).unscored == 1


def test_the_unperturbed_run_has_no_verdict_and_a_failed_run_has_a_reason():
    base = errors([0.1, NAN])
    assert score(UNPERTURBED, base, base) == Score("as it is", pytest.approx(0.1), pytest.approx(1.0), 1, 0, 1.0, "-")
    failed = score(Perturbation("a little"), TbmSlamError("no scan is left"), base)
    assert failed.verdict == "FAILED: no scan is left"
    rows = [score(UNPERTURBED, base, base), failed, scored([0.1], [0.1]), scored([0.3], [0.1]), scored([NAN], [0.1])]
    assert summary(rows) == "4 perturbed runs, 3 misses, 2 of them lost or failed"


def test_what_cannot_be_run_is_one_line_before_anything_runs(spec, tmp_path, capsys):
    recording = spec.path
    assert main(["perturb", str(recording), "--without", "tracker.wlaking=1.0"]) == 1
    assert "--without: there is no parameter 'tracker.wlaking': did you mean" in capsys.readouterr().err
    bare = tmp_path / "bare.bag"
    bare.write_bytes(recording.read_bytes())
    assert main(["perturb", str(bare)]) == 1
    assert "bare.bag: has no .relations and no .truth.tum beside it" in capsys.readouterr().err
    (tmp_path / "bare.truth.tum").write_text("0 0 0 0 0 0 0 1\n")
    bare.unlink()
    assert main(["perturb", str(bare)]) == 1
    assert "bare.bag: no such file or directory" in capsys.readouterr().err
    assert parse_recording_spec(str(bare)).path == bare


STEP = SE2(0.1, 0.02, 0.05)  # from one reading to the next
MOUNT = SE2(0.2, 0.0, 0.3)


def drive(count=700, rate=5.0):
    """Return readings of a robot that goes round, with beams that hit something, nothing, and tell nothing."""
    pose, readings = SE2(3.0, -2.0, 1.0), []
    for index in range(count):
        ranges = np.array([1.0 + 0.01 * (index % 7), np.inf, np.nan, 0.001])
        scan = LaserScan(100.0 + index / rate, -1.0, 0.5, 0.0, 8.0, ranges)
        swept = pose @ SE2(0.01, 0.0, 0.01) if index % 2 else None
        readings.append(Reading(scan, pose if index != 10 else None, MOUNT, swept if index != 10 else None))
        pose = pose @ STEP
    return readings


def named(name):
    return next(one for one in perturbations(["deskew.enabled=false"]) if one.name == name)


def perturbed(name, readings):
    return list(named(name).change(readings))


def test_each_is_there_once_and_reaches_another_process():
    everything = perturbations(["a.b=1", "c=2"])
    assert everything[0] is UNPERTURBED
    names = [one.name for one in everything]
    assert len(set(names)) == len(names) == 16
    assert [one.setting for one in everything[-2:]] == ["a.b=1", "c=2"]
    readings = drive(20)
    for one in everything:
        again = pickle.loads(pickle.dumps(one))  # noqa: S301 - as multiprocessing does
        assert len(list(again.change(readings))) == len(list(one.change(readings)))


def test_readings_are_streamed_one_at_a_time():
    for one in perturbations():
        taken = []

        def recording(taken=taken):
            for reading in drive(400):
                taken.append(reading)
                yield reading

        next(iter(one.change(recording())))
        assert len(taken) <= 151, one.name  # begun later, the first 30 s are passed by


def test_the_same_readings_come_out_the_same():
    readings = drive(200)
    for one in perturbations():
        first, second = (list(one.change(readings)) for _ in range(2))
        assert len(first) == len(second)
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a.scan.ranges, b.scan.ranges)
            assert (a.scan.stamp, a.T_odom_robot, a.T_odom_swept) == (b.scan.stamp, b.T_odom_robot, b.T_odom_swept)


def test_unperturbed_readings_are_the_same():
    readings = drive(5)
    assert all(a is b for a, b in zip(UNPERTURBED.change(readings), readings, strict=True))


@pytest.mark.parametrize(("name", "factor"), [("angle step +0.3 %", 1.003), ("angle step -0.3 %", 0.997)])
def test_angles_between_beams(name, factor):
    for one in perturbed(name, drive(3)):
        assert one.scan.angle_increment == pytest.approx(0.5 * factor)
        assert one.scan.angle_min == -1.0


@pytest.mark.parametrize(("name", "factor"), [("odometry scaled by +5 %", 1.05), ("odometry scaled by -5 %", 0.95)])
def test_lengths_of_the_odometry(name, factor):
    readings = perturbed(name, drive(12))
    motion = readings[3].T_odom_robot.to(readings[4].T_odom_robot)
    assert tuple(motion) == pytest.approx((factor * STEP.x, factor * STEP.y, STEP.theta))
    swept = readings[3].T_odom_robot.to(readings[3].T_odom_swept)
    assert tuple(swept) == pytest.approx((factor * 0.01, 0.0, 0.01))
    assert readings[10].T_odom_robot is None
    assert readings[2].T_odom_swept is None


def test_without_odometry_more_is_allowed():
    assert {(one.T_odom_robot, one.T_odom_swept) for one in perturbed("without odometry", drive(12))} == {(None, None)}
    assert named("without odometry").ratio == 1.5
    assert named("angle step +0.3 %").ratio == 1.1


def test_a_later_start_keeps_stamps_that_step_back():
    readings = drive(400)
    stepped = readings[150].with_scan(readings[120].scan)  # a stamp before the start, later in the recording
    kept = list(begun_later([*readings[:200], stepped, *readings[200:]], 30.0))
    assert kept[0] is readings[150]
    assert len(kept) == 251
    assert kept[50] is stepped
    assert not list(begun_later(readings[:100], 30.0))
    assert not list(begun_later([], 30.0))


def test_dropped_scans_are_drawn():
    kept = list(with_scans_dropped(drive(4000), 0.05))
    assert 0.03 < 1.0 - len(kept) / 4000 < 0.07
    gaps = np.diff([one.scan.stamp for one in kept])
    assert len(np.unique(np.round(gaps, 3))) >= 2


def test_noise_is_on_measured_ranges_only():
    readings = drive(2000)
    noisy = np.array([one.scan.ranges for one in with_range_noise(readings, 0.01)])
    true = np.array([one.scan.ranges for one in readings])
    assert (noisy[:, 0] - true[:, 0]).std() == pytest.approx(0.01, rel=0.1)
    assert abs((noisy[:, 0] - true[:, 0]).mean()) < 0.001
    assert np.isposinf(noisy[:, 1]).all()
    assert np.isnan(noisy[:, 2]).all()
    assert noisy[:, 3].min() == 0.0
    assert np.isfinite(readings[0].scan.ranges[[0, 3]]).all()  # what came in stays as it was
    assert true[5, 0] == 1.05


def test_a_laser_stated_elsewhere_is_carried_by_the_same_robot():
    reading = drive(1)[0]
    moved = next(with_laser_moved([reading], 0.04, -0.04))
    assert tuple(moved.T_robot_sensor) == pytest.approx((0.24, -0.04, 0.3))
    for name, x, y in (("laser +4 cm in x", 0.04, 0.0), ("laser -4 cm in y", 0.0, -0.04)):
        one = named(name)
        stated = next(one.change([reading])).T_robot_sensor
        assert tuple(stated) == pytest.approx((MOUNT.x + x, MOUNT.y + y, MOUNT.theta))
        assert tuple(one.T_stated_true @ reading.T_robot_sensor) == pytest.approx(tuple(stated))


def test_odometry_is_reversed_at_the_end_of_every_minute():
    readings = drive()
    wrong = list(with_odometry_reversed(readings, 4.0, 60.0))
    assert wrong[0].T_odom_robot == readings[0].T_odom_robot
    assert wrong[10] is readings[10]  # which has none
    for index in (1, 100, 279, 280, 290, 299, 300, 301, 580, 699):
        motion = wrong[index - 1].T_odom_robot.to(wrong[index].T_odom_robot)
        sign = -1.0 if (index / 5.0) % 60.0 >= 56.0 else 1.0
        assert tuple(motion) == pytest.approx((sign * STEP.x, sign * STEP.y, STEP.theta)), index
        if index % 2:
            swept = wrong[index].T_odom_robot.to(wrong[index].T_odom_swept)
            assert tuple(swept) == pytest.approx((sign * 0.01, 0.0, 0.01)), index
    assert wrong[11].T_odom_robot == pytest.approx(readings[11].T_odom_robot)  # a gap is bridged
    assert math.dist(wrong[699].T_odom_robot[:2], readings[699].T_odom_robot[:2]) > 1.0


def test_a_setting_changes_one_parameter():
    assert config_with(None) == config_with("map.resolution=0.05")
    assert config_with("map.resolution=0.1").map.resolution == 0.1
    with pytest.raises(ConfigError, match=r"--without: there is no parameter 'map\.size'"):
        config_with("map.size=3")
