"""The run of build_maps: plan, map unfinished robots, report, and write the true poses of the maps for evaluation."""

import argparse
import hashlib
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from datasets.counts import in_number
from datasets.opening import file_digests
from tbmslam.configuration.slam_config import preset
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.trajectory_errors import TrajectoryAlignmentError, align_trajectories
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text
from tbmslam.io.map_folder import load_map
from tbmslam.io.trajectory_file import read_reference
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor, Progress
from tbmslam.report.maps_page import MappedRobot, maps_page
from tbmslam.report.page import RunInfo, downloads
from tbmslam.report.rerun_viewer import RerunViewer
from tbmslam.slam import Slam
from tools.command_line.checksums import changed_files, write_checksums
from tools.command_line.configuration import Configuration
from tools.command_line.extra_files import check_extra_files, write_extra_files
from tools.command_line.options import LIVE
from tools.command_line.other_results import refuse_to_map_over
from tools.command_line.output_folder import OutputError, output_folder
from tools.command_line.paths import map_folders
from tools.command_line.progress import ProgressBars
from tools.mapping.plan import plan_mapping
from tools.mapping.task import Mapped, MappingTask, Shelf, earlier_record, finished, map_robot, valid_json
from tools.mapping.truth_file import GIVEN, NAME, OWN_MAP, read_truth_file

logger = logging.getLogger(__name__)


def map_all(tasks: Sequence[MappingTask], shelf: Shelf, executor: Executor) -> Iterator[tuple[MappingTask, Mapped]]:
    """Map robots and yield their results in order; failures do not prevent the mapping of the others."""
    failures: dict[str, TbmSlamError] = {}
    step = "" if executor.is_serial(len(tasks)) else "mapping"  # each robot shows its own steps in this process
    with closing(executor.outcomes(_calls(tasks, shelf, executor), step, "robots")) as results:
        for task, result in zip(tasks, results, strict=True):
            if not isinstance(result, TbmSlamError):
                yield task, result
                continue
            if len(tasks) > 1:
                # Some errors begin with the name already.
                logger.warning("%s: %s", task.name, str(result).removeprefix(f"{task.name}: "))
            failures[task.name] = result
    if failures and len(tasks) == 1:
        raise next(iter(failures.values()))
    if failures:
        names = ", ".join(failures)
        kept = ", the others are kept" if len(failures) < len(tasks) else ""
        first = next(iter(failures.values()))
        raise TbmSlamError(
            f"{len(failures)} of {len(tasks)} robots failed ({names}){kept}; correct or omit their recordings and "
            f"run again; the first: {first}"
        )


def _calls(tasks: Sequence[MappingTask], shelf: Shelf, executor: Executor) -> list[Call]:
    if executor.is_serial(len(tasks)):
        return [Call(task.name, map_robot, (task, shelf, executor.progress)) for task in tasks]
    if executor.scheduler is not None:
        tasks = [task.at(Path.cwd()) for task in tasks]
    return [Call(task.name, _map_elsewhere, (task,)) for task in tasks]


def _map_elsewhere(task: MappingTask) -> Mapped:
    """Map a robot in another process; the map stays in its folder."""
    made = map_robot(task, Shelf(), Progress())
    return Mapped(made.run, made.summary, made.seconds)


_MERGE_REPORT = "report.json"  # file that marks the folder of a merged map


def build_maps(args: argparse.Namespace, config: Configuration, command: str) -> None:
    """Map all robots into their folders, write the report and the truth beside them, and show the report on request."""
    check_extra_files(args)
    with output_folder(args.out):
        if args.viewer is None:
            _build(args, config, command, ProgressBars())
            return
        with RerunViewer(None if args.viewer == LIVE else Path(args.viewer)) as viewer:
            _build(args, config, command, ProgressBars(viewer))


