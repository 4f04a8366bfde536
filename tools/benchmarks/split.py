"""Recordings cut into robots, mapped and merged: errors of the poses, and agreement with the undivided map."""

import argparse
import contextlib
import io
import itertools
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from merging import merge
from merging.joint_slam import redraw
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import FREE
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.map_agreement import MapAgreement, cell_labels, map_agreement, refine_map_transform
from tbmslam.evaluation.relations import matching_poses
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_folder import load_map
from tbmslam.map.tbm_map import TbmMap
from tools import build_maps
from tools.benchmarks.measured_process import in_fresh_process
from tools.benchmarks.recordings import as_words
from tools.command_line.measurement_record import finish
from tools.command_line.paths import map_folders
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table
from tools.map_pairs.known_pair import KnownPair
from tools.mapping.truth_file import NAME as TRUTH_FILE
from tools.mapping.truth_file import read_truth_file

NOTES = """\
Each recording is cut into robots with random frames, and their maps are merged. pairs: pairs that share a
quarter of the smaller map's free space or more. near enough: pairs whose relative pose is within 0.2 m, in the middle
of the second map, and 1 degree of truth.json. as undivided: share of equal cells, of the cells known to the merged map
and to the map of the whole recording; or beside: a neighbouring cell counts too. undivided turned: the same for the
undivided map and its rendering on the merged map's cells. undivided again: the same for the undivided map and a map of
the whole recording in the frame of the odometry, with other cells."""

_SHARED = 0.25
_SAME_MOMENT_S = 1e-3
_NEAR_M, _NEAR_DEG = 0.2, 1.0


@dataclass(frozen=True)
class SplitRun:
    """The result of one recording and one number of robots."""

    recording: str
    robots: int
    merged: tuple[str, ...]
    left_out: Mapping[str, str]
    """The other robots, with the reasons."""
    pairs: tuple[tuple[str, str, float, tuple[float, float] | None], ...]
    """For each pair with enough overlap, its names, the overlap as a share of the smaller map's free space, and the
    error of its relative pose [m], [deg]; None if one was left out."""
    agree: float | None
    agree_nearby: float | None
    """Shares of cells that are as in the undivided map, see `tbmslam.evaluation.map_agreement`; None if nothing was
    merged."""
    turned: float | None
    """The share for the undivided map, resampled on the merged map's cells."""
    again: float
    """The share for a second map of the whole recording, in the odometry's frame."""
    merge_cpu_s: float
    truth_doubt: str | None = None
    """The reason to doubt truth.json; None if there is none."""


def benchmark_split(args: argparse.Namespace) -> None:
    """Run the benchmark and print the table."""
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        for number, spec in enumerate(args.recordings):
            parts = Path(folder) / str(number)
            in_fresh_process(cut, spec.text, 1, parts / "1")
            in_fresh_process(cut, f"{spec.text},frames=odometry", 1, parts / "again")
            (whole,), (whole_again,) = map_folders(parts / "1"), map_folders(parts / "again")
            again = in_fresh_process(agreement_of, whole_again, whole)
            for robots in args.robots:
                say(f"benchmark: {spec.text}, {robots} robots")
                in_fresh_process(cut, spec.text, robots, parts / str(robots))
                runs.append(in_fresh_process(run_split, spec.name, parts / str(robots), whole, again))
    table = ResultTable.of([_row(run) for run in runs])
    print(text_table(*table))
    for run in runs:
        for name, reason in run.left_out.items():
            print(f"{run.recording}, {run.robots} robots: {name} was left out: {reason}")
        if run.truth_doubt is not None:
            print(f"{run.recording}, {run.robots} robots: {TRUTH_FILE} {run.truth_doubt}")
    print(NOTES)
    finish(args, {"robots": table}, {"runs": runs})


def cut(text: str, robots: int, out: Path) -> None:
    """Cut a recording into robots and map each."""
    path, *settings = text.split(",")
    printed = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(printed):
        code = build_maps.main([path, *as_words(settings), "--robots", str(robots), "-o", str(out)])
    if code != 0:
        raise TbmSlamError(printed.getvalue().strip().splitlines()[-1])


def agreement_of(again: Path, undivided: Path) -> float:
    """Return the share of cells in which two maps of the whole recording agree."""
    return _agreements(load_map(again), load_map(undivided))[0].agree


