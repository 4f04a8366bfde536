"""Robustness of the SLAM: errors of perturbed recordings against the unperturbed one, each run in its own process."""

import argparse
import logging
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from datasets import open_recording
from tbmslam.geometry.se2 import compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.tbm_map import TbmMap
from tbmslam.slam import Slam
from tools.benchmarks.measured_process import MeasurementError, in_fresh_processes
from tools.benchmarks.perturbations import UNPERTURBED, Perturbation, config_with, perturbations
from tools.benchmarks.recordings import DriveErrors, RecordingSpec, drive_errors, truth_beside
from tools.command_line.measurement_record import describe_machine, finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table


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
with a scan that the perturbation removed; they are not counted. ratio: the error in metres divided by the error of the
unperturbed run, over relations that both score. ok: the error is at most 1.1 times the unperturbed error (without
odometry 1.5 times), or at most 3 mm larger. LOST: more than 5 times, or relations are unscored that were scored before.
FAILED: no map. If the truth is a trajectory, its poses and the ATE are scored. With a displaced laser, the recorded
robot frame is scored."""

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
    """Ratio of the error to the error of the unperturbed run, over common scores; None if there are none."""
    verdict: str
    """ok, MISS, LOST or FAILED; a dash for the unperturbed run."""


def benchmark_perturbations(args: argparse.Namespace) -> None:
    """Run the requested benchmarks and print the tables."""
    chosen = perturbations(args.without)
    for setting in args.without:
        config_with(setting)
    for spec in args.recordings:
        truth_beside(spec.path)
    tasks = [(spec, perturbation) for spec in args.recordings for perturbation in chosen]
    answers: dict[int, DriveErrors | MeasurementError] = {}
    for index, answer in in_fresh_processes(run_perturbed, tasks, args.jobs):
        answers[index] = answer
        spec, perturbation = tasks[index]
        say(f"benchmark: {len(answers)}/{len(tasks)} {spec.path.name} {perturbation.name}")
        if perturbation is UNPERTURBED and isinstance(answer, MeasurementError):
            raise answer
    record: list[dict[str, Any]] = []
    tables: dict[str, ResultTable] = {}
    for begin, spec in zip(range(0, len(tasks), len(chosen)), args.recordings, strict=True):
        scores = _scores(chosen, [answers[begin + index] for index in range(len(chosen))])
        unperturbed = answers[begin]
        is_ate = isinstance(unperturbed, DriveErrors) and unperturbed.kind == "poses"
        name = spec.path.name.removesuffix(".bag")
        tables[name] = _table(scores, "ATE m" if is_ate else "mean error m")
        print(f"{name}\n{text_table(*tables[name])}\n{name}: {summary(scores)}\n")
        record.append({"recording": name, "kind": "poses" if is_ate else "relations", "scores": scores})
    print(NOTES)
    every = [score for entry in record for score in entry["scores"]]
    print(summary(every))
    overview = ResultTable.of([_overview(entry["recording"], entry["scores"]) for entry in record])
    finish(args, describe_machine(), {"overview": overview, **tables}, {"recordings": record})


def score(perturbation: Perturbation, errors: DriveErrors | MeasurementError, unperturbed: DriveErrors) -> Score:
    """Compare a run with the unperturbed run."""
    if isinstance(errors, MeasurementError):
        return Score(perturbation.name, None, None, 0, 0, None, f"FAILED: {errors}")
    counted = np.ones(len(errors.metres), dtype=np.bool_)
    if errors.kind == "poses":  # some true poses may lie between the scans
        counted = unperturbed.has_scans
    left_out = counted & unperturbed.has_scans & ~errors.has_scans
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


def _scores(chosen: Sequence[Perturbation], answers: Sequence[DriveErrors | MeasurementError]) -> list[Score]:
    unperturbed = answers[0]
    if isinstance(unperturbed, MeasurementError):
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
