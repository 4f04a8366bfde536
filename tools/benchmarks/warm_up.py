"""What a process does before its clocks start: compiled code is loaded when it is used for the first time."""

import gc
from collections.abc import Iterable
from itertools import islice

from datasets.synthetic.robot.endless_drive import EndlessDrive
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.odometry_noise import OdometryNoise
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.sensing.laser_scan import Reading
from tbmslam.timed_slam import TimedSlam

WARM_UP_SCANS = 20
"""Scans of a recording that are mapped once before."""

_ROUND_M = 130.0  # once around a block and on, so that a loop is closed


def warm_up(config: SlamConfig, readings: Iterable[Reading]) -> None:
    """Map the first scans of a recording, and a short simulated drive that closes a loop, which the first scans do not.

    What lives by then stays, and is not looked through for garbage again, as `tools.command_line.loading` has it.
    """
    angle_min, angle_increment = SimulatedLaser.field_of(91)
    laser = SimulatedLaser(beams=91, angle_min=angle_min, angle_increment=angle_increment, rate=2.0)
    drive = EndlessDrive("round", _ROUND_M, laser, OdometryNoise.preset("poor"))
    for each in (islice(readings, WARM_UP_SCANS), drive.readings()):
        slam = TimedSlam(config)
        for reading in each:
            slam.process(reading)
        slam.finish()
    gc.freeze()
