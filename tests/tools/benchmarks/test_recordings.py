from pathlib import Path

import pytest

from datasets import RecordingOptions
from tbmslam.geometry.se2 import SE2
from tools.benchmarks.recordings import SimulatedRecording, SimulationError, beside, parse_recording_spec


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
    with pytest.raises(SimulationError, match="office:1:good,beams=5 could not be simulated: see the message above"):
        SimulatedRecording.parse("office:1:good,beams=5").write(tmp_path / "file")


def test_a_path_alone_is_read_as_it_is():
    spec = parse_recording_spec("data/intel.bag")
    assert spec.path == Path("data/intel.bag")
    assert spec.options == RecordingOptions()


def test_options_are_those_of_build_maps():
    spec = parse_recording_spec(
        "a.bag,angle_step_deg=1.0,scan-topic=/x,sensor_pose=-1 2 0,upside_down,clock_offset=-82.2"
    )
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
