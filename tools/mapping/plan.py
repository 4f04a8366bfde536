"""The plan of the robots to map, from the command line."""

import argparse
import dataclasses
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from datasets.opening import file_digests, list_recordings
from tbmslam.configuration.parameters import changed
from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Progress
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
from tools.command_line.options import scan_topics
from tools.command_line.output_folder import OutputError
from tools.mapping.task import MappingTask, Shelf, finished

_ENDINGS = re.compile(r"\.(gz|bz2|xz|zst|zstd|bag|mcap|db3|log|clf|active)$", re.IGNORECASE)
_UNSAFE = re.compile(r"[^\w-]+")
_LONGEST = 60  # largest length of a name: file systems allow 255 bytes, and names are shown in tables
_RESERVED = re.compile(r"(con|prn|aux|nul|(com|lpt)[\d¹²³])", re.IGNORECASE)
"""Names that Windows reserves for devices. (A name that begins with `-` looks like an option.)"""


def robot_names(recordings: Sequence[Path]) -> list[str]:
    """Return a unique name for each recording in order: `week/monday.bag` is monday.

    Recordings of equal names get the name of their folder in front, as in `north_monday`, and if still equal a number.
    Names that differ in case only are equal, since some file systems ignore it. Unsafe characters are replaced.
    """
    plain = [safe_name(_stem(path)) for path in recordings]
    names = _with_folders(recordings, plain)
    taken: set[str] = set()
    for index, name in enumerate(names):
        number = 2
        while names[index].casefold() in taken:
            names[index] = f"{name}-{number}"
            number += 1
        taken.add(names[index].casefold())
    return names


def safe_name(text: str) -> str:
    """Return a name that every file system accepts: letters, digits, `_` and `-`."""
    name = _UNSAFE.sub("_", text)[:_LONGEST].strip("_") or "robot"
    return f"robot_{name}" if _RESERVED.fullmatch(name) or name.startswith("-") else name


def _with_folders(recordings: Sequence[Path], names: Sequence[str]) -> list[str]:
    counts = Counter(name.casefold() for name in names)
    return [
        safe_name(f"{path.absolute().parent.name}_{name}") if counts[name.casefold()] > 1 else name
        for path, name in zip(recordings, names, strict=True)
    ]


def _stem(recording: Path) -> str:
    """Return the name of a recording without its endings: `drive.log.gz` is drive."""
    name = recording.absolute().name
    while (shorter := _ENDINGS.sub("", name)) not in ("", name):
        name = shorter
    return name


def plan_mapping(
    args: argparse.Namespace, config: Configuration, shelf: Shelf, progress: Progress
) -> list[MappingTask]:
    """Return the robots in the order of the recordings.

    A recording must be read before it can be split. It is not read if all its robots are finished. If one of several
    recordings cannot be split, its robots fail when they are mapped.
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
        configs.items(), progress.each(groups, "checking", len(groups), "recordings"), strict=True
    ):
        whole = MappingTask(name, paths, tuple(file_digests(paths)), own, None, None, args.out)
        shares = _shares(args)
        drafts = _parts(args, whole, len(tasks), shares)
        if shares != [None] and (args.split == "gaps" or args.redo or not all(map(finished, drafts))):
            try:
                drafts = _cut(args, whole, len(tasks), shelf, progress)
            except TbmSlamError as error:
                if len(groups) == 1:
                    raise
                drafts = [dataclasses.replace(draft, failure=error) for draft in drafts]
        tasks += drafts
    return tasks


def _configs(
    args: argparse.Namespace, config: Configuration, recordings: Mapping[str, tuple[Path, ...]]
) -> dict[str, Configuration]:
    """Return the parameters of each recording, since topics of scans may differ."""
    configs = dict.fromkeys(recordings, config)
    for key, topic in scan_topics(args).items():
        if not key:  # of all recordings
            continue
        meant = [name for name, paths in recordings.items() if key in {name, *(path.name for path in paths)}]
        if not meant:
            raise OutputError(f"--scan-topic {key}={topic} names no recording: there are {', '.join(recordings)}")
        for name in meant:
            configs[name] = changed(config, {"recording": {"scan_topic": topic}}, "--scan-topic")
    return configs


def _shares(args: argparse.Namespace) -> list[Mapping[str, object] | None]:
    """Return the choice of each robot's part of a recording; the number of gaps is not known yet."""
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
    """Return the robots of a recording: one with its name, or numbered robots for its parts from `index` on."""
    tasks = []
    for number, share in enumerate(shares):
        name = whole.name if share is None else f"{whole.name}_{number}"
        T_own_start = private_frame(whole.config.seed, index + number) if args.frames == "private" else None
        tasks.append(
            dataclasses.replace(whole, name=name, share=share, T_own_start=T_own_start, folder=args.out / name)
        )
    return tasks


def _cut(
    args: argparse.Namespace, whole: MappingTask, index: int, shelf: Shelf, progress: Progress
) -> list[MappingTask]:
    """Read a recording and return its robots with their parts."""
    options = whole.config.recording
    recording = shelf.open(whole.paths, options)
    stamps, poses = [], []
    for reading in progress.each(recording, "reading", recording.expected_scans, "scans"):
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
