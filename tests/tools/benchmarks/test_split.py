import json
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tools import benchmark, make_world
from tools.benchmarks.split import overlap_share, pose_by_drives


def free_square(side):
    masses = np.zeros((side, side, 4), dtype=np.float32)
    masses[..., 1] = 1.0
    return TbmMap(TbmGrid(GridGeometry(0.1, 0.0, 0.0, side, side), masses))


@pytest.mark.parametrize(("shift", "share"), [(0.0, 1.0), (1.0, 1.0), (1.5, 0.5), (9.0, 0.0)])
def test_the_share_is_that_of_the_smaller_map(shift, share):
    large, small = free_square(20), free_square(10)
    assert overlap_share(large, small, SE2(shift, 0.0, 0.0)) == pytest.approx(share, abs=0.02)
    assert overlap_share(small, large, SE2(-shift, 0.0, 0.0)) == pytest.approx(share, abs=0.02)


def driven(*ways):
    """A map of robots who drove these ways."""
    drives = [Drive(f"robot_{k}", way, Keyframes.from_scans([], [], [])) for k, way in enumerate(ways)]
    return replace(free_square(2), drives=tuple(drives))


def test_robots_are_matched_with_the_whole_drive_if_stamps_step_back():
    stamps = np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 5.0])
    poses = np.column_stack((np.arange(11.0), np.arange(11.0) ** 2, np.zeros(11)))
    whole, parts = Trajectory(stamps, poses), [slice(0, 7), slice(4, 11)]
    T_whole_merged = SE2(3.0, -2.0, 0.7)
    merged = driven(*(Trajectory(stamps[p], poses[p]).transformed(T_whole_merged.inverse()) for p in parts))
    assert pose_by_drives(driven(whole), merged) == pytest.approx(T_whole_merged, abs=1e-9)
    with pytest.raises(TbmSlamError, match="the merged map and the map of the whole recording have no common"):
        pose_by_drives(driven(whole), driven(Trajectory(stamps + 100.0, poses)))


@pytest.mark.slow
def test_a_recording_is_cut_and_merged_again(tmp_path, capsys):
    world = ["--world", "office", "--seed", "2", "--beams", "361", "--rate", "10", "--length", "120"]
    assert make_world.main([*world, "-o", str(tmp_path)]) == 0
    capsys.readouterr()
    figures = tmp_path / "figures.json"
    bag = f"{tmp_path / 'robot_0.bag'},odometry=tf"
    assert benchmark.main(["split", bag, "--robots", "2", "--json", str(figures)]) == 0
    said = capsys.readouterr().out
    assert "| robot_0   |" in said
    (run,) = json.loads(figures.read_text())["runs"]
    assert run["merged"] == ["robot_0_0", "robot_0_1"]
    repeated = f"robot_0, 2 robots: truth.json {run['truth_doubt']}"
    assert (repeated in said) is (run["truth_doubt"] is not None)
    for _, _, shared, (metres, degrees) in run["pairs"]:
        assert 0.25 <= shared <= 1.0
        assert metres < 0.2
        assert degrees < 1.0
    assert 0.9 < run["agree"] <= run["agree_nearby"] <= 1.0
    assert 0.9 < run["turned"] <= 1.0
    assert 0.9 < run["again"] <= 1.0


def test_a_recording_that_is_not_there_is_one_line(tmp_path, capsys):
    assert benchmark.main(["split", str(tmp_path / "none.bag"), "--robots", "2"]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("benchmark: ")
    assert "none.bag" in error


def test_less_than_two_robots_are_no_split(usage_error):
    assert "--robots: must be a whole number within 2 and 10000, got '1'" in usage_error(
        benchmark.main, ["split", "x.bag", "--robots", "1,2"]
    )
