from pathlib import Path

import pytest

from datasets import RecordingOptions
from tbmslam.geometry.se2 import SE2
from tools.benchmarks.recording_spec import beside, parse_recording_spec


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
