"""Robustness of the SLAM: errors of perturbed recordings against the unperturbed one, each run in its own process."""

import argparse
import logging
import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import dropwhile
from typing import Any, TypeAlias

import numpy as np

from datasets import open_recording
from tbmslam.configuration.parameters import changed, parse_setting
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor
from tbmslam.sensing.laser_scan import Reading
from tbmslam.slam import Slam
from tools.benchmarks.measured_process import in_fresh_process
from tools.benchmarks.recordings import DriveErrors, RecordingSpec, drive_errors, truth_beside
from tools.command_line.measurement_record import finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table

Change: TypeAlias = Callable[[Iterable[Reading]], Iterator[Reading]]

_SEED = 0
_ANGLE_STEP = 0.003  # share of the angle step; 180 / 179 degrees, which converters wrote, differ by twice as much
_ODOMETRY_SCALE = 0.05  # share of the distance
_LATER_S = 30.0
_DROPPED = 0.05  # share of the scans
_RANGE_NOISE_M = 0.01
_MOUNT_M = 0.04
_REVERSED_S, _REVERSED_EVERY_S = 4.0, 60.0
_USUAL_RATIO, _WITHOUT_ODOMETRY_RATIO = 1.1, 1.5


@dataclass(frozen=True)
class Perturbation:
    """A perturbation of a recording or of a parameter."""

    name: str
    change: Change = iter
    """Perturbs the readings; may be pickled."""
    setting: str | None = None
    """A changed parameter of the SLAM, as ``map.resolution=0.1``; None for none."""
    ratio: float = _USUAL_RATIO
    """Largest ratio of the error to the unperturbed error."""
    T_stated_true: SE2 = SE2(0.0, 0.0, 0.0)  # noqa: RUF009 - an immutable tuple
    """Pose of the recorded robot frame in the perturbed robot frame; the truth is of the recorded frame."""


UNPERTURBED = Perturbation("as it is")


def perturbations(settings: Iterable[str] = ()) -> list[Perturbation]:
    """Return all perturbations, the unperturbed recording first."""
    mounts = [(axis, sign * _MOUNT_M) for axis in "xy" for sign in (1, -1)]
    return [
        UNPERTURBED,
        *(_share("angle step", with_angle_step, sign * _ANGLE_STEP) for sign in (1, -1)),
        *(_share("odometry scaled by", with_odometry_scaled, sign * _ODOMETRY_SCALE) for sign in (1, -1)),
        Perturbation("without odometry", without_odometry, ratio=_WITHOUT_ODOMETRY_RATIO),
        Perturbation(f"begun {_LATER_S:g} s later", begun_later),
        Perturbation(f"{100.0 * _DROPPED:g} % of scans dropped", with_scans_dropped),
        Perturbation(f"{100.0 * _RANGE_NOISE_M:g} cm of range noise", with_range_noise),
        *(_mounted(axis, offset) for axis, offset in mounts),
        Perturbation(f"odometry reversed {_REVERSED_S:g} of {_REVERSED_EVERY_S:g} s", with_odometry_reversed),
        *(Perturbation(setting, setting=setting) for setting in settings),
    ]


def with_angle_step(readings: Iterable[Reading], factor: float) -> Iterator[Reading]:
    """Yield readings with another angle step; the first beam keeps its direction, as with --angle-step-deg."""
    for reading in readings:
        scan = reading.scan
        yield reading.with_scan(replace(scan, angle_increment=factor * scan.angle_increment))


def with_odometry_scaled(readings: Iterable[Reading], factor: float) -> Iterator[Reading]:
    """Yield readings with scaled odometry."""
    for reading in readings:
        poses = (reading.T_odom_robot, reading.T_odom_swept)
        before, after = (pose and SE2(factor * pose.x, factor * pose.y, pose.theta) for pose in poses)
        yield replace(reading, T_odom_robot=before, T_odom_swept=after)


