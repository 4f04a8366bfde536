"""A robot to map, with all data that another process or machine needs."""

import dataclasses
import hashlib
import json
import math
import time
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from datasets import ReadingCounts, Recording, RecordingOptions, open_recording
from datasets.counts import SCANS, Span, in_number
from datasets.recording import cached, read_ahead, recording_warnings
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import write_text
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tbmslam.monitoring.incidents import in_order
from tbmslam.parallel.cluster import code_digest
from tbmslam.parallel.executor import Progress
from tbmslam.report.page import versions
from tbmslam.sensing.laser_scan import Corrections, Reading
from tbmslam.sensing.segmentation import Segment, in_frame
from tbmslam.slam import Slam
from tbmslam.special_file import why_unreadable
from tools.command_line.checksums import NAME as CHECKSUMS
from tools.command_line.checksums import changed_files, write_checksums
from tools.command_line.configuration import Configuration, mapping_text
from tools.command_line.program import loading


class EmptyMapError(TbmSlamError):
    """No scan of a robot can be drawn."""


@dataclass(frozen=True)
class MappingTask:
    """A robot to map."""

    name: str
    paths: tuple[Path, ...]
    files: tuple[Mapping[str, str | int], ...]
    """Name, size and digest of each file."""
    config: Configuration
    share: Mapping[str, object] | None
    """Choice of its part of the recording for JSON; None for the whole recording."""
    T_own_start: SE2 | None
    """Initial pose of the robot in its own frame; None: the frame is that of the odometry."""
    folder: Path
    segment: Segment | None = None
    counts: ReadingCounts | None = None
    """Its part, and the counts of a pass over the whole recording; None for the whole recording."""
    failure: TbmSlamError | None = None
    """Why the recording could not be split; raised instead of mapping."""
    began: float | None = None
    """Stamp of the first reading, at which `--interval` is 0 [s]; None if unknown."""

    @cached_property
    def config_text(self) -> str:
        """The parameters that the map depends on, as TOML."""
        return mapping_text(self.config)

    def fingerprint(self) -> str:
        """Return a digest of all that the map depends on: input, parameters, code and versions."""
        inputs = {
            "robot": self.name,
            "files": [dict(file) for file in self.files],
            "config": self.config_text,
            "share": self.share,
            "T_own_start": self.T_own_start,
            "code": code_digest("tbmslam", open_recording.__module__.rpartition(".")[0]),
            "versions": versions(),
        }
        return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()

    def at(self, folder: Path) -> "MappingTask":
        """Return the task with absolute paths; relative paths start at a folder."""
        paths = tuple(folder / path for path in self.paths)
        return dataclasses.replace(self, paths=paths, folder=folder / self.folder)


@dataclass(frozen=True)
class Mapped:
    """The result of a task."""

    run: Mapping[str, Any]
    """The content of run.json."""
    summary: str = ""
    seconds: float | None = None
    """Wall time; None if it was finished before."""
    tbm_map: TbmMap | None = None
    """The map; None if it is only in its folder."""


class Shelf:
    """Keeps the last opened recording, so that its robots decompress it once."""

    def __init__(self) -> None:
        self._kept: tuple[tuple[Path, ...], RecordingOptions] | None = None
        self._recording: Recording | None = None

    def open(self, paths: tuple[Path, ...], options: RecordingOptions, once: bool = False) -> Recording:
        """Return a recording, from memory if possible; a recording for one robot is not kept."""
        if self._recording is not None and self._kept == (paths, options):
            return self._recording
        recording = open_recording(paths, options)
        if once:
            return recording
        self._recording, self._kept = cached(recording), (paths, options)
        return self._recording


