"""The true poses of the robots' maps in a common frame, for evaluation only."""

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from datasets.opening import file_digests
from tbmslam.configuration.slam_config import preset
from tbmslam.evaluation.trajectory_errors import TrajectoryAlignmentError, align_trajectories
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text
from tbmslam.io.trajectory_file import read_reference
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.progress import Progress
from tbmslam.slam import Slam
from tbmslam.special_file import why_unreadable
from tools.evaluation import GIVEN, OWN_MAP
from tools.mapping.task import MappingTask, Shelf

logger = logging.getLogger(__name__)

_WHOLE = "whole recording, for truth.json"
"""Name of the reference in the list of warnings."""


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

    The file says what the reference is, and what went wrong as it was made: a map of ours may be torn itself.
    Without a true trajectory, a robot that saw too little to be placed by that is left out with a warning.

    Parameters
    ----------
    path
        The file.
    made
        The robots and their maps.
    references
        True trajectories by recording; without one the default SLAM maps the whole recording as the reference.
    shelf
        Recordings in memory.
    progress
        Receives the progress.
    """
    fingerprint = _fingerprint([task for task, _ in made], references)
    if _written(path) == fingerprint:
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


def _fingerprint(tasks: Sequence[MappingTask], references: Mapping[tuple[Path, ...], Path]) -> str:
    record = [[task.fingerprint() for task in tasks], file_digests(references.values())]
    return hashlib.sha256(json.dumps(record).encode()).hexdigest()


def _written(path: Path) -> str | None:
    try:
        if why_unreadable(path):
            return None
        record = json.loads(path.read_text(encoding="utf-8"))
        return str(record["fingerprint"]) if record["source"] else None  # older files do not state it
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


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
