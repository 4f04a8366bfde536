"""One run of the SLAM over a recording, measured."""

import gc
import itertools
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice

import numpy as np

from datasets import open_recording
from datasets.synthetic.robot.endless_drive import EndlessDrive
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.relations import read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.trajectory_file import read_reference
from tbmslam.map.drive import Drive
from tbmslam.sensing.laser_scan import Reading
from tbmslam.timed_slam import STAGES, TimedSlam
from tools.benchmarks.measured_process import peak_memory_mb
from tools.benchmarks.simulated_recording import RecordingSpec, beside

WARM_UP_SCANS = 20
"""Scans of a recording that are mapped once before."""

_ROUND_M = 130.0  # once around a block and on, so that a loop is closed


def warm_up(config: SlamConfig, readings: Iterable[Reading]) -> None:
    """Map the first scans of a recording, and a short simulated drive that closes a loop, which the first scans do not.

    What lives by then stays, and is not looked through for garbage again, as `tools.command_line.program` has it.
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


_BLOCK = 50  # readings between two looks at the CPU clock: a look costs a microsecond


@dataclass(frozen=True)
class SlamRun:
    """Figures of one run over one recording.

    Parameters
    ----------
    scans, beams, keyframes
        How many; beams of the largest scan.
    duration_s, length_m
        How long and how far the drive was.
    start_s
        CPU time to import and to load compiled code, see `tools.benchmarks.slam_run`; in no other figure.
    reading_s
        CPU time to read the recording.
    mapping_s
        CPU time of everything else. Among it:
    matching_s, inserting_s, finishing_s, closing_s
        To place scans; to learn from them; to make the map at the end; to close loops, a part of finishing.
    wall_s
        Time that passed from the first scan to the map.
    start_memory_mb, peak_memory_mb
        Most memory that the process held until after the warm-up, and in all.
    translation_error_m, rotation_error_deg
        Mean errors against the relations beside the recording; None without.
    ate_m
        Error against the true trajectory beside the recording; None without.
    """

    scans: int
    beams: int
    keyframes: int
    duration_s: float
    length_m: float
    start_s: float
    reading_s: float
    mapping_s: float
    matching_s: float
    inserting_s: float
    finishing_s: float
    closing_s: float
    wall_s: float
    start_memory_mb: float
    peak_memory_mb: float
    translation_error_m: float | None = None
    rotation_error_deg: float | None = None
    ate_m: float | None = None


class CpuClock:
    """Adds up CPU and wall time of this process by activity.

    Attributes
    ----------
    cpu, wall
        Seconds of each activity so far.
    """

    def __init__(self) -> None:
        self.cpu = dict.fromkeys(("reading", "processing", "finishing"), 0.0)
        self.wall = dict(self.cpu)

    @contextmanager
    def during(self, activity: str) -> Iterator[None]:
        """Add what the block takes."""
        cpu, wall = time.process_time(), time.perf_counter()
        yield
        self.cpu[activity] += time.process_time() - cpu
        self.wall[activity] += time.perf_counter() - wall

    def cpu_share(self, activity: str) -> float:
        """Return CPU seconds for each second that passed: less than 1 where others used the processor."""
        return self.cpu[activity] / self.wall[activity] if self.wall[activity] > 0.0 else 1.0


def run_slam(spec: RecordingSpec, preset_name: str) -> SlamRun:
    """Map a recording in this process and measure it.

    Raises
    ------
    TbmSlamError
        When the recording cannot be read or mapped.
    """
    config = preset(preset_name)
    recording = open_recording([spec.path], spec.options)
    warm_up(config, recording)
    start_s, start_memory_mb, began = time.process_time(), peak_memory_mb(), time.perf_counter()
    slam, clock, beams = TimedSlam(config), CpuClock(), 0
    for block in _blocks(recording, clock):
        with clock.during("processing"):
            for reading in block:
                slam.process(reading)
        beams = max(beams, *(len(reading.scan.ranges) for reading in block))
    in_tracker = {stage: slam.clock.seconds[stage] * clock.cpu_share("processing") for stage in STAGES}
    with clock.during("finishing"):
        drive = slam.finish().drives[0]
    trajectory = drive.trajectory
    return SlamRun(
        scans=len(trajectory),
        beams=beams,
        keyframes=len(drive.keyframes),
        duration_s=float(np.ptp(trajectory.stamps)),
        length_m=trajectory.driven(),
        start_s=start_s,
        reading_s=clock.cpu["reading"],
        mapping_s=clock.cpu["processing"] + clock.cpu["finishing"],
        matching_s=in_tracker["matching"],
        inserting_s=in_tracker["inserting"],
        finishing_s=clock.cpu["finishing"],
        closing_s=slam.clock.seconds["closing"] * clock.cpu_share("finishing"),
        wall_s=time.perf_counter() - began,
        start_memory_mb=start_memory_mb,
        peak_memory_mb=peak_memory_mb(),
        **_errors(spec, drive),
    )


def _blocks(readings: Iterable[Reading], clock: CpuClock) -> Iterator[list[Reading]]:
    """Yield the readings some at a time, timed."""
    iterator = iter(readings)
    while True:
        with clock.during("reading"):
            block = list(itertools.islice(iterator, _BLOCK))
        if not block:
            return
        yield block


def _errors(spec: RecordingSpec, drive: Drive) -> dict[str, float | None]:
    """Return the errors against what is known of the truth."""
    trajectory = drive.trajectory
    errors: dict[str, float | None] = {}
    if (path := beside(spec.path, ".relations")) is not None:
        against = relation_errors(read_relations(path), trajectory)
        if len(against.translations_m):
            errors["translation_error_m"] = float(against.translations_m.mean())
            errors["rotation_error_deg"] = float(against.rotations_deg.mean())
    path = beside(spec.path, ".truth.tum") or beside(spec.path, ".gt.laser.poses")
    if path is not None:
        truth = read_reference(path).of_robot(drive.keyframes.mounting())
        errors["ate_m"] = align_trajectories(truth, trajectory).ate_m
    return errors
