"""Every shared recording through both programs; nobody here made them, so figures are rough and traps are real."""

import functools
import itertools
import json
import math

import numpy as np
import pytest

import merging
from datasets import open_recording
from datasets.options import RecordingOptions
from merging.bridges import refutation
from merging.config import MergeConfig, ShortRangeConfig
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.evaluation.relations import read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.map_folder import load_map
from tbmslam.io.trajectory_file import read_tum
from tbmslam.loop_closure.odometry_headings import OdometryHeadings
from tbmslam.slam import Slam
from tbmslam.tracking import constant_velocity, odometry_hypotheses, surfel_tracker
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig
from tests.end_to_end.programs import build, merge_maps
from tools import merge
from tools.benchmarks.perturb import with_odometry_reversed
from tools.command_line.paths import map_folders

# One worker maps each recording once for all of them.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("shared recordings")]

ONE_DEGREE = ("--angle-step-deg", 1.0)
FOLDERS = {
    "aces": ("aces/aces.bag", ONE_DEGREE),
    "intel": ("intel/intel.bag", ONE_DEGREE),
    "mit-csail": ("mit-csail/mit-csail.bag", ()),
    "mit-csail, log": ("mit-csail/mit-csail.clf.xz", ()),
    "fr-clinic": ("fr-clinic/fr-clinic.bag", ()),
    "intel-real": ("intel-real/intel-real.bag", ONE_DEGREE),
    "cmu-wean 1": ("cmu-wean/robotdata1.log", ()),
    "cmu-wean 2": ("cmu-wean/robotdata2.log", ()),
    "olin-neato 1": ("olin-neato/ac109_1_demo.bag", ("--scan-topic", "stable_scan")),
    "olin-neato 3": ("olin-neato/ac109_3_demo.bag", ("--scan-topic", "scan")),
    "racecar-ros1": ("racecar-ros1/localization_bag1.bag", ()),
    "racecar-ros2": ("racecar-ros2/sct1_v20_a0_m02_1", ()),
}


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Return a function that maps a recording, with further options of the program, once."""

    @functools.cache
    def map_once(shared_data, name, *options):
        recording, own = FOLDERS[name]
        return map_folders(build(tmp_path_factory.mktemp("maps"), shared_data / recording, *own, *options))

    return map_once


@pytest.mark.parametrize("name", FOLDERS)
def test_each_maps_and_every_file_can_be_read_again(shared_data, mapped, name):
    (folder,) = mapped(shared_data, name)
    run = json.loads((folder / "run.json").read_text())
    assert run["result"]["scans"] == len(read_tum(folder / "trajectory.tum"))
    tbm_map = load_map(folder)
    assert tbm_map.grid.is_known().sum() * tbm_map.grid.geometry.resolution**2 > 1.0
    assert np.isfinite(tbm_map.grid.masses).all()


@pytest.mark.parametrize(
    ("name", "reached_m", "reached_deg"),
    [
        ("aces", 0.0336, 0.299),
        ("intel", 0.0130, 0.205),
        ("mit-csail", 0.0260, 0.315),
        ("fr-clinic", 0.104, 0.69),
        ("intel-real", 0.0131, 0.204),
    ],
)
def test_drives_agree_with_the_true_relations(shared_data, mapped, name, reached_m, reached_deg):
    relations = read_relations(shared_data / name / f"{name}.relations")
    (folder,) = mapped(shared_data, name)
    errors = relation_errors(relations, read_tum(folder / "trajectory.tum"))
    assert len(errors.translations_m) == len(relations.stamps)
    assert errors.translations_m.mean() < 1.3 * reached_m
    assert errors.rotations_deg.mean() < 1.3 * reached_deg


def test_no_part_of_a_drive_follows_frozen_odometry(shared_data, tmp_path):
    """CSAIL's does for a second of a turn by 85 degrees, and each part meets it with other keyframes behind it."""
    maps = build(tmp_path / "maps", shared_data / "mit-csail" / "mit-csail.bag", "--robots", 3, "--overlap", 0.3)
    robots = json.loads((maps / "truth.json").read_text())["robots"]
    assert len(robots) == 3
    assert max(robot["ate_m"] for robot in robots.values()) < 0.2


def test_two_robots_from_one_real_drive(shared_data, tmp_path):
    maps = build(tmp_path / "maps", shared_data / "mit-csail" / "mit-csail.bag", "--robots", 2)
    merged = merge_maps(tmp_path / "merged", *map_folders(maps))
    assert merged["merged"] is True


