"""Cost of a merge by the area of the maps, compared with the paper's program."""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from merging import align
from merging.config import MergeConfig
from merging.fusion import fuse, place
from merging.registration.features import describe_all, match
from merging.registration.ransac import find_consensus
from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import SE2
from tools.benchmarks.measured_process import in_fresh_process, peak_memory_mb
from tools.command_line.measurement_record import finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table
from tools.map_pairs.known_pair import KnownPair
from tools.map_pairs.pair_of_area import pair_of_area

NOTES = """\
Two maps of a building overlap by half. features to CPU: the paper's chain at 0.1 m (keypoints and descriptors of both
maps, matching, consensus, transform and disjunctive fusion), the shortest wall times of {repeat} runs, and the CPU time
of the chain. program: wall time of the authors' C++ program for this area on an idle machine of this kind. times
faster: by wall time and by CPU time. align: CPU time of the default alignment at 0.05 m, without loading and
compiling. peak: memory of the process."""

# The authors' program, unmodified, on a machine like the figures': area [m2] of the merged canvas and best time [ms].
# Smaller areas are taken as proportional.
_PROGRAM_M2 = (0.0, 4900.0, 7225.0, 8100.0, 10000.0, 12100.0, 15625.0, 19600.0, 25600.0, 41000.0)
_PROGRAM_MS = (0.0, 212.0, 322.0, 368.0, 472.0, 563.0, 766.0, 970.0, 1322.0, 3837.0)

_R = TypeVar("_R")

_PAPER_RESOLUTION, _RESOLUTION = 0.1, 0.05
_WARM_UP_M2 = 300.0


@dataclass(frozen=True)
class MergeRun:
    """Figures of one pair."""

    area_m2: float
    cells: int
    """Area and cells of the canvas of the two maps at 0.1 m."""
    features_ms: float
    matching_ms: float
    transform_ms: float
    fusion_ms: float
    """Wall time of each step of the paper's chain."""
    cpu_ms: float
    """CPU time of all steps, on all cores."""
    align_cpu_s: float
    is_right: bool
    """CPU time of the default alignment, and whether it was accepted and right within 0.5 m and 2 degrees."""
    peak_memory_mb: float

    @property
    def sum_ms(self) -> float:
        """Wall time of the paper's whole chain [ms]."""
        return self.features_ms + self.matching_ms + self.transform_ms + self.fusion_ms


def benchmark_merge(args: argparse.Namespace) -> None:
    """Run the benchmark and print the table."""
    runs = []
    for area in args.areas:
        say(f"benchmark: {area:g} m2")
        runs.append(in_fresh_process(run_merge, area, args.repeat))
    table = ResultTable.of([_row(run) for run in runs])
    print(text_table(*table))
    print(NOTES.format(repeat=args.repeat))
    finish(args, {"areas": table}, {"runs": runs})


def run_merge(area: float, repeat: int) -> MergeRun:
    """Make a pair with a canvas of the given area [m^2], and measure its merge."""
    for size in (_WARM_UP_M2, area):  # the first run compiles and loads
        steps, canvas = _time_chain(pair_of_area(size, _PAPER_RESOLUTION), repeat)
        pair, begin = pair_of_area(size, _RESOLUTION), time.process_time()
        found = align(pair.target, pair.source)
        align_cpu_s = time.process_time() - begin
    is_right = found.accepted and pair.is_right(found.T_target_source)
    cells = canvas.rows * canvas.cols
    return MergeRun(cells * canvas.resolution**2, cells, *steps, align_cpu_s, is_right, peak_memory_mb())


def _time_chain(pair: KnownPair, repeat: int) -> tuple[tuple[float, float, float, float, float], GridGeometry]:
    """Return the wall time of each step of the paper's chain, the CPU time of all [ms], and the fused canvas."""
    config, target, source = MergeConfig(), pair.target.grid, pair.source.grid
    T_target_source = pair.T_target_source or SE2.identity()
    features, *described = _quickest(lambda: describe_all([target, source], config.features), repeat)
    matches, *matched = _quickest(lambda: match(features[0], features[1], config.features), repeat)
    _, *found = _quickest(lambda: find_consensus(matches, config.consensus), repeat)
    fusion, *fused = _quickest(lambda: fuse([target, place(source, T_target_source, target.geometry)]), repeat)
    steps = described, matched, found, fused
    return (described[0], matched[0], found[0], fused[0], sum(cpu for _, cpu in steps)), fusion.grid.geometry


def _quickest(call: Callable[[], _R], repeat: int) -> tuple[_R, float, float]:
    """Return the result of a call, and its least wall time and CPU time [ms]."""
    least, least_cpu = math.inf, math.inf
    for _ in range(repeat):
        begin, cpu_begin = time.perf_counter(), time.process_time()
        result = call()
        least_cpu = min(least_cpu, time.process_time() - cpu_begin)
        least = min(least, time.perf_counter() - begin)
    return result, 1e3 * least, 1e3 * least_cpu


def _program_ms(area_m2: float) -> float | None:
    """Return the time of the authors' program; None above the largest area that was measured."""
    return float(np.interp(area_m2, _PROGRAM_M2, _PROGRAM_MS)) if area_m2 <= _PROGRAM_M2[-1] else None


def _row(run: MergeRun) -> dict[str, str]:
    theirs = _program_ms(run.area_m2)
    return {
        "area m2": number(run.area_m2, 0),
        "cells": str(run.cells),
        "features ms": number(run.features_ms, 1),
        "matching ms": number(run.matching_ms, 1),
        "transform ms": number(run.transform_ms, 1),
        "fusion ms": number(run.fusion_ms, 1),
        "sum ms": number(run.sum_ms, 1),
        "CPU ms": number(run.cpu_ms, 1),
        "program ms": number(theirs, 1),
        "times faster": number(theirs and theirs / run.sum_ms, 1),
        "by CPU": number(theirs and theirs / run.cpu_ms, 1),
        "align s": number(run.align_cpu_s, 2),
        "right": "yes" if run.is_right else "no",
        "peak MB": number(run.peak_memory_mb, 0),
    }