def _build(args: argparse.Namespace, config: Configuration, command: str, progress: Progress) -> None:
    for reference in args.reference or []:  # before hours of mapping
        read_reference(reference)
    shelf = Shelf()
    tasks = plan_mapping(args, config, shelf, progress)
    _refuse_stale_robots(args.out, [task.name for task in tasks])
    refuse_to_map_over(args.out, [task.folder for task in tasks])
    done, failure = _map(args, tasks, shelf, progress)
    made = [(task, done[task.name].tbm_map or load_map(task.folder)) for task in tasks if task.name in done]
    for task, tbm_map in made:
        if done[task.name].tbm_map is None:  # made in another process or run
            progress.finished(task.name, tbm_map)
        write_extra_files(task.folder, tbm_map, args)
        write_checksums(task.folder)
    robots = {task.name: MappedRobot(tbm_map, done[task.name].run) for task, tbm_map in made}
    usual = valid_json(Configuration.of_preset(config.preset).slam.model_dump(mode="json"))
    files = {task.name: downloads(args.out, task.folder) for task, _ in made}
    page = maps_page(
        robots, RunInfo(command, progress.seconds, usual), None if failure is None else str(failure), files
    )
    write_text(args.out / "report.html", page.to_html())
    print(f"report -> {args.out / 'report.html'}")
    _write_truth(args, list(dict.fromkeys(task.paths for task in tasks)), made, shelf, progress)
    if failure is not None:
        raise failure


def _map(
    args: argparse.Namespace, tasks: Sequence[MappingTask], shelf: Shelf, progress: Progress
) -> tuple[dict[str, Mapped], TbmSlamError | None]:
    """Map the unfinished robots; return the results by robot, and the errors of the others."""
    printed: set[tuple[tuple[Path, ...], str]] = set()
    kept = {} if args.redo else {task.name: found for task in tasks if (found := finished(task))}
    for task in tasks:
        if task.name in kept:
            _print_result(task, kept[task.name], printed)
    missing = [task for task in tasks if task.name not in kept]
    for task in missing:
        if names := changed_files(task.folder):
            logger.warning("%s: changed since an earlier run, written again: %s", task.folder, ", ".join(names))
    done = dict(kept)
    try:
        for task, result in map_all(missing, shelf, Executor(args.workers, args.scheduler, progress)):
            done[task.name] = result
            _print_result(task, result, printed)
    except TbmSlamError as failure:
        if not done:
            raise
        return done, failure
    return done, None


def _print_result(task: MappingTask, made: Mapped, printed: set[tuple[tuple[Path, ...], str]]) -> None:
    """Print the result of a robot, and the sources and counts of its recording unless they are in `printed`."""
    result = made.run["result"]
    how = "kept from an earlier run" if made.seconds is None else f"{made.seconds:.1f} s"
    scans = in_number(result["scans"], "scan", "scans")
    keyframes = in_number(result["keyframes"], "keyframe", "keyframes")
    print(
        f"{task.name}: {scans}, {result['distance_m']:.1f} m, {keyframes}, "
        f"{result['known_area_m2']:.0f} m2 known, {how} -> {task.folder}"
    )
    for lines in (_sources(made.run["recording"]), made.summary):
        if (task.paths, lines) not in printed:
            printed.add((task.paths, lines))
            for line in lines.splitlines():
                print(f"  {line}")


def _sources(recording: Mapping[str, object]) -> str:
    """Return the topics, or the kinds of lines of a log, from which scans and odometry of a recording were read."""
    odometry = recording["odometry"]
    if odometry == "tf":
        odometry = f"tf, {recording['odom_frame']} -> {recording['robot_frame']}"
    elif odometry == "topic":
        odometry = recording["odometry_topic"]
    return f"scans: {recording['scan_topic']}; odometry: {odometry}"