def map_robot(task: MappingTask, shelf: Shelf, progress: Progress) -> Mapped:
    """Map a robot and write its folder; the checksums are written last and mark it as finished."""
    if task.failure is not None:
        raise task.failure
    began = time.perf_counter()
    recording = shelf.open(task.paths, task.config.recording, once=task.segment is None)
    options = task.config.recording
    clock = recording.description.get("clock_offset_s")  # None if odometry is not looked up by time
    corrections = Corrections(
        options.range_offset,
        options.odometry_scale,
        options.angle_step_deg is not None,
        clock if isinstance(clock, float) else 0.0,
    )
    slam = Slam(task.config.slam, task.name, progress, task.began, corrections)
    segment = task.segment
    length = segment.stop - segment.start if segment else recording.expected_scans
    scans, first, last = 0, math.inf, -math.inf
    for reading in progress.each(read_ahead(_readings(task, recording)), "mapping", length, "scans", task.name):
        with nullcontext() if scans else loading():  # compiled code is loaded at the first use
            T_map_robot = slam.process(reading)
        progress.saw(task.name, reading, T_map_robot)
        scans, first, last = scans + 1, min(first, reading.scan.stamp), max(last, reading.scan.stamp)
    if task.counts is not None:
        recording.counts.replace_by(task.counts)
    span = None if segment is None else _span(segment, recording.counts.scans_used, first, last)
    _check_seen(recording, scans, recording.counts.beams.get("hit", 0) > 0)
    tbm_map = slam.finish()
    _check_seen(recording, scans, bool(tbm_map.grid.is_known().any()))
    # Errors of the laser are known only at the end.
    run = valid_json(_run_record(task, recording) | _noted(recording, span, slam))
    tbm_map = dataclasses.replace(tbm_map, provenance=dict(run))
    progress.finished(task.name, tbm_map)
    (task.folder / CHECKSUMS).unlink(missing_ok=True)
    with progress.during("saving"):
        save_map(task.folder, tbm_map)
    drive = tbm_map.drives[0]
    run["result"] = {
        "scans": scans,
        "keyframes": len(drive.keyframes),
        "duration_s": float(np.ptp(drive.trajectory.stamps)),
        "distance_m": drive.trajectory.driven(),
        "known_area_m2": tbm_map.grid.known_m2(),
        "loops_closed": len(drive.closures),
        "correction_m": slam.correction_m,
    }
    run["fingerprint"] = task.fingerprint()
    write_text(task.folder / "config.toml", task.config_text)
    write_text(task.folder / "run.json", json.dumps(run, indent=2, allow_nan=False) + "\n")
    write_checksums(task.folder)
    whose = "" if segment is None else "of the whole recording "
    return Mapped(run, whose + recording.counts.summary(), time.perf_counter() - began, tbm_map)


def _check_seen(recording: Recording, scans: int, is_seen: bool) -> None:
    """Raise an `EmptyMapError` if no scan shows anything."""
    if is_seen:
        return
    counts = recording.counts
    if not counts.any_finite:
        raise EmptyMapError(
            f"{recording.name}: no beam of {in_number(scans, *SCANS)} has a finite range: check the laser and its "
            "driver, or choose another --scan-topic"
        )
    total = sum(counts.beams.values())
    fates = ", ".join(f"{number / total:.0%} {fate}" for fate, number in sorted(counts.beams.items()))
    raise EmptyMapError(
        f"{recording.name}: nothing was measured in {scans} scans (beams: {fates}): check --range-max and "
        "--range-min, or choose another --scan-topic"
    )


def finished(task: MappingTask) -> Mapped | None:
    """Return the result of an earlier run of a task.

    None if the map is unfinished, of other inputs, or if its files were changed.
    """
    run = earlier_record(task.folder / "run.json")
    is_same = run.get("fingerprint") == task.fingerprint()
    return Mapped(run) if is_same and changed_files(task.folder) == [] else None


def earlier_record(path: Path) -> Mapping[str, object]:
    """Return the JSON object that an earlier run wrote; empty if there is none that can be read."""
    try:
        record = None if why_unreadable(path) else json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _readings(task: MappingTask, recording: Recording) -> Iterable[Reading]:
    """Yield the readings of a robot's part, with the odometry in its frame."""
    start, stop = task.segment or (0, None)
    T_own_odom: SE2 | None = None
    for reading in islice(recording, start, stop):
        if task.T_own_start is not None and T_own_odom is None:
            T_own_odom = task.T_own_start @ (reading.T_odom_robot or SE2.identity()).inverse()
        yield reading if T_own_odom is None else in_frame(reading, T_own_odom)


def _run_record(task: MappingTask, recording: Recording) -> dict[str, object]:
    """Return the origin of a map without parts that differ between equal runs, such as paths."""
    description = {key: value for key, value in recording.description.items() if key != "paths"}
    return {
        "program": "build_maps",
        "versions": versions(),
        "robot": task.name,
        "recording": {"name": recording.name, "files": [dict(file) for file in task.files], **description},
        "segment": task.segment._asdict() if task.segment else None,
        "counts": recording.counts.as_dict(),
        "config": task.config.slam.model_dump(mode="json"),
    }


def valid_json(record: Mapping[str, object]) -> dict[str, object]:
    """Return a record as valid JSON: infinity and nan become null."""
    made: dict[str, object] = json.loads(json.dumps(record), parse_constant=lambda _: None)
    return made


def _span(segment: Segment, readings: int, first: float, last: float) -> Span:
    """Return the first and last stamp of a part [s], extended at the begin and end of the recording."""
    return Span(first if segment.start else -math.inf, last if segment.stop < readings else math.inf)


def _noted(recording: Recording, span: Span | None, slam: Slam) -> dict[str, object]:
    """Return the warnings about a part of a recording and its drive, and its incidents."""
    incidents = in_order([*recording.counts.incidents_in(span), *slam.incidents])
    return {
        "warnings": recording_warnings(recording, span)
        + [incident.text(slam.start_stamp) for incident in slam.incidents],
        "incidents": [incident.as_dict(slam.start_stamp) for incident in incidents],
    }
