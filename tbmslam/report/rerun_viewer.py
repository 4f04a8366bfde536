"""Shows the mapping in Rerun, live or in a file: scans, the growing map, the drive and closed loops."""

import logging
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.io.pictures import draw_grid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import Reading

logger = logging.getLogger(__name__)

_PATIENCE_S = 30.0
_SCAN_EVERY_S, _ROUNDING_S = 0.2, 1e-3
_SCAN_POINTS = 360
_MAP_EVERY = 25  # shown scans between two updates of the growing map
_MAP_CELL_M = 0.1
_SCAN_COLOUR, _MAP_COLOUR, _DRIVE_COLOUR, _LOOP_COLOUR = (213, 94, 0), (90, 100, 112), (0, 114, 178), (160, 60, 160)
_HEIGHTS = {"map": 0.0, "drive": 0.02, "scan": 0.04}


class ViewerError(TbmSlamError):
    """The viewer cannot be started, or its file cannot be written."""


class RerunViewer:
    """Streams the progress of a SLAM to Rerun, live or to a .rrd file; a context manager that completes the file.

    Every robot is a separate entity, since the relative poses of their frames are unknown. Times are those of the
    recording. Live viewing starts the viewer of the package. Raises a `ViewerError` if rerun-sdk is not installed, the
    file cannot be written, or no viewer can be started.
    """

    def __init__(self, file: Path | None = None) -> None:
        try:
            import rerun  # noqa: PLC0415  # large, and an extra
        except ImportError:
            raise ViewerError(
                "watching needs rerun-sdk, which is not installed: pip install 'tbmslam[viewer]'"
            ) from None
        if file is None and sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
            raise ViewerError("a viewer cannot be started (there is no screen here): give a file, --viewer FILE.rrd")
        self._file = file
        self._rerun: Any = rerun
        self._stream: Any = rerun.RecordingStream("tbmslam")
        self._robots: dict[str, _Robot] = {}
        try:
            if file is None:
                with _own_programs_found():
                    self._stream.spawn()
            else:
                file.parent.mkdir(parents=True, exist_ok=True)
                self._stream.save(file)
        except (OSError, RuntimeError, ValueError) as error:
            place = "a viewer cannot be started" if file is None else f"{file}: cannot be written"
            raise ViewerError(f"{place} ({_reason(error)}): give another file, --viewer FILE.rrd") from error

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Flush the stream to the viewer or the file.

        Raises a `ViewerError` if the file is not complete. A viewer that was closed causes only a warning.
        """
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
            self._stream.disconnect()
        except (RuntimeError, OSError) as fault:
            if self._file is not None:
                raise ViewerError(
                    f"{self._file}: is not complete ({_reason(fault)}): make room or give another file"
                ) from fault
            logger.warning("the viewer was closed before the end (%s)", _reason(fault))

    def saw(self, name: str, reading: Reading, T_map_robot: SE2) -> None:
        """Show the pose of a robot, and at intervals its scan and the map so far."""
        robot = self._robot(name)
        stamp = reading.scan.stamp
        robot.path.append((T_map_robot.x, T_map_robot.y))
        if not robot.is_due(stamp):
            return
        hits = reading.T_robot_sensor.apply(reading.scan.hit_points())
        hits = hits[:: max(len(hits) // _SCAN_POINTS, 1)]
        robot.add_to_map(T_map_robot.apply(hits))
        self._stream.set_time("recording", timestamp=stamp)
        turn = self._rerun.RotationAxisAngle(axis=(0, 0, 1), radians=T_map_robot.theta)
        place = self._rerun.Transform3D(translation=(T_map_robot.x, T_map_robot.y, 0.0), rotation=turn)
        self._stream.log(f"{name}/robot", place)
        self._points(f"{name}/robot/scan", hits, _SCAN_COLOUR, 0.04, "scan")
        if robot.shown % _MAP_EVERY == 0:
            self._strips(f"{name}/drive", [np.array(robot.path)], _DRIVE_COLOUR)
            self._points(f"{name}/map", robot.map_points(), _MAP_COLOUR, 0.05, "map")

    def finished(self, name: str, tbm_map: TbmMap) -> None:
        """Show the finished map with its drives, keyframes and closed loops."""
        robot = self._robot(name)
        if math.isfinite(robot.last_stamp):
            self._stream.set_time("recording", timestamp=robot.last_stamp)
        for passed in (f"{name}/map", f"{name}/robot/scan"):
            self._stream.log(passed, self._rerun.Clear(recursive=False))
        self._stream.log(f"{name}/grid", self._picture(tbm_map))
        for drive in tbm_map.drives:
            keyframes = drive.keyframes.poses[:, :2]
            self._strips(f"{name}/drive", [drive.trajectory.poses[:, :2]], _DRIVE_COLOUR)
            self._points(f"{name}/keyframes", keyframes, _DRIVE_COLOUR, 0.05, "drive")
            self._strips(f"{name}/closures", list(keyframes[drive.closures]), _LOOP_COLOUR)

    def _robot(self, name: str) -> "_Robot":
        """Return the state of a robot; a new robot gets a view."""
        if name not in self._robots:
            self._robots[name] = _Robot()
            import rerun.blueprint as rrb  # noqa: PLC0415

            views = [rrb.Spatial3DView(origin=f"/{known}", name=known) for known in self._robots]
            self._stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views), collapse_panels=True))
        return self._robots[name]

    def _points(self, path: str, points: FloatArray, colour: tuple[int, int, int], radius: float, height: str) -> None:
        self._stream.log(path, self._rerun.Points3D(_raised(points, height), radii=radius, colors=[colour]))

    def _strips(self, path: str, lines: list[FloatArray], colour: tuple[int, int, int]) -> None:
        strips = [_raised(line, "drive") for line in lines]
        self._stream.log(path, self._rerun.LineStrips3D(strips, colors=[colour] * len(strips), radii=0.03))

    def _picture(self, tbm_map: TbmMap) -> Any:
        """Return the pignistic picture as a floor of two triangles in metres."""
        left, bottom, right, top = tbm_map.grid.geometry.bounds()
        grey = draw_grid(tbm_map.grid)["pignistic"]
        return self._rerun.Mesh3D(
            vertex_positions=[(left, top, 0.0), (right, top, 0.0), (right, bottom, 0.0), (left, bottom, 0.0)],
            triangle_indices=[(0, 1, 2), (0, 2, 3)],
            vertex_texcoords=[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
            albedo_texture=np.dstack([grey] * 3),
        )


@contextmanager
def _own_programs_found() -> Iterator[None]:
    """Find the viewer beside this Python, even if its environment is not activated."""
    before = os.environ.get("PATH", "")
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{before}"
    try:
        yield
    finally:
        os.environ["PATH"] = before


def _reason(error: Exception) -> str:
    """Return the first line of an error, or its kind if it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(". ")


class _Robot:
    """The shown state of one robot."""

    def __init__(self) -> None:
        self.path: list[tuple[float, float]] = []
        self.shown = 0
        self.last_stamp = -math.inf
        self._cells = np.zeros((0, 2), dtype=np.int64)

    def is_due(self, stamp: float) -> bool:
        """Return whether to show a scan: at intervals, and the first one after the clock stepped back."""
        if 0.0 <= stamp - self.last_stamp < _SCAN_EVERY_S - _ROUNDING_S:
            return False
        self.last_stamp = stamp
        self.shown += 1
        return True

    def add_to_map(self, points: FloatArray) -> None:
        cells = np.floor(points / _MAP_CELL_M).astype(np.int64)
        self._cells = np.unique(np.vstack((self._cells, cells)), axis=0)

    def map_points(self) -> FloatArray:
        return (self._cells + np.float64(0.5)) * _MAP_CELL_M


def _raised(points: FloatArray, height: str) -> FloatArray:
    """Return points (N, 3) at the height of their kind, so that more important kinds lie above."""
    return np.column_stack((points, np.full(len(points), _HEIGHTS[height])))
