"""A map: its grid, its drives and its provenance."""

import base64
import html
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_occupancy, occupancy_of
from tbmslam.belief.grid_resampling import canvas_of, resample
from tbmslam.geometry.se2 import SE2
from tbmslam.map.drive import Drive, DriveLinks
from tbmslam.map.map_check import check_geometry
from tbmslam.map.map_image import PixelRule, occupancy_of_image, read_image


@dataclass(frozen=True, repr=False)
class TbmMap:
    """A map with a drive of a robot, with several drives after a merge, or with none if it was a picture."""

    grid: TbmGrid
    drives: tuple[Drive, ...] = ()
    """The drives of the map, in its frame."""
    provenance: Mapping[str, object] = field(default_factory=dict)
    """Origin of the map: recording, configuration, versions; any JSON."""
    links: DriveLinks | None = None
    """Loop closures between the drives of a merged map; None if there are none, or they are unknown."""

    def __post_init__(self) -> None:
        """Check that the links are between keyframes."""
        if self.links is not None:
            self.links.check(self.drives)

    def __repr__(self) -> str:
        """Return its size and its drives in a line."""
        drives = f"; drives of {', '.join(drive.name for drive in self.drives)}" if self.drives else ""
        return f"TbmMap({self.grid.summary()}{drives})"

    def _repr_png_(self) -> bytes | None:
        """Return the picture that a notebook shows; see `TbmGrid`."""
        return self.grid._repr_png_()

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the size and the drives in a line, and the picture."""
        line, picture = f"<p>{html.escape(repr(self))}</p>", self._repr_png_()
        if picture is None:
            return line
        return f'{line}<img alt="the map" src="data:image/png;base64,{base64.b64encode(picture).decode("ascii")}">'

    @classmethod
    def from_occupancy(
        cls, occupancy: npt.ArrayLike, resolution: float, origin: tuple[float, float] = (0.0, 0.0)
    ) -> "TbmMap":
        """Return the map of an array of occupancies, as `nav_msgs/OccupancyGrid` holds them.

        Parameters
        ----------
        occupancy
            Integers (rows, cols): 0 free to 100 occupied, -1 unknown; row grows with y.
        resolution
            Side of a cell [m].
        origin
            Outer corner (x, y) of cell (0, 0) [m].

        Raises
        ------
        ValueError
            If the array holds other values, or the geometry is impossible.
        """
        cells = np.asarray(occupancy)
        if cells.ndim != 2 or not cells.size or cells.dtype.kind not in "iu":
            raise ValueError(f"occupancy must be integers (rows, cols), got {cells.dtype} of shape {cells.shape}")
        if cells.min() < -1 or cells.max() > 100:
            raise ValueError(f"occupancy must be from -1 to 100, got {cells.min()} to {cells.max()}")
        geometry = GridGeometry(float(resolution), float(origin[0]), float(origin[1]), *cells.shape)
        return cls(TbmGrid(geometry, masses_from_occupancy(cells.astype(np.int8))))

    @classmethod
    def from_image(
        cls, path: str | os.PathLike[str], resolution: float, origin: tuple[float, float] = (0.0, 0.0)
    ) -> "TbmMap":
        """Read a picture of a map, such as a floor plan: white is free, black occupied, and grey (205) unknown.

        Pixels have the meaning that nav2 uses by default, see `PixelRule`.

        Parameters
        ----------
        path
            PNG, PGM, or another format that OpenCV reads.
        resolution
            Side of a pixel [m].
        origin
            Outer corner (x, y) of the lower left pixel [m].

        Raises
        ------
        MapFileError
            If there is no such picture, or it is no map's.
        """
        image = read_image(Path(path))
        rows, cols = image.pixels.shape[:2]
        check_geometry(path, GridGeometry(float(resolution), float(origin[0]), float(origin[1]), rows, cols))
        return cls.from_occupancy(occupancy_of_image(image, PixelRule()), resolution, origin)

    def to_occupancy(self) -> npt.NDArray[np.int8]:
        """Return the cells (rows, cols) as `nav_msgs/OccupancyGrid` holds them: 0 free, 100 occupied, -1 unknown."""
        return occupancy_of(self.grid)

    def crop(self, min_x: float, min_y: float, max_x: float, max_y: float) -> "TbmMap":
        """Return the part of the map within a rectangle [m], to whole cells; the drives stay whole.

        Raises
        ------
        ValueError
            If the rectangle holds no cell of the map.
        """
        return replace(self, grid=self.grid.cropped(min_x, min_y, max_x, max_y))

    def rotate(self, theta: float) -> "TbmMap":
        """Return the map turned anticlockwise about the origin of its frame [rad]; see `resample` of grids."""
        T_new_old = SE2(0.0, 0.0, theta)
        return self.moved(T_new_old, resample(self.grid, T_new_old, canvas_of(self.grid.geometry, T_new_old)))

    def resample(self, resolution: float) -> "TbmMap":
        """Return the map with cells of another size [m]."""
        if not resolution > 0.0:
            raise ValueError(f"resolution must be positive, got {resolution}")
        geometry = self.grid.geometry
        finer = geometry.resolution / resolution
        size = {"rows": math.ceil(geometry.rows * finer - 1e-6), "cols": math.ceil(geometry.cols * finer - 1e-6)}
        cells = geometry._replace(resolution=float(resolution), **size)
        return replace(self, grid=resample(self.grid, SE2.identity(), cells))

    def plot(self, ax: Any = None) -> Any:
        """Draw the map and its drives with matplotlib, where that is installed.

        Parameters
        ----------
        ax
            Axes to draw on; None for new axes.

        Returns
        -------
        The axes, in metres of the map's frame.
        """
        if ax is None:
            try:
                import matplotlib.pyplot as plt  # noqa: PLC0415  # an extra, and slow to load
            except ModuleNotFoundError as error:
                raise ModuleNotFoundError(
                    "plot() needs matplotlib, which is not installed: pip install matplotlib"
                ) from error

            ax = plt.figure().add_subplot()
        min_x, min_y, max_x, max_y = self.grid.geometry.bounds()
        ax.imshow(
            1.0 - self.grid.pignistic(), cmap="gray", vmin=0.0, vmax=1.0, origin="lower",
            extent=(min_x, max_x, min_y, max_y), interpolation="nearest",
        )  # fmt: skip
        for drive in self.drives:
            ax.plot(*drive.trajectory.poses[:, :2].T, linewidth=1.0, label=drive.name)
        ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        if self.drives:
            ax.legend()
        return ax

    def moved(self, T_new_old: SE2, grid: TbmGrid) -> "TbmMap":
        """Return the map in another frame, with transformed drives and the given resampled grid."""
        return replace(self, grid=grid, drives=tuple(drive.transformed(T_new_old) for drive in self.drives))
