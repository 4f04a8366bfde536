"""From the command line to the robots that are to be mapped."""

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from datasets.digest import file_digests
from datasets.listing import list_recordings
from tbmslam.configuration.parameters import changed
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
from tools.command_line.recording_options import scan_topics_of_recordings
from tools.mapping.robot_names import robot_names
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
    names = robot_names([min(paths, key=lambda path: path.name) for paths in groups])
    configs = _configs(args, config, dict(zip(names, groups, strict=True)))
    tasks: list[MappingTask] = []
    for (name, own), paths in zip(
        configs.items(), watch.each(groups, "checking", len(groups), "recordings"), strict=True
    ):
        whole = MappingTask(name, paths, tuple(file_digests(paths)), own, None, None, args.out)
        shares = _shares(args)
        drafts = _parts(args, whole, len(tasks), shares)
        if shares != [None] and (args.split == "gaps" or args.redo or not all(map(finished, drafts))):
            drafts = _cut(args, whole, len(tasks), shelf, watch)
        tasks += drafts
    return tasks


def _configs(
    args: argparse.Namespace, config: Configuration, recordings: Mapping[str, tuple[Path, ...]]
) -> dict[str, Configuration]:
    """Return each recording's own parameters: its topic of scans may have been given."""
    configs = dict.fromkeys(recordings, config)
    for key, topic in scan_topics_of_recordings(args).items():
        meant = [name for name, paths in recordings.items() if key in {name, *(path.name for path in paths)}]
        if not meant:
            raise OutputError(f"--scan-topic {key}={topic} names no recording: there are {', '.join(recordings)}")
        for name in meant:
            configs[name] = changed(config, {"recording": {"scan_topic": topic}}, "--scan-topic")
    return configs


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


def _parts(
    args: argparse.Namespace, whole: MappingTask, index: int, shares: Sequence[Mapping[str, object] | None]
) -> list[MappingTask]:
    """Return the robots of a recording: one of its name, or numbered ones where it is cut; `index` of the first."""
    tasks = []
    for number, share in enumerate(shares):
        name = whole.name if share is None else f"{whole.name}_{number}"
        T_own_start = private_frame(whole.config.seed, index + number) if args.frames == "private" else None
        tasks.append(
            dataclasses.replace(whole, name=name, share=share, T_own_start=T_own_start, folder=args.out / name)
        )
    return tasks


def _cut(args: argparse.Namespace, whole: MappingTask, index: int, shelf: Shelf, watch: Watch) -> list[MappingTask]:
    """Read a recording and return its robots with the parts that are theirs."""
    options = whole.config.recording
    recording = shelf.open(whole.paths, options)
    stamps, poses = [], []
    for reading in watch.each(recording, "reading", recording.expected_scans, "scans"):
        stamps.append(reading.scan.stamp)
        poses.append(reading.T_odom_robot)
    segments = _segments(args, options.gap_s, Itinerary.from_poses(stamps, poses))
    shares = _shares(args)
    if args.split == "gaps" and not args.interval:
        shares = [{"split": "gaps", "number": number} for number in range(len(segments))]
    return [
        dataclasses.replace(task, segment=segment, counts=recording.counts, began=stamps[0])
        for task, segment in zip(_parts(args, whole, index, shares), segments, strict=True)
    ]


def _segments(args: argparse.Namespace, gap_s: float, itinerary: Itinerary) -> Sequence[Segment]:
    if args.interval:
        return split_at_intervals(itinerary, [(begin, end) for begin, end in args.interval])
    if args.split == "gaps":
        return split_at_gaps(itinerary, gap_s)
    split = split_by_distance if args.split == "distance" else split_by_time
    return split(itinerary, args.robots, args.overlap)