@pytest.mark.parametrize(("is_joint", "least", "most"), [(True, 5, 5), (False, 2, 3)])
def test_bent_drives_merge_only_if_bridges_are_verified_after_a_joint_optimisation(
    shared_data, tmp_path, monkeypatch, is_joint, least, most
):
    """Without it two or three maps merge: millimetres decide about the third. Short ranges would join the rest."""
    maps = build(tmp_path / "maps", shared_data / "aces" / "aces.bag", *ONE_DEGREE, "--robots", 5)
    if not is_joint:
        monkeypatch.setattr("merging.bridges.refutation.jointly_refined", lambda *_: None)
        monkeypatch.setattr("merging.merged_group.jointly_refined", lambda *_: None)
    parts = {folder.name: load_map(folder) for folder in map_folders(maps)}
    config = MergeConfig(short_range=ShortRangeConfig(enabled=False))
    assert least <= len(merging.merge(parts, config).poses) <= most


@pytest.mark.parametrize(("offset", "is_short", "merged"), [(0.0, True, 3), (0.001, True, 3), (0.0, False, 2)])
def test_bridges_of_short_ranges_are_verified_by_short_ranges(
    shared_data, mapped, monkeypatch, offset, is_short, merged
):
    """Two of the drives are bent: their whole maps agree at the true pose, but their far walls refute the bridge."""
    if not is_short:
        in_full = refutation.group_maps_of
        monkeypatch.setattr(refutation, "group_maps_of", lambda *args: in_full(*args[:5]))
    folders = mapped(shared_data, "fr-clinic", "--robots", 6, "--range-offset", offset)
    parts = {folder.name: load_map(folder) for folder in folders[2:5]}
    found = merging.merge(parts)
    assert len(found.poses) == merged
    assert found.alignments["fr-clinic_3", "fr-clinic_4"].accepted is is_short


def test_two_real_drives_merge_and_merge_with_a_known_map(shared_data, tmp_path):
    logs = [shared_data / "cmu-wean" / f"robotdata{number}.log" for number in (1, 2)]
    maps = build(tmp_path / "maps", *logs, "--separate", "--no-truth")
    drives = [str(folder) for folder in map_folders(maps)]
    plan = str(shared_data / "cmu-wean" / "wean.dat.gz")
    told = ["--pose", "robotdata1", "34.5", "40", "71"]
    assert merge.main([plan, *drives, *told, "-o", str(tmp_path / "merged")]) == 0
    report = json.loads((tmp_path / "merged" / "report.json").read_text())
    assert [name for name, one in report["maps"].items() if one["merged"]] == ["wean.dat", "robotdata1", "robotdata2"]
    pairs = {(one["target"], one["source"]): one for one in report["pairs"]}
    assert pairs["robotdata1", "robotdata2"]["confidence"] >= 0.85
    assert pairs["wean.dat", "robotdata1"]["agreed_wall_m"] > 25.0


@pytest.mark.parametrize("name", FOLDERS)
def test_no_correctly_described_laser_causes_a_warning(shared_data, mapped, name):
    (folder,) = mapped(shared_data, name)
    warnings = json.loads((folder / "run.json").read_text())["warnings"]
    assert not [one for one in warnings if " fit best where " in one]


@pytest.mark.parametrize("name", ["aces", "intel"])
@pytest.mark.parametrize("stated", [(), ("--angle-step-deg", 180 / 179)], ids=["found out", "stated"])
def test_angles_that_the_converter_stretched(shared_data, tmp_path, name, stated):
    """They are undone, unless the user states them: then a warning tells of them."""
    (folder,) = map_folders(build(tmp_path, shared_data / FOLDERS[name][0], *stated))
    warnings = json.loads((folder / "run.json").read_text())["warnings"]
    (told,) = [one for one in warnings if " fit best where " in one or " fit better where " in one]
    if stated:
        assert told.endswith(" degrees apart, not 1.0056: try --angle-step-deg 1")
    else:
        assert told.endswith("scans fit better where beams are 1 degrees apart, not 1.0056: they are read so")


@pytest.mark.parametrize(("is_known", "least", "most"), [(True, 0.0, 0.1), (False, 0.1, 20.0)])
def test_scans_far_apart_need_the_outline_of_the_last_keyframe(shared_data, monkeypatch, is_known, least, most):
    """Ablation of `tbmslam.kernels.surfels.outline` on mit-csail with a scan each metre or 0.5 rad."""
    readings = list(open_recording([shared_data / "mit-csail/mit-csail.bag"], RecordingOptions()))
    if not is_known:
        monkeypatch.setattr(surfel_tracker, "outline_of", lambda *_: np.empty((0, 5)))
    assert least < error_of_few(readings, 12.0, 1.0) < most


@pytest.mark.parametrize(("is_estimated", "least", "most"), [(True, 0.0, 0.13), (False, 1.0, 10.0)])
def test_few_hits_among_trees_do_not_overrule_odometry(shared_data, monkeypatch, is_estimated, least, most):
    """Ablation of `tbmslam.tracking.fit_by_chance` on fr-clinic with odometry that is reversed for four of 60 seconds.

    Without it, at the right pose one object of fifty would lie on no known surface, even in a new place. Of 29 such
    drives, which begin at other times of the period, one is torn with the estimate.
    """
    if not is_estimated:
        monkeypatch.setattr(surfel_tracker, "misfit_cost", lambda _, strays: 4.0 * strays)
    readings = open_recording([shared_data / "fr-clinic/fr-clinic.bag"], RecordingOptions())
    trajectory = trajectory_of(with_odometry_reversed(readings, since=13.0))
    relations = read_relations(shared_data / "fr-clinic/fr-clinic.relations")
    assert least < relation_errors(relations, trajectory).translations_m.mean() < most