def without_odometry(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Yield readings without odometry."""
    for reading in readings:
        yield replace(reading, T_odom_robot=None, T_odom_swept=None)


def begun_later(readings: Iterable[Reading], seconds: float = _LATER_S) -> Iterator[Reading]:
    """Yield the readings without the first seconds of the recording."""
    iterator = iter(readings)
    first = next(iterator, None)
    if first is not None:
        begin = first.scan.stamp + seconds
        yield from dropwhile(lambda reading: reading.scan.stamp < begin, iterator)


def with_scans_dropped(readings: Iterable[Reading], share: float = _DROPPED) -> Iterator[Reading]:
    """Yield readings without a random share."""
    rng = np.random.default_rng(_SEED)
    return (reading for reading in readings if rng.random() >= share)


def with_range_noise(readings: Iterable[Reading], deviation: float = _RANGE_NOISE_M) -> Iterator[Reading]:
    """Yield readings with Gaussian noise on every measured range, limited to positive ranges."""
    rng = np.random.default_rng(_SEED)
    for reading in readings:
        ranges = reading.scan.ranges
        noisy = np.maximum(ranges + rng.normal(0.0, deviation, len(ranges)), 0.0)  # nan and inf stay
        yield reading.with_scan(reading.scan.with_ranges(noisy))


def with_laser_moved(readings: Iterable[Reading], x: float, y: float) -> Iterator[Reading]:
    """Yield readings with a displaced mount of the laser [m]."""
    T_stated_true = SE2(x, y, 0.0)
    for reading in readings:
        yield replace(reading, T_robot_sensor=T_stated_true @ reading.T_robot_sensor)


def with_odometry_reversed(
    readings: Iterable[Reading], seconds: float = _REVERSED_S, every: float = _REVERSED_EVERY_S, since: float = 0.0
) -> Iterator[Reading]:
    """Yield readings whose odometry has the wrong sign of translation for some seconds at the end of every period.

    The first period began `since` seconds before the first reading.
    """
    begin, before, reported = math.nan, SE2.identity(), SE2.identity()
    for reading in readings:
        pose = reading.T_odom_robot
        if pose is None:
            yield reading
            continue
        if math.isnan(begin):
            begin, before, reported = reading.scan.stamp - since, pose, pose
        is_wrong = (reading.scan.stamp - begin) % every >= every - seconds
        reported, before = reported @ _reversed(before.to(pose), is_wrong), pose
        swept = reading.T_odom_swept and reported @ _reversed(pose.to(reading.T_odom_swept), is_wrong)
        yield replace(reading, T_odom_robot=reported, T_odom_swept=swept)


def _reversed(motion: SE2, is_wrong: bool) -> SE2:
    return SE2(-motion.x, -motion.y, motion.theta) if is_wrong else motion


def _share(name: str, change: Callable[..., Iterator[Reading]], share: float) -> Perturbation:
    return Perturbation(f"{name} {100.0 * share:+g} %", partial(change, factor=1.0 + share))


def _mounted(axis: str, offset: float) -> Perturbation:
    x, y = (offset if axis == name else 0.0 for name in "xy")
    return Perturbation(
        f"laser {100.0 * offset:+g} cm in {axis}", partial(with_laser_moved, x=x, y=y), T_stated_true=SE2(x, y, 0.0)
    )


def config_with(setting: str | None) -> SlamConfig:
    """Return the default configuration, with one parameter changed by a setting as ``map.resolution=0.1``."""
    config = SlamConfig()
    return config if setting is None else changed(config, parse_setting(setting), "--without")


def errors_of(spec: RecordingSpec, perturbation: Perturbation) -> DriveErrors:
    """Return the errors of `run_perturbed` in a process of its own, whose end does not stop other runs."""
    try:
        return in_fresh_process(run_perturbed, spec, perturbation)
    except MemoryError as error:
        raise TbmSlamError("memory has run out") from error


def run_perturbed(spec: RecordingSpec, perturbation: Perturbation) -> DriveErrors:
    """Map a perturbed recording in this process and compare it with the truth beside it."""
    truth = truth_beside(spec.path)
    slam, stamps = Slam(config_with(perturbation.setting)), array("d")
    with _without_warnings():
        for reading in perturbation.change(open_recording([spec.path], spec.options)):
            slam.process(reading)
            stamps.append(reading.scan.stamp)
        tbm_map = slam.finish()
    return drive_errors(truth, poses_of(tbm_map, perturbation), np.array(stamps))


def poses_of(tbm_map: TbmMap, perturbation: Perturbation) -> Trajectory:
    """Return the poses of all drives of a map in the robot frame of the unperturbed recording."""
    trajectories = [drive.trajectory for drive in tbm_map.drives]
    stamps = np.concatenate([np.zeros(0), *(trajectory.stamps for trajectory in trajectories)])
    poses = np.concatenate([np.zeros((0, 3)), *(trajectory.poses for trajectory in trajectories)])
    return Trajectory(stamps, compose(poses, np.broadcast_to(perturbation.T_stated_true, poses.shape)))


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Disable warnings, which are about the perturbations."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


NOTES = """\
mean error m, deg: of the scored relations. unscored: relations with a scan that is not in the map. left out: relations
with a scan that the perturbation removed; they are not counted. ratio: the error of all relations that the run scores,
divided by the unperturbed error of those that both runs score. ok: the error is at most 1.1 times the unperturbed error
(without odometry 1.5 times), or at most 3 mm larger. LOST: more than 5 times, or relations are unscored that were
scored before. FAILED: no map. If the truth is a trajectory, its poses and the ATE are scored. With a displaced laser,
the recorded robot frame is scored."""

_MORE_M = 0.003
_LOST_RATIO = 5.0


@dataclass(frozen=True)
class Score:
    """The error of a perturbed run."""

    perturbation: str
    error_m: float | None
    error_deg: float | None
    """Errors of all scored relations or poses; None if there are none."""
    unscored: int
    """Number of relations or poses that are not scored although their scans were given."""
    left_out: int
    """Number of relations or poses whose scans the perturbation removed."""
    ratio: float | None
    """Error of all that the run scores, divided by the unperturbed error of what both score; None without scores."""
    verdict: str
    """ok, MISS, LOST or FAILED; a dash for the unperturbed run."""


def benchmark_perturbations(args: argparse.Namespace) -> None:
    """Run the requested benchmarks and print the tables."""
    chosen = perturbations(args.without)
    for setting in args.without:
        config_with(setting)
    for spec in args.recordings:
        truth_beside(spec.path)
    # All unperturbed runs come first: the failure of one ends the benchmark.
    tasks = [(spec, perturbation) for perturbation in chosen for spec in args.recordings]
    calls = [Call(f"{index}", errors_of, task) for index, task in enumerate(tasks)]
    answers: list[DriveErrors | TbmSlamError] = []
    with closing(Executor(args.jobs).outcomes(calls)) as outcomes:
        for (spec, perturbation), answer in zip(tasks, outcomes, strict=True):
            answers.append(answer)
            say(f"benchmark: {len(answers)}/{len(tasks)} {spec.path.name} {perturbation.name}")
            if perturbation is UNPERTURBED and isinstance(answer, TbmSlamError):
                raise answer
    record: list[dict[str, Any]] = []
    tables: dict[str, ResultTable] = {}
    for index, spec in enumerate(args.recordings):
        scores = _scores(chosen, answers[index :: len(args.recordings)])
        unperturbed = answers[index]
        is_ate = isinstance(unperturbed, DriveErrors) and unperturbed.kind == "poses"
        name = spec.name
        tables[name] = _table(scores, "ATE m" if is_ate else "mean error m")
        print(f"{name}\n{text_table(*tables[name])}\n{name}: {summary(scores)}\n")
        record.append({"recording": name, "kind": "poses" if is_ate else "relations", "scores": scores})
    print(NOTES)
    every = [score for entry in record for score in entry["scores"]]
    print(summary(every))
    overview = ResultTable.of([_overview(entry["recording"], entry["scores"]) for entry in record])
    finish(args, {"overview": overview, **tables}, {"recordings": record})


def score(perturbation: Perturbation, errors: DriveErrors | TbmSlamError, unperturbed: DriveErrors) -> Score:
    """Compare a run with the unperturbed run."""
    if isinstance(errors, TbmSlamError):
        return Score(perturbation.name, None, None, 0, 0, None, f"FAILED: {errors}")
    left_out = unperturbed.has_scans & ~errors.has_scans
    # Some true poses may lie between the scans.
    counted = unperturbed.has_scans if errors.kind == "poses" else np.ones_like(left_out)
    unscored = counted & ~left_out & ~errors.scored()
    scored = errors.scored() & ~left_out
    # Relations that only this run scores count too: its map may be torn there.
    error_m, before_m = errors.error_m(scored), unperturbed.error_m(scored & unperturbed.scored())
    ratio = error_m / before_m if error_m is not None and before_m else None
    if perturbation is UNPERTURBED:
        verdict = "-"
    elif error_m is None or before_m is None or (unscored & unperturbed.scored()).any():
        verdict = "LOST"
    elif error_m <= max(perturbation.ratio * before_m, before_m + _MORE_M):
        verdict = "ok"
    else:
        verdict = "LOST" if error_m > _LOST_RATIO * before_m else "MISS"
    return Score(
        perturbation.name, error_m, errors.error_deg(scored), int(unscored.sum()), int(left_out.sum()), ratio, verdict
    )


def summary(scores: Sequence[Score]) -> str:
    """Return one line with the numbers of runs, misses and lost runs."""
    perturbed, misses, lost = _counts(scores)
    return f"{perturbed} perturbed runs, {misses} misses, {lost} of them lost or failed"


def _counts(scores: Sequence[Score]) -> tuple[int, int, int]:
    """Return the numbers of perturbed runs, of misses, and of those that are lost or failed."""
    verdicts = [row.verdict for row in scores if row.verdict != "-"]
    misses = [verdict for verdict in verdicts if verdict != "ok"]
    return len(verdicts), len(misses), sum(verdict != "MISS" for verdict in misses)


def _scores(chosen: Sequence[Perturbation], answers: Sequence[DriveErrors | TbmSlamError]) -> list[Score]:
    unperturbed = answers[0]
    if isinstance(unperturbed, TbmSlamError):
        raise unperturbed
    return [score(row, errors, unperturbed) for row, errors in zip(chosen, answers, strict=True)]


def _overview(name: str, scores: Sequence[Score]) -> dict[str, str]:
    """Return the row of a recording: its unperturbed error, and the numbers of misses."""
    worst = max((row.ratio for row in scores[1:] if row.ratio is not None), default=None)
    perturbed, misses, lost = _counts(scores)
    return {
        "recording": name,
        "error m": number(scores[0].error_m, 4),
        "perturbed runs": str(perturbed),
        "misses": str(misses),
        "lost or failed": str(lost),
        "worst ratio": number(worst, 2),
    }


def _table(scores: Sequence[Score], measure: str) -> ResultTable:
    return ResultTable.of(
        [
            {
                "perturbation": row.perturbation,
                measure: number(row.error_m, 4),
                "mean error deg": number(row.error_deg, 3),
                "unscored": str(row.unscored),
                "left out": str(row.left_out),
                "ratio": number(row.ratio, 2),
                "verdict": row.verdict,
            }
            for row in scores
        ]
    )