def run_split(name: str, folder: Path, undivided: Path, again: float) -> SplitRun:
    """Merge the maps of a folder, and compare the result with truth.json and an undivided map; see `SplitRun`."""
    truth = read_truth_file(folder / TRUTH_FILE)
    poses = truth.poses
    maps = {name: load_map(folder / name) for name in poses}
    begin = time.process_time()
    result = merge(maps)
    seconds = time.process_time() - begin
    merged, turned = (None, None) if result.merged is None else _agreements(result.merged, load_map(undivided))
    return SplitRun(
        recording=name,
        robots=len(maps),
        merged=tuple(result.poses),
        left_out=dict(result.left_out),
        pairs=_judged(maps, poses, result.poses),
        agree=None if merged is None else merged.agree,
        agree_nearby=None if merged is None else merged.agree_nearby,
        turned=None if turned is None else turned.agree,
        again=again,
        merge_cpu_s=seconds,
        truth_doubt=truth.doubt(),
    )


def _judged(
    maps: Mapping[str, TbmMap], truth: Mapping[str, SE2], found: Mapping[str, SE2]
) -> tuple[tuple[str, str, float, tuple[float, float] | None], ...]:
    """Return the overlapping pairs with their errors."""
    judged = []
    for first, second in itertools.combinations(maps, 2):
        true = truth[first].inverse() @ truth[second]
        shared = overlap_share(maps[first], maps[second], true)
        if shared >= _SHARED:
            errors = None
            if first in found and second in found:
                pair = KnownPair(f"{first}-{second}", maps[first], maps[second], true, shared)
                errors = pair.errors(found[first].inverse() @ found[second])
            judged.append((first, second, shared, errors))
    return tuple(judged)


def overlap_share(first: TbmMap, second: TbmMap, T_first_second: SE2) -> float:
    """Return the common free space of two maps, as a share of the smaller free space."""
    free = [cell_labels(tbm_map.grid) == FREE for tbm_map in (first, second)]
    there = cell_labels(resample(second.grid, T_first_second, first.grid.geometry)) == FREE
    areas = [float(cells.sum()) * m.grid.geometry.resolution**2 for cells, m in zip(free, (first, second), strict=True)]
    return float((free[0] & there).sum()) * first.grid.geometry.resolution**2 / max(min(areas), 1e-9)


def _agreements(merged: TbmMap, undivided: TbmMap) -> tuple[MapAgreement, MapAgreement]:
    """Return two agreements of the undivided map: with the merged map, and with its own rendering on rotated cells."""
    guess = pose_by_drives(undivided, merged)
    labels, true_labels = cell_labels(merged.grid), cell_labels(undivided.grid)
    motion = refine_map_transform(labels, merged.grid.geometry, true_labels, undivided.grid.geometry, guess)
    true = cell_labels(resample(undivided.grid, motion.inverse(), merged.grid.geometry))
    again = redraw([drive.keyframes.transformed(motion.inverse()) for drive in undivided.drives], undivided)
    turned = cell_labels(resample(undivided.grid, motion.inverse(), again.geometry))
    return map_agreement(labels, true), map_agreement(cell_labels(again), turned)


def pose_by_drives(undivided: TbmMap, merged: TbmMap) -> SE2:
    """Return the pose of a merged map in the undivided map, from the poses of the robots at equal stamps."""
    whole = undivided.drives[0].trajectory
    there, here = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for trajectory in (drive.trajectory for drive in merged.drives):
        i, j = matching_poses(whole.stamps, trajectory.stamps, _SAME_MOMENT_S)
        there.append(whole.poses[i, :2])
        here.append(trajectory.poses[j, :2])
    target, source = np.vstack(there), np.vstack(here)
    if len(target) < 2:
        raise TbmSlamError("the merged map and the map of the whole recording have no common stamps")
    return fit_rigid(target, source)[0]


def _row(run: SplitRun) -> dict[str, str]:
    errors = [error for *_, error in run.pairs if error is not None]
    near = sum(metres <= _NEAR_M and degrees <= _NEAR_DEG for metres, degrees in errors)
    worst = [max(values) if errors else None for values in zip(*errors, strict=True)] or [None, None]
    agreements = {
        "as undivided %": run.agree,
        "or beside %": run.agree_nearby,
        "undivided turned %": run.turned,
        "undivided again %": run.again,
    }
    return {
        "recording": run.recording,
        "robots": str(run.robots),
        "merged": str(len(run.merged)),
        "pairs": str(len(run.pairs)),
        "near enough": str(near),
        "worst m": number(worst[0], 3),
        "worst deg": number(worst[1], 2),
        **{name: number(share and 100.0 * share, 1) for name, share in agreements.items()},
        "merging CPU s": number(run.merge_cpu_s, 1),
    }
