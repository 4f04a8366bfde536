"""Pose graphs in the format of g2o and GTSAM: keyframes of drives, and measurements between them."""

import os
from collections.abc import Iterable, Iterator

import numpy as np

from tbmslam.io.atomic_file import write_text
from tbmslam.map.drive import Drive

_UPPER = np.triu_indices(3)


def write_g2o(path: str | os.PathLike[str], drives: Iterable[Drive]) -> None:
    """Write a pose graph atomically.

    A vertex is the pose of the laser at a keyframe, in the map's frame. An edge is the motion to the next keyframe as
    odometry and scans measured it, with its information. Loop closures are comments: what was measured is not kept, and
    the vertices obey them. Source of the format: g2o, `VERTEX_SE2 id x y theta` and `EDGE_SE2 from to dx dy dtheta`
    with the upper triangle of the information by rows.

    Raises
    ------
    FileNotWrittenError
        If the file cannot be written.
    """
    lines: list[str] = []
    first = 0
    for drive in drives:
        lines += _lines(drive, first)
        first += len(drive.keyframes)
    write_text(path, "".join(f"{line}\n" for line in lines))


def _lines(drive: Drive, first: int) -> Iterator[str]:
    """Yield the lines of a drive, with the number of its first vertex."""
    yield f"# drive {drive.name}"
    for number, pose in enumerate(drive.keyframes.all_sensor_poses(), first):
        yield f"VERTEX_SE2 {number} {_numbers(pose)}"
    if drive.motions is not None:
        for number, (step, information) in enumerate(
            zip(drive.motions.steps, drive.motions.informations, strict=True), first
        ):
            yield f"EDGE_SE2 {number} {number + 1} {_numbers(step)} {_numbers(information[_UPPER])}"
    for earlier, later in drive.closures.tolist():
        yield f"# loop closure {first + earlier} {first + later}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
