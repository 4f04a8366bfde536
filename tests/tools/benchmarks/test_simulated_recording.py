import pytest

from tools.benchmarks.simulated_recording import SimulatedRecording, SimulationError


def test_the_word_comes_back():
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


def test_what_cannot_be_simulated_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SimulationError, match="office:1:good,beams=5 could not be simulated: see the message above"):
        SimulatedRecording.parse("office:1:good,beams=5").write(tmp_path / "file")
