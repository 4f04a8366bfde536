"""How brittle the SLAM is: each recording as it is and perturbed, each run in a process of its own."""

import argparse
import dataclasses
import json
import logging
import sys
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from datasets import open_recording
from tbmslam.configuration.parameters import changed, parse_setting
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text
from tbmslam.map.tbm_map import TbmMap
from tbmslam.slam import Slam
from tools.benchmarks.drive_errors import DriveErrors, drive_errors, truth_beside
from tools.benchmarks.measured_process import MeasurementError, in_fresh_processes
from tools.benchmarks.perturbation import UNPERTURBED, Perturbation, perturbations
from tools.benchmarks.result_table import ResultTable, write_tables
from tools.benchmarks.simulated_recording import RecordingSpec
from tools.command_line.text_table import describe_machine, number, text_table


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
    stamps = np.concatenate([np.zeros(0), *(trajectory.stamps for trajectory in trajectories)])
    poses = np.concatenate([np.zeros((0, 3)), *(trajectory.poses for trajectory in trajectories)])
    return Trajectory(stamps, compose(poses, np.broadcast_to(perturbation.T_stated_true, poses.shape)))


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Keep warnings to itself for a block: runs side by side warn of what was done to the recording on purpose."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


OVERVIEW_HEAD = ("recording", "error m", "perturbed runs", "misses", "lost or failed", "worst ratio")

NOTES = """\
mean error m, deg: of the relations that the run scores. unscored: relations that it cannot score, since a scan is not
in the map or the two lie in maps that are not in one frame. left out: relations of scans that the perturbation took
away; they count nowhere. ratio: the error in metres over that of the recording as it is, of those of the same relations
that were scored there. ok: at most 1.1 times that error (without odometry 1.5 times) or 3 mm more. LOST: more than that
and than 5 times, or relations unscored that were scored before. FAILED: no map. Where the truth is a trajectory, the
same holds for its poses and the ATE. A laser that is stated elsewhere is scored by where the laser was."""

_MORE_M = 0.003
_LOST_RATIO = 5.0


@dataclass(frozen=True)
class Score:
    """What a perturbation did to the error.

    Parameters
    ----------
    perturbation
        Its name.
    error_m, error_deg
        Of all that the run scores; None if that is nothing.
    unscored
        Relations or poses that cannot be scored though their scans were given.
    left_out
        Those whose scans the perturbation took away.
    ratio
        Of the error to that of the unperturbed run where both score; None if that is nowhere.
    verdict
        ok, MISS, LOST or FAILED; a dash for the recording as it is.
    """

    perturbation: str
    error_m: float | None
    error_deg: float | None
    unscored: int
    left_out: int
    ratio: float | None
    verdict: str

    def is_miss(self) -> bool:
        """Return whether it did too much."""
        return self.verdict not in ("ok", "-")


def benchmark_perturbations(args: argparse.Namespace) -> None:
    """Run what the arguments ask for and print the tables."""
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
        sys.stderr.write(f"benchmark: {len(answers)}/{len(tasks)} {spec.path.name} {perturbation.name}\n")
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
    overview = ResultTable(OVERVIEW_HEAD, [_overview(entry["recording"], entry["scores"]) for entry in record])
    write_tables(args.table, describe_machine(), {"overview": overview, **tables})
    if args.json:
        write_text(args.json, json.dumps(record, indent=2, default=dataclasses.asdict) + "\n")


def score(perturbation: Perturbation, errors: DriveErrors | MeasurementError, unperturbed: DriveErrors) -> Score:
    """Hold a run against the run over the recording as it is."""
    if isinstance(errors, MeasurementError):
        return Score(perturbation.name, None, None, 0, 0, None, f"FAILED: {errors}")
    counted = np.ones(len(errors.metres), dtype=np.bool_)
    if errors.kind == "poses":  # of which there may be some between the scans
        counted = unperturbed.has_scans
    left_out = counted & unperturbed.has_scans & ~errors.has_scans
    unscored = counted & ~left_out & ~errors.scored()
    scored = errors.scored() & ~left_out
    # What only this run scores counts, too: parts that were not in one map before may now be in a torn one.
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
        perturbation.name,
        error_m,
        errors.error_deg(scored),
        int(unscored.sum()),
        int(left_out.sum()),
        ratio,
        verdict,
    )


def summary(scores: Sequence[Score]) -> str:
    """Return one line on how many perturbations did too much."""
    perturbed = [row for row in scores if row.verdict != "-"]
    misses = [row for row in perturbed if row.is_miss()]
    lost = sum(row.verdict != "MISS" for row in misses)
    return f"{len(perturbed)} perturbed runs, {len(misses)} misses, {lost} of them lost or failed"


def _scores(chosen: Sequence[Perturbation], answers: Sequence[DriveErrors | MeasurementError]) -> list[Score]:
    unperturbed = answers[0]
    if isinstance(unperturbed, MeasurementError):
        raise unperturbed
    return [score(row, errors, unperturbed) for row, errors in zip(chosen, answers, strict=True)]


def _overview(name: str, scores: Sequence[Score]) -> list[str]:
    """Return a row on a recording: its error as it is, and what became of it perturbed."""
    perturbed = [row for row in scores if row.verdict != "-"]
    misses = [row for row in perturbed if row.is_miss()]
    lost = sum(row.verdict != "MISS" for row in misses)
    worst = max((row.ratio for row in perturbed if row.ratio is not None), default=None)
    counts = (len(perturbed), len(misses), lost)
    return [name, number(scores[0].error_m, 4), *map(str, counts), number(worst, 2)]


def _table(scores: Sequence[Score], measure: str) -> ResultTable:
    head = ("perturbation", measure, "mean error deg", "unscored", "left out", "ratio", "verdict")
    rows = [
        [
            row.perturbation,
            number(row.error_m, 4),
            number(row.error_deg, 3),
            str(row.unscored),
            str(row.left_out),
            number(row.ratio, 2),
            row.verdict,
        ]
        for row in scores
    ]
    return ResultTable(head, rows)