@pytest.mark.parametrize(("is_fused", "least", "most"), [(True, 0.0, 0.72), (False, 0.73, 1.0)])
def test_headings_among_trees_need_odometry_that_drifts_less(shared_data, monkeypatch, is_fused, least, most):
    """Ablation of `tbmslam.loop_closure.odometry_headings` on fr-clinic, from three starts."""
    if not is_fused:
        monkeypatch.setattr(OdometryHeadings, "fused", lambda *_: None)
    readings = list(open_recording([shared_data / "fr-clinic/fr-clinic.bag"], RecordingOptions()))
    relations = read_relations(shared_data / "fr-clinic/fr-clinic.relations")
    drives = [trajectory_of(readings[start:]) for start in (0, 40, 80)]
    assert least < np.mean([relation_errors(relations, drive).rotations_deg.mean() for drive in drives]) < most


@pytest.mark.parametrize(("is_estimated", "least", "most"), [(True, 0.0, 0.1), (False, 0.3, 20.0)])
def test_scans_far_apart_need_the_cost_of_faulty_odometry(shared_data, monkeypatch, is_estimated, least, most):
    """Ablation of `tbmslam.tracking.odometry_fault.faulty_cost` on mit-csail with a scan each metre or 0.5 rad.

    The mean of drives that begin at four places, since single ones differ by chance.
    """
    readings = list(open_recording([shared_data / "mit-csail/mit-csail.bag"], RecordingOptions()))
    if not is_estimated:
        monkeypatch.setattr(odometry_hypotheses, "faulty_cost", lambda *_: 0.0)
    assert least < np.mean([error_of_few(readings, begin, 1.0) for begin in (6.0, 12.0, 42.0, 72.0)]) < most


@pytest.mark.parametrize(("min_matched", "least", "most"), [(0.1, 0.0, 0.1), (0.2, 0.5, 10.0)])
def test_scans_far_apart_show_mostly_new_places(shared_data, min_matched, least, most):
    """Ablation of a smaller `tracker.min_matched` on intel with a scan each 1.25 m or 0.5 rad."""
    options = RecordingOptions(angle_step_deg=1.0)
    readings = list(open_recording([shared_data / "intel/intel.bag"], options))
    config = SlamConfig(tracker=SurfelTrackerConfig(min_matched=min_matched))
    assert least < error_of_few(readings, 12.0, 1.25, config) < most


@pytest.mark.parametrize(("too_old", "least", "most"), [(5.0, 0.0, 0.03), (math.inf, 1.0, 10.0)])
def test_gaps_in_the_scans(shared_data, monkeypatch, too_old, least, most):
    """Ablation of a limit of the robot's last pose on mit-csail, where 15 or 25 seconds of scans are missing."""
    monkeypatch.setattr(constant_velocity, "_TOO_OLD", too_old)
    readings = list(open_recording([shared_data / "mit-csail/mit-csail.bag"], RecordingOptions()))
    relations = read_relations(shared_data / "mit-csail/mit-csail.relations")
    first, last = (extreme(r.scan.stamp for r in readings) for extreme in (min, max))
    errors = []
    for twelfth, gap in ((2.5, 15.0), (3.5, 25.0), (6.5, 25.0)):
        begin = first + (last - first) * twelfth / 12.0
        kept = [r for r in readings if not begin <= r.scan.stamp < begin + gap]
        errors.append(relation_errors(relations, trajectory_of(kept)).translations_m.mean())
    assert least < max(errors) < most


def error_of_few(readings, begin, spacing, config=None):
    """Return the ATE of a drive with a scan each `spacing` [m] or 0.5 rad against the drive with all scans [m].

    It begins after a distance `begin` [m].
    """
    dense = trajectory_of(readings)
    steps = [one.T_odom_robot.to(other.T_odom_robot) for one, other in itertools.pairwise(readings)]
    travelled = np.append(0.0, np.cumsum([np.hypot(step.x, step.y) for step in steps]))
    first = int(np.searchsorted(travelled, begin))
    few = [readings[first]]
    for reading in readings[first:]:
        x, y, turn = few[-1].T_odom_robot.to(reading.T_odom_robot)
        if np.hypot(x, y) >= spacing or abs(turn) >= 0.5:
            few.append(reading)
    return align_trajectories(dense, trajectory_of(few, config)).ate_m


def trajectory_of(readings, config=None):
    slam = Slam(config or SlamConfig())
    for reading in readings:
        slam.process(reading)
    return slam.finish().drives[0].trajectory
