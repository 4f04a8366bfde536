"""What build_maps does: split, map each robot, save, and note what happened."""

import argparse
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from datasets import Recording, open_recording
from datasets.cached import cached
from datasets.recording_warnings import recording_warnings
from tbmslam.atomic_file import write_text
from tbmslam.config import SlamConfig, preset
from tbmslam.errors import TbmSlamError
from tbmslam.laser_scan import Reading
from tbmslam.map_folder import save_map
from tbmslam.report.making import Making, versions
from tbmslam.report.maps_page import MappedRobot, maps_page
from tbmslam.rerun_viewer import RerunViewer
from tbmslam.se2 import SE2
from tbmslam.segmentation import (
    Itinerary,
    Segment,
    in_frame,
    private_frame,
    split_at_gaps,
    split_at_intervals,
    split_by_distance,
    split_by_time,
)
from tbmslam.slam import Slam
from tbmslam.tbm_map import TbmMap
from tbmslam.trajectory import Trajectory
from tbmslam.trajectory_alignment import align_trajectories
from tbmslam.tum import read_tum
from tbmslam.watch import Watch
from tools.configuration import Configuration, mapping_text
from tools.extra_files import write_extra_files
from tools.progress import ProgressBars
from tools.viewer_option import LIVE


class OutputError(TbmSlamError):
    """The folder to write into holds something else."""


@dataclass(frozen=True)
class Robot:
    """One robot to map."""

    name: str
    recording: Recording
    segment: Segment | None  # None: all of the recording
    T_own_start: SE2 | None
    reference: Path | None


def build_maps(args: argparse.Namespace, config: Configuration, command: str) -> None:
    """Map every robot and save its folder, then a report and the truth beside them; show it where that is wanted."""
    if args.viewer is None:
        _build(args, config, command, ProgressBars())
        return
    with RerunViewer(None if args.viewer == LIVE else Path(args.viewer)) as viewer:
        _build(args, config, command, ProgressBars(viewer))


def _build(args: argparse.Namespace, config: Configuration, command: str, watch: Watch) -> None:
    robots = _robots(args, config, watch)
    _refuse_stale_robots(args.out, [robot.name for robot in robots])
    made: dict[str, MappedRobot] = {}
    for robot in robots:
        made[robot.name] = _map_robot(robot, config, args.out / robot.name, watch)
        write_extra_files(args.out / robot.name, made[robot.name].tbm_map, args)
    # Without reference trajectories nobody knows how two recordings lie to each other.
    if not args.no_truth and (args.reference or (len(robots) > 1 and not args.separate)):
        _write_truth(args.out / "truth.json", robots, {name: one.tbm_map for name, one in made.items()}, watch)
    write_text(args.out / "report.html", maps_page(made, Making(command, watch.seconds)).to_html())
    print(f"report -> {args.out / 'report.html'}")


def _robots(args: argparse.Namespace, config: Configuration, watch: Watch) -> list[Robot]:
    groups = [[path] for path in args.recordings] if args.separate else [args.recordings]
    robots: list[Robot] = []
    for number, paths in enumerate(groups):
        recording = cached(open_recording(paths, config.recording))
        reference = args.reference[number] if args.reference else None
        for segment in _segments(args, config.recording.gap_s, recording, watch):
            index = len(robots)
            T_own_start = private_frame(config.seed, index) if args.frames == "private" else None
            robots.append(Robot(f"robot_{index}", recording, segment, T_own_start, reference))
    return robots


def _segments(args: argparse.Namespace, gap_s: float, recording: Recording, watch: Watch) -> Sequence[Segment | None]:
    if args.robots == 1 and not args.interval and args.split != "gaps":
        return [None]
    stamps, poses = [], []
    for reading in watch.each(recording, "reading", recording.expected_scans, "scans"):
        stamps.append(reading.scan.stamp)
        poses.append(reading.T_odom_robot)
    itinerary = Itinerary.from_poses(stamps, poses)
    if args.interval:
        return split_at_intervals(itinerary, [(begin, end) for begin, end in args.interval])
    if args.split == "gaps":
        return split_at_gaps(itinerary, gap_s)
    split = split_by_distance if args.split == "distance" else split_by_time
    return split(itinerary, args.robots, args.overlap)


