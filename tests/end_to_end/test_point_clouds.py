"""A lidar of sixteen rings instead of a laser: as good a map, and one line where its clouds hold no walls."""

import json
import math

import pytest

from datasets import RecordingOptions, open_recording
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.trajectory_file import read_tum
from tests.end_to_end.programs import build, simulate
from tools import build_maps

# One worker simulates the clouds for all of them.
pytestmark = pytest.mark.xdist_group("point_clouds")

DRIVE = ("--world", "apartment", "--beams", 720, "--rate", 10, "--duration", 30, "--sweep", 0.09)


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("clouds"), *DRIVE, "--rings", 16)


def ate(bags, maps):
    return align_trajectories(read_tum(bags / "robot_0.truth.tum"), read_tum(maps / "robot_0" / "trajectory.tum")).ate_m


def test_a_lidar_is_mapped_as_well_as_a_laser(clouds, tmp_path):
    scans = simulate(tmp_path / "scans", *DRIVE)
    maps = build(tmp_path / "maps", clouds / "robot_0.bag")
    laser = ate(scans, build(tmp_path / "laser", scans / "robot_0.bag"))
    assert laser < 0.0018  # 0.00162 m is reached
    assert ate(clouds, maps) < 0.00173  # 0.00154 m
    recording = json.loads((maps / "robot_0" / "run.json").read_text())["recording"]
    assert (recording["scan_topic"], recording["cloud_heights_m"]) == (
        "/points",
        [pytest.approx(0.35), pytest.approx(0.85)],
    )
    assert recording["T_robot_sensor"] == pytest.approx([0.275, 0.0, 0.0])
    assert recording["first_scan"]["angle_step_deg"] == pytest.approx(0.5)
    assert recording["first_scan"]["time_increment_s"] == pytest.approx(0.09 / 719, rel=0.01)


@pytest.mark.parametrize(("heights", "opening"), [(None, math.tan(math.radians(1.0))), ((0.35, 0.85), 0.0)])
def test_the_slice_is_described(clouds, heights, opening):
    found = open_recording([clouds / "robot_0.bag"], RecordingOptions(cloud_heights=heights)).description
    assert found["cloud_heights_m"] == [pytest.approx(0.35), pytest.approx(0.85)]
    assert found["cloud_opening"] == pytest.approx(opening)


@pytest.mark.slow
@pytest.mark.parametrize("more", [("--format", "mcap"), ("--upside-down",), ("--mount", -0.2, 0.1, 120)])
def test_however_it_is_recorded_and_mounted(tmp_path, more):
    bags = simulate(tmp_path / "bags", *DRIVE, "--rings", 16, *more)
    bag = bags / ("robot_0" if "mcap" in more else "robot_0.bag")
    assert ate(bags, build(tmp_path / "maps", bag)) < 0.004


def test_clouds_without_walls_at_the_stated_heights_are_refused(clouds, tmp_path, capsys):
    words = [str(clouds / "robot_0.bag"), "-o", str(tmp_path / "maps"), "--cloud-heights", "3", "4"]
    assert build_maps.main(words) == 1
    said = capsys.readouterr().err
    assert ".bag: the clouds of /points hold hardly any point between 3.00 and 4.00 m above the robot's frame" in said
