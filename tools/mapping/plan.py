"""From the command line to the robots that are to be mapped."""

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from datasets.digest import file_digests
from datasets.listing import list_recordings
from tbmslam.parallel.progress import Watch
from tbmslam.sensing.segmentation import (
    Itinerary,
    Segment,
    private_frame,
    split_at_gaps,
    split_at_intervals,
    split_by_distance,
    split_by_time,
)
from tools.command_line.configuration import Configuration
from tools.command_line.output_folder import OutputError
from tools.mapping.task import MappingTask, Shelf, finished


def plan_mapping(args: argparse.Namespace, config: Configuration, shelf: Shelf, watch: Watch) -> list[MappingTask]:
    """Return the robots in the order of the recordings.

    A recording that is split is read for it, unless all its robots are finished already.

    Raises
    ------
    TbmSlamError
        A recording cannot be read or split so, or `--reference` does not fit.
    """
    recordings = list_recordings(args.recordings)
    groups = [(path,) for path in recordings] if args.separate else [tuple(recordings)]
    if args.reference and len(args.reference) != len(groups):
        raise OutputError(
            f"--reference needs one trajectory for each recording: {len(groups)}, got {len(args.reference)}"
        )
    tasks: list[MappingTask] = []
    for paths in watch.each(groups, "checking", len(groups), "recordings"):
        files = tuple(file_digests(paths))
        shares = _shares(args)
        drafts = [_task(args, config, paths, files, len(tasks) + k, share) for k, share in enumerate(shares)]
        if shares != [None] and (args.split == "gaps" or args.redo or not all(map(finished, drafts))):
            drafts = _cut(args, config, drafts[0], len(tasks), shelf, watch)
        tasks += drafts
    return tasks


def _shares(args: argparse.Namespace) -> list[Mapping[str, object] | None]:
    """Return how each robot's part of a recording is chosen; with gaps nobody knows yet how many there are."""
    if args.interval:
        return [{"interval": [begin, end]} for begin, end in args.interval]
    if args.split == "gaps":
        return [{"split": "gaps", "number": 0}]
    if args.robots == 1:
        return [None]
    split = {"split": args.split, "robots": args.robots, "overlap": args.overlap}
    return [{**split, "number": number} for number in range(args.robots)]


def _task(
    args: argparse.Namespace,
    config: Configuration,
    paths: tuple[Path, ...],
    files: tuple[Mapping[str, str | int], ...],
    index: int,
    share: Mapping[str, object] | None,
) -> MappingTask:
    name = f"robot_{index}"
    T_own_start = private_frame(config.seed, index) if args.frames == "private" else None
    return MappingTask(name, paths, files, config, share, T_own_start, args.out / name)


def _cut(
    args: argparse.Namespace, config: Configuration, first: MappingTask, index: int, shelf: Shelf, watch: Watch
) -> list[MappingTask]:
    """Read a recording and return its robots with the parts that are theirs."""
    recording = shelf.open(first.paths, config.recording)
    stamps, poses = [], []
    for reading in watch.each(recording, "reading", recording.expected_scans, "scans"):
        stamps.append(reading.scan.stamp)
        poses.append(reading.T_odom_robot)
    segments = _segments(args, config.recording.gap_s, Itinerary.from_poses(stamps, poses))
    shares = _shares(args)
    if args.split == "gaps" and not args.interval:
        shares = [{"split": "gaps", "number": number} for number in range(len(segments))]
    return [
        dataclasses.replace(
            _task(args, config, first.paths, first.files, index + k, share),
            segment=segment,
            counts=recording.counts,
            began=stamps[0],
        )
        for k, (share, segment) in enumerate(zip(shares, segments, strict=True))
    ]


def _segments(args: argparse.Namespace, gap_s: float, itinerary: Itinerary) -> Sequence[Segment]:
    if args.interval:
        return split_at_intervals(itinerary, [(begin, end) for begin, end in args.interval])
    if args.split == "gaps":
        return split_at_gaps(itinerary, gap_s)
    split = split_by_distance if args.split == "distance" else split_by_time
    return split(itinerary, args.robots, args.overlap)