def _map_robot(robot: Robot, config: Configuration, folder: Path, watch: Watch) -> MappedRobot:
    began = time.perf_counter()
    slam = Slam(config.slam, robot.name, watch)
    scans = 0
    for reading in watch.each(_readings(robot), "mapping", _length(robot), "scans", robot.name):
        watch.saw(robot.name, reading, slam.process(reading))
        scans += 1
    run = _run_record(robot, config.slam)
    tbm_map = slam.finish(run)
    watch.finished(robot.name, tbm_map)
    with watch.during("saving"):
        save_map(folder, tbm_map)
    drive = tbm_map.drives[0]
    known = float(tbm_map.grid.is_known().sum()) * tbm_map.grid.geometry.resolution**2
    result = {
        "scans": scans,
        "keyframes": len(drive.keyframes),
        "duration_s": float(np.ptp(drive.trajectory.stamps)),
        "distance_m": drive.trajectory.length(),
        "known_area_m2": known,
        "loops_closed": len(drive.closures),
        "correction_m": slam.correction_m,
    }
    run |= {"result": result}
    write_text(folder / "config.toml", mapping_text(config))
    write_text(folder / "run.json", json.dumps(run, indent=2) + "\n")
    seconds = time.perf_counter() - began
    print(
        f"{robot.name}: {scans} scans, {drive.trajectory.length():.1f} m, {len(drive.keyframes)} keyframes, "
        f"{known:.0f} m2 known, {seconds:.1f} s -> {folder}"
    )
    for line in robot.recording.counts.summary().splitlines():
        print(f"  {line}")
    return MappedRobot(tbm_map, run)


def _readings(robot: Robot) -> Iterable[Reading]:
    """Yield a robot's own readings, its odometry in its own frame."""
    start, stop = robot.segment or (0, None)
    T_own_odom: SE2 | None = None
    for reading in islice(robot.recording, start, stop):
        if robot.T_own_start is not None and T_own_odom is None:
            T_own_odom = robot.T_own_start @ (reading.T_odom_robot or SE2.identity()).inverse()
        yield reading if T_own_odom is None else in_frame(reading, T_own_odom)


def _length(robot: Robot) -> int | None:
    return robot.segment.stop - robot.segment.start if robot.segment else robot.recording.expected_scans


def _run_record(robot: Robot, config: SlamConfig) -> dict[str, object]:
    """Return what made a map, without anything that differs between two runs of the same kind."""
    return {
        "program": "build_maps",
        "versions": versions(),
        "robot": robot.name,
        "recording": {"name": robot.recording.name, **robot.recording.description},
        "segment": robot.segment._asdict() if robot.segment else None,
        "counts": robot.recording.counts.as_dict(),
        "warnings": recording_warnings(robot.recording),
        "config": config.model_dump(mode="json"),
    }


def _write_truth(path: Path, robots: Sequence[Robot], made: Mapping[str, TbmMap], watch: Watch) -> None:
    """Write where each robot's map lies in a common frame, for evaluation; nothing of it is in the maps."""
    robots_truth: dict[str, object] = {}
    references: dict[str, tuple[str, Trajectory]] = {}
    for robot in robots:
        if robot.recording.name not in references:
            references[robot.recording.name] = _reference(robot, watch)
        source, reference = references[robot.recording.name]
        alignment = align_trajectories(reference, made[robot.name].drives[0].trajectory)
        robots_truth[robot.name] = {
            "recording": robot.recording.name,
            "reference": source,
            "T_reference_map": list(alignment.T_reference_estimate),
            "ate_m": alignment.ate_m,
        }
    write_text(path, json.dumps({"robots": robots_truth}, indent=2) + "\n")
    print(f"truth for evaluation -> {path}")


def _reference(robot: Robot, watch: Watch) -> tuple[str, Trajectory]:
    """Return the trajectory of the whole drive: the one that was given, or the default SLAM's."""
    if robot.reference is not None:
        return str(robot.reference.name), read_tum(robot.reference)
    slam = Slam(preset("default"), "reference")
    for reading in watch.each(robot.recording, "mapping the reference", robot.recording.expected_scans, "scans"):
        slam.process(reading)
    return "default SLAM on the whole recording", slam.finish().drives[0].trajectory


def _refuse_stale_robots(out: Path, names: Sequence[str]) -> None:
    stale = sorted(path.name for path in out.glob("robot_*") if path.name not in names) if out.is_dir() else []
    if stale:
        raise OutputError(f"{out} holds {', '.join(stale)} of another run: remove it or choose another folder with -o")
