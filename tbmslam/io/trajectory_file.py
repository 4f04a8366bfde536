"""Poses in text files: trajectories of TUM and of the MIT Stata Center (`*.gt.laser.poses`), and pose graphs of g2o."""

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, wrap_angles
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text
from tbmslam.map.drive import Drive, DriveLinks, DriveMotions
from tbmslam.sensing.laser_scan import FARTHEST_PLACE
from tbmslam.special_file import why_unreadable


class TumError(TbmSlamError):
    """A trajectory file cannot be read."""


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write a trajectory atomically; stamps keep nanoseconds."""
    lines = [
        # No space after the last number, since evo refuses such a line.
        f"{stamp:.9f} {x:.9f} {y:.9f} 0 0 0 {math.sin(theta / 2):.12f} {math.cos(theta / 2):.12f}\n"
        for stamp, (x, y, theta) in zip(trajectory.stamps.tolist(), trajectory.poses.tolist(), strict=True)
    ]
    write_text(path, "".join(lines))


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory; height, roll and pitch are left out. Empty lines and lines that begin with ``#`` are skipped.

    Raises a `TumError` if the file cannot be read or a line is not a pose.
    """
    numbered = pose_lines(Path(path))
    if not numbered:
        raise TumError(f"{path}: holds no poses: give a file of lines 't x y z qx qy qz qw'")
    values = np.array([_numbers(f"{path}:{number}", line) for number, line in numbered])
    qx, qy, qz, qw = values[:, 4:].T
    norms = np.linalg.norm(values[:, 4:], axis=1)
    if (np.abs(norms - 1.0) > 0.01).any():
        worst = int(np.argmax(np.abs(norms - 1.0)))
        raise TumError(
            f"{path}:{numbered[worst][0]}: the quaternion has length {norms[worst]:.3g}, not 1: "
            "the columns must be t x y z qx qy qz qw"
        )
    theta = np.arctan2(2.0 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    poses: FloatArray = np.column_stack((values[:, 1], values[:, 2], wrap_angles(theta)))
    return Trajectory(values[:, 0].copy(), poses)


def pose_lines(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a file that should contain a pose, with their numbers from 1."""
    if path.is_dir():
        raise TumError(f"{path}: is a folder: give a trajectory's file, such as {path / 'trajectory.tum'}")
    if why := why_unreadable(path):
        raise TumError(f"{path}: {why}: give a trajectory's file")
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise TumError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TumError(f"{path}: is not text: give a file of lines 't x y z qx qy qz qw'") from None
    lines = enumerate((line.strip() for line in text.splitlines()), start=1)
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _numbers(place: str, line: str) -> list[float]:
    fields = line.split()
    if len(fields) != 8:
        raise TumError(f"{place}: has {len(fields)} fields, not the 8 of 't x y z qx qy qz qw'")
    try:
        numbers = [float(field) for field in fields]
    except ValueError as error:
        raise TumError(f"{place}: {str(error)[:120]}: remove the line") from None
    if not all(map(math.isfinite, numbers)):
        raise TumError(f"{place}: has a number that is not finite: remove the line")
    if not max(map(abs, numbers[1:4])) <= FARTHEST_PLACE:
        raise TumError(
            f"{place}: the position is more than {FARTHEST_PLACE:.0e} m away: remove the line, "
            "or pass --relations if the file holds relations"
        )
    return numbers


Frame = Literal["robot", "laser"]
"""Body whose poses a trajectory contains."""

_FIELDS = 4


@dataclass(frozen=True)
class ReferenceTrajectory:
    """The true trajectory of a robot or its laser."""

    trajectory: Trajectory
    frame: Frame
    """Body whose poses they are."""

    def of_robot(self, T_robot_sensor: SE2) -> Trajectory:
        """Return the trajectory of the robot from that of its laser."""
        if self.frame == "robot":
            return self.trajectory
        poses = compose(self.trajectory.poses, np.array(T_robot_sensor.inverse()))
        return replace(self.trajectory, poses=poses)


def read_reference(path: str | os.PathLike[str]) -> ReferenceTrajectory:
    """Read a true trajectory of either format, distinguished by the first line.

    The Stata Center's truth (M. Fallon et al., IJRR 2013) has lines `t, x, y, theta`: whole microseconds, metres,
    radians, of the laser. A TUM file is of the robot. Raises a `TumError` if the file cannot be read or a line is not a
    pose.
    """
    numbered = pose_lines(Path(path))
    if not numbered or "," not in numbered[0][1]:
        return ReferenceTrajectory(read_tum(path), "robot")
    values = np.array([_laser_pose(f"{path}:{number}", line) for number, line in numbered])
    poses = np.column_stack((values[:, 1:3], wrap_angles(values[:, 3])))
    return ReferenceTrajectory(Trajectory(values[:, 0].copy(), poses), "laser")


def _laser_pose(place: str, line: str) -> tuple[float, float, float, float]:
    """Return stamp [s], x, y [m] and heading [rad] of a line."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) != _FIELDS or not fields[0].isdecimal():
        raise TumError(f"{place}: is not 't, x, y, theta' with t in whole microseconds: give a file of such lines")
    try:
        x, y, theta = map(float, fields[1:])
    except ValueError as error:
        raise TumError(f"{place}: {str(error)[:120]}: remove the line") from None
    if not (abs(x) <= FARTHEST_PLACE and abs(y) <= FARTHEST_PLACE and np.isfinite(theta)):
        raise TumError(f"{place}: is not finite, or more than {FARTHEST_PLACE:.0e} m away: remove the line")
    return int(fields[0]) * 1e-6, x, y, theta


_UPPER = np.triu_indices(3)


def write_g2o(path: str | os.PathLike[str], drives: Iterable[Drive], links: DriveLinks | None = None) -> None:
    """Write a pose graph atomically.

    A vertex is the pose of the laser at a keyframe, in the map's frame. The edges are the motions to the next keyframe
    as odometry and scans measured them, then the motions of the loop closures, all with their information. Closures
    between drives follow. Comments at the end name the vertices of each drive, and closures whose motion is unknown;
    old maps hold none. Source of the format: g2o, `VERTEX_SE2 id x y theta` and `EDGE_SE2 from to dx dy dtheta` with
    the upper triangle of the information by rows.
    """
    vertices, edges, comments, starts = list[str](), list[str](), list[str](), list[int]()
    for drive in drives:
        starts.append(first := len(vertices))
        vertices += _vertex_lines(drive, first)
        edges += _graph_edge_lines(drive, first)
        comments += _comment_lines(drive, first)
    if links is not None:
        edges += _edge_lines(np.array(starts)[links.ends[:, ::2]] + links.ends[:, 1::2], links.motions)
    # The comments come last, since GTSAM 4.3 ignores all edges after a line that is no edge or vertex.
    write_text(path, "".join(f"{line}\n" for line in (*vertices, *edges, *comments)))


def _vertex_lines(drive: Drive, first: int) -> Iterator[str]:
    """Yield the vertices of a drive, with the number of its first one."""
    for number, pose in enumerate(drive.keyframes.all_sensor_poses(), first):
        yield f"VERTEX_SE2 {number} {_spaced(pose)}"


def _graph_edge_lines(drive: Drive, first: int) -> Iterator[str]:
    if drive.motions is not None:
        following = np.arange(len(drive.motions))
        yield from _edge_lines(np.column_stack((following, following + 1)) + first, drive.motions)
    if drive.closure_motions is not None:
        yield from _edge_lines(drive.closures + first, drive.closure_motions)


def _comment_lines(drive: Drive, first: int) -> Iterator[str]:
    """Yield what the format has no words for."""
    count = len(drive.keyframes)
    yield f"# drive {drive.name}: " + (f"vertices {first} to {first + count - 1}" if count else "no vertices")
    if drive.closure_motions is None:
        for earlier, later in (drive.closures + first).tolist():
            yield f"# loop closure {earlier} {later}"


def _edge_lines(ends: IntArray, motions: DriveMotions) -> Iterator[str]:
    """Yield the lines of motions between vertices (S, 2)."""
    for (source, target), step, information in zip(ends.tolist(), motions.steps, motions.informations, strict=True):
        yield f"EDGE_SE2 {source} {target} {_spaced(step)} {_spaced(information[_UPPER])}"


def _spaced(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
