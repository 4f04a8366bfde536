from pathlib import Path

import numpy as np
import pytest

from datasets import RecordingOptions
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tools.benchmarks.recordings import (
    SimulatedRecording,
    beside,
    drive_errors,
    parse_recording_spec,
    truth_beside,
)


def test_the_argument_is_reproduced():
    text = "office:3:poor,beams=361,range_max=20"
    drive = SimulatedRecording.parse(text)
    assert drive == SimulatedRecording("office", 3, "poor", ("beams=361", "range_max=20"))
    assert str(drive) == text
    assert [str(each) for each in drive.seeds(2)] == [text, text.replace(":3:", ":4:")]
    assert {each.family() for each in drive.seeds(2)} == {"office:*:poor,beams=361,range_max=20"}


@pytest.mark.parametrize("text", ["office", "office:good", "office:x:good", "office:-1:good"])
def test_another_form_is_refused(text):
    with pytest.raises(ValueError, match=r"--world must look like office:1:good, got 'office"):
        SimulatedRecording.parse(text)


@pytest.mark.parametrize(("odometry", "reads"), [("poor", True), ("ignored", False)])
def test_odometry_may_be_ignored(tmp_path, odometry, reads):
    from datasets import open_recording

    spec = SimulatedRecording.parse(f"office:1:{odometry},beams=5,duration=2").write(tmp_path)
    assert (tmp_path / "robot_0.truth.tum").exists()
    readings = list(open_recording([spec.path], spec.options))
    assert len(readings) == 40
    assert all((reading.T_odom_robot is not None) == reads for reading in readings)


def test_an_impossible_simulation_is_reported(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(TbmSlamError, match="office:1:good,beams=5 could not be simulated: see the message above"):
        SimulatedRecording.parse("office:1:good,beams=5").write(tmp_path / "file")


def test_a_path_alone_is_read_as_it_is():
    spec = parse_recording_spec("data/intel.bag")
    assert spec.path == Path("data/intel.bag")
    assert spec.options == RecordingOptions()
    assert spec.name == "intel"


def test_options_are_those_of_build_maps():
    spec = parse_recording_spec(
        "a.bag,angle_step_deg=1.0,scan-topic=/x,sensor_pose=-1 2 0,upside_down,clock_offset=-82.2"
    )
    assert spec.text.startswith("a.bag,angle_step_deg=1.0,")
    assert spec.options == RecordingOptions(
        angle_step_deg=1.0, scan_topic="/x", sensor_pose=SE2(-1.0, 2.0, 0.0), upside_down=True, clock_offset=-82.2
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a.bag,angel_step_deg=1", r"a\.bag,angel_step_deg=1: unrecognized arguments: --angel-step-deg 1"),
        ("a.bag,angle_step_deg=x", r"a\.bag,.*: argument --angle-step-deg: invalid float value: 'x'"),
        ("a.bag,range_min=-1", r"a\.bag,range_min=-1: range_min must not be negative, got -1\.0"),
    ],
)
def test_wrong_options(text, message):
    with pytest.raises(ValueError, match=message):
        parse_recording_spec(text)


def test_files_beside(tmp_path):
    for name in ("run.2.relations", "csail.relations", "folder.truth.tum"):
        (tmp_path / name).touch()
    assert beside(tmp_path / "run.2.bag", ".relations") == tmp_path / "run.2.relations"
    assert beside(tmp_path / "csail.clf.xz", ".relations") == tmp_path / "csail.relations"
    assert beside(tmp_path / "folder", ".truth.tum") == tmp_path / "folder.truth.tum"
    assert beside(tmp_path / "other.bag", ".relations") is None


FRAME = SE2(4.0, -7.0, 2.0)


def along(stamps):
    """Return a robot that goes a metre a second."""
    stamps = np.asarray(stamps, dtype=np.float64)
    return Trajectory(stamps, np.column_stack((stamps, 0.0 * stamps, 0.0 * stamps)))


def relations_file(folder, pairs):
    """Write relations which say that it goes a metre a second and 0.1 m aside."""
    path = folder / "run.relations"
    path.write_text("".join(f"{a} {b} {b - a} 0.1 0 0 0 0\n" for a, b in pairs))
    return path


def truth_file(folder, stamps):
    path = folder / "run.truth.tum"
    path.write_text("".join(f"{stamp} {stamp} 0 0 0 0 0 1\n" for stamp in stamps))
    return path


def test_the_truth_is_found_beside_the_recording(tmp_path):
    with pytest.raises(TbmSlamError, match=r"run\.bag: has no \.relations and no \.truth\.tum beside it"):
        truth_beside(tmp_path / "run.bag")
    truth = truth_file(tmp_path, [0, 1])
    assert truth_beside(tmp_path / "run.bag") == truth
    relations = relations_file(tmp_path, [(0, 1)])
    assert truth_beside(tmp_path / "run.bag") == relations


def test_relations_between_estimated_poses_are_scored(tmp_path):
    path = relations_file(tmp_path, [(0, 1), (1, 5), (5, 6), (0, 8), (6, 20)])
    errors = drive_errors(path, along(range(8)).transformed(FRAME), np.arange(10.0))
    assert errors.kind == "relations"
    assert errors.scored().tolist() == [True, True, True, False, False]
    np.testing.assert_allclose(errors.metres[:3], 0.1, atol=1e-9)
    np.testing.assert_allclose(errors.degrees[:3], 0.0, atol=1e-9)
    assert errors.has_scans.tolist() == [True, True, True, True, False]


def test_means_are_those_of_what_is_asked_for(tmp_path):
    path = relations_file(tmp_path, [(0, 1), (2, 3)])
    turned = Trajectory(np.arange(4.0), np.array([[0, 0, 0], [1, 0.1, 0], [2, 0, 0], [3, 0.4, np.radians(2)]]))
    errors = drive_errors(path, turned, turned.stamps)
    assert errors.error_m(np.array([True, True])) == pytest.approx(0.15)
    assert errors.error_deg(np.array([False, True])) == pytest.approx(2.0)
    assert errors.error_m(np.array([False, False])) is None
    assert errors.error_deg(np.array([False, False])) is None


def test_poses_are_scored_after_a_rigid_alignment(tmp_path):
    path = truth_file(tmp_path, [*range(10), 9.5])
    estimate = along(range(4, 9)).transformed(FRAME)
    estimate.poses[0, :2] += 0.3
    errors = drive_errors(path, estimate, np.arange(10.0))
    assert errors.kind == "poses"
    assert errors.scored().tolist() == [4 <= stamp < 9 for stamp in [*range(10), 9.5]]
    assert 0.05 < errors.error_m(errors.scored()) < 0.3
    assert errors.error_deg(errors.scored()) is None
    assert errors.has_scans.tolist() == [True] * 10 + [False]


@pytest.mark.parametrize("stamps", [[], [3]])
def test_less_than_two_poses_cannot_be_scored(tmp_path, stamps):
    estimate = along(stamps)
    assert not drive_errors(truth_file(tmp_path, range(5)), estimate, np.arange(5.0)).scored().any()
    assert not drive_errors(relations_file(tmp_path, [(0, 1)]), estimate, np.arange(5.0)).scored().any()