def _write_truth(
    args: argparse.Namespace,
    recordings: Sequence[tuple[Path, ...]],
    made: Sequence[tuple[MappingTask, TbmMap]],
    shelf: Shelf,
    progress: Progress,
) -> None:
    path = args.out / NAME
    # Without reference trajectories the relative pose of two recordings is unknown.
    if args.no_truth or not (args.reference or (len(made) > 1 and not args.separate)):
        path.unlink(missing_ok=True)
        return
    references = dict(zip(recordings, args.reference or [], strict=False))
    write_truth(path, made, references, shelf, progress)
    print(f"truth for evaluation -> {path}")
    if (doubt := read_truth_file(path).doubt()) is not None:
        logger.warning("%s %s", path, doubt)


def _refuse_stale_robots(out: Path, names: Sequence[str]) -> None:
    made = [path.name for path in map_folders(out) if not (path / _MERGE_REPORT).exists()]
    stale = [name for name in made if name not in names]
    if stale:
        shown = ", ".join(stale[:5]) + (", ..." if len(stale) > 5 else "")
        raise OutputError(f"{out} holds {shown} of another run: remove it or choose another folder with -o")


_WHOLE = "whole recording, for truth.json"  # name of the reference in the list of warnings


class _Reference(NamedTuple):
    """The true trajectory of a recording, if known."""

    name: str
    trajectory: Trajectory
    warnings: tuple[Mapping[str, object], ...] = ()


def write_truth(
    path: Path,
    made: Sequence[tuple[MappingTask, TbmMap]],
    references: Mapping[tuple[Path, ...], Path],
    shelf: Shelf,
    progress: Progress,
) -> None:
    """Write the pose of each robot's map in the true frame of its recording, unless it is written already.

    The file states the kind of the reference and the warnings of its mapping, since that map may be wrong too.
    Without a given true trajectory of its recording, the default SLAM maps the whole recording as the reference. Then a
    robot that saw too little for an alignment is left out with a warning.
    """
    depends_on = [[task.fingerprint() for task, _ in made], file_digests(references.values())]
    fingerprint = hashlib.sha256(json.dumps(depends_on).encode()).hexdigest()
    if earlier_record(path).get("fingerprint") == fingerprint:
        return
    robots: dict[str, object] = {}
    known: dict[tuple[Path, ...], _Reference] = {}
    for task, tbm_map in made:
        if task.paths not in known:
            given, keyframes = references.get(task.paths), tbm_map.drives[0].keyframes
            known[task.paths] = _reference(task, given, keyframes, shelf, progress)
        reference = known[task.paths]
        try:
            alignment = align_trajectories(reference.trajectory, tbm_map.drives[0].trajectory)
        except TrajectoryAlignmentError as error:
            if task.paths in references:
                raise
            logger.warning("%s: the pose of its map is unknown: %s", task.name, error)
            continue
        robots[task.name] = {
            "recording": task.files[0]["name"],
            "reference": reference.name,
            "T_reference_map": list(alignment.T_reference_estimate),
            "ate_m": alignment.ate_m,
        }
    record = {
        "source": GIVEN if all(paths in references for paths in known) else OWN_MAP,
        "warnings": [warning for reference in known.values() for warning in reference.warnings],
        "robots": robots,
        "fingerprint": fingerprint,
    }
    write_text(path, json.dumps(record, indent=2) + "\n")


def _reference(
    task: MappingTask, given: Path | None, keyframes: Keyframes, shelf: Shelf, progress: Progress
) -> _Reference:
    """Return the trajectory of the whole drive; its keyframes hold the mount of the laser."""
    if given is not None:
        return _Reference(given.name, read_reference(given).of_robot(keyframes.mounting()))
    recording = shelf.open(task.paths, task.config.recording)
    slam = Slam(preset("default"), _WHOLE)
    for reading in progress.each(recording, "mapping the reference", recording.expected_scans, "scans", _WHOLE):
        slam.process(reading)
    trajectory = slam.finish().drives[0].trajectory
    whose = {"recording": task.files[0]["name"]}
    warnings = tuple(whose | incident.as_dict(slam.start_stamp) for incident in slam.incidents)
    return _Reference("default SLAM on the whole recording", trajectory, warnings)
