import math

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.configuration.parameters import ConfigError
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.tum import read_tum
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tools.benchmarks.perturbation import UNPERTURBED, perturbations
from tools.benchmarks.perturbed_run import config_with, poses_of, run_perturbed
from tools.benchmarks.simulated_recording import SimulatedRecording


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


def test_a_setting_changes_one_parameter():
    assert config_with(None) == config_with("map.resolution=0.05")
    assert config_with("map.resolution=0.1").map.resolution == 0.1
    with pytest.raises(ConfigError, match=r"--without: there is no parameter 'map\.size'"):
        config_with("map.size=3")
