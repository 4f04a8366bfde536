"""Recordings that describe their laser wrong, and what the warnings about them are worth."""

import json
from functools import cache

import pytest

from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.trajectory_file import read_tum
from tests.end_to_end.programs import build, simulate

# One worker simulates a drive for all that map it.
pytestmark = pytest.mark.xdist_group("laser_described_wrong")

SMALL = ("--world", "office", "--seed", 3, "--duration", 75, "--beams", 361, "--rate", 8)


@pytest.fixture(scope="module")
def drive_with(tmp_path_factory):
    """Return a function that simulates a drive, once for each fault of the laser."""
    return cache(lambda *fault: simulate(tmp_path_factory.mktemp("drive"), *SMALL, *fault))


def told(maps):
    """Return the option that each warning about the laser names, with its values."""
    warnings = json.loads((maps / "robot_0" / "run.json").read_text())["warnings"]
    remedies = [one.split(": try ")[1].split(",")[0] for one in warnings if " fit best where " in one]
    assert all(one in (maps / "report.html").read_text() for one in remedies)
    return remedies


def error(drive, maps):
    trajectories = (read_tum(path) for path in (drive / "robot_0.truth.tum", maps / "robot_0" / "trajectory.tum"))
    return align_trajectories(*trajectories).ate_m


@pytest.mark.parametrize(
    ("fault", "remedy"),
    [
        ("angle_step", "--angle-step-deg 0.5"),
        ("range_offset", "--range-offset -0.10"),
        ("mount", "--sensor-pose 0.28 0.00 0"),
    ],
)
def test_the_option_that_a_warning_names_mends_it(drive_with, tmp_path, fault, remedy):
    drive = drive_with("--fault", f"{fault}@0+600")
    wrong = build(tmp_path / "wrong", drive / "robot_0.bag")
    assert told(wrong) == [remedy]
    right = build(tmp_path / "right", drive / "robot_0.bag", *remedy.split())
    assert told(right) == []
    assert error(drive, right) < min(0.01, 0.3 * error(drive, wrong))


@pytest.mark.parametrize(
    ("faults", "wrong", "remedy"),
    [
        ((), ("--range-offset", 0.1), "without --range-offset"),
        (("--fault", "range_offset@0+600"), ("--range-offset", 0.1), "--range-offset -0.10"),
        ((), ("--angle-step-deg", 0.515), "--angle-step-deg 0.5"),
    ],
)
def test_wrong_laser_numbers_are_corrected_by_the_warning(drive_with, tmp_path, faults, wrong, remedy):
    """What a warning names is to be passed instead, not on top, and it calls nothing stated that somebody passed."""
    drive = drive_with(*faults)
    maps = build(tmp_path / "wrong", drive / "robot_0.bag", *wrong)
    assert told(maps) == [remedy]
    assert "stated" not in (maps / "robot_0" / "run.json").read_text()
