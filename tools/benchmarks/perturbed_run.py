"""One run of the SLAM over a perturbed recording."""

import logging
from array import array
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from datasets import open_recording
from tbmslam.configuration.parameters import changed, parse_setting
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.tbm_map import TbmMap
from tbmslam.slam import Slam
from tools.benchmarks.drive_errors import DriveErrors, drive_errors, truth_beside
from tools.benchmarks.perturbation import Perturbation
from tools.benchmarks.simulated_recording import RecordingSpec


def config_with(setting: str | None) -> SlamConfig:
    """Return the default configuration, with one parameter changed where a setting is given, as ``map.resolution=0.1``.

    Raises
    ------
    ConfigError
        There is no such parameter, or it cannot have this value.
    """
    config = SlamConfig()
    return config if setting is None else changed(config, parse_setting(setting), "--without")


def run_perturbed(spec: RecordingSpec, perturbation: Perturbation) -> DriveErrors:
    """Map a perturbed recording in this process and compare it with the truth beside it.

    Raises
    ------
    TbmSlamError
        When the recording cannot be read or mapped, or nothing is known of the truth.
    """
    truth = truth_beside(spec.path)
    slam, stamps = Slam(config_with(perturbation.setting)), array("d")
    with _without_warnings():
        for reading in perturbation.change(open_recording([spec.path], spec.options)):
            slam.process(reading)
            stamps.append(reading.scan.stamp)
        maps = [slam.finish()]
    return drive_errors(truth, [poses_of(tbm_map, perturbation) for tbm_map in maps], np.array(stamps))


def poses_of(tbm_map: TbmMap, perturbation: Perturbation) -> Trajectory:
    """Return the poses of all drives of a map, as the robot is in the unperturbed recording."""
    trajectories = [drive.trajectory for drive in tbm_map.drives]
    stamps = np.concatenate([np.zeros(0), *(one.stamps for one in trajectories)])
    poses = np.concatenate([np.zeros((0, 3)), *(one.poses for one in trajectories)])
    return Trajectory(stamps, compose(poses, np.broadcast_to(perturbation.T_stated_true, poses.shape)))


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Keep warnings to itself for a block: runs side by side warn of what was done to the recording on purpose."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)
