"""Keypoints of grids and their matches; a grid is drawn as images of its decision value and its masses.

An image's first row is the map's largest y; the flip between the two happens here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import Descriptor, FeatureConfig
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.grids.channels import draw_channels
from tbmslam.parallel.worker_pool import in_threads

Image = npt.NDArray[np.uint8]

_OUTSIDE = (128, 0, 0, 255)
"""Values of unseen cells in the pignistic, the occupied, the free and the unknown image."""


@dataclass(frozen=True)
class Channels:
    """8-bit images (rows, cols) of a grid, one pixel a cell; the paper's figure 1."""

    geometry: GridGeometry
    """Geometry of the images' cells in the grid's frame."""
    pignistic: Image
    """Probability of being free: free is white, occupied black, unknown grey."""
    occupied: Image
    free: Image
    unknown: Image
    """The mass on each, 255 for all of it. The conflict is normalised first, as in the paper."""

    @classmethod
    def from_grid(cls, grid: TbmGrid, border: int = 0) -> "Channels":
        """Draw a grid with a border of unknown cells.

        Keypoint detectors keep away from the edges of an image; a border gives the walls there a chance.
        """
        geometry = _widened(grid.geometry, border)
        images = np.empty((4, geometry.rows, geometry.cols), dtype=np.uint8)
        images[:] = np.array(_OUTSIDE, dtype=np.uint8)[:, None, None]
        draw_channels(grid.masses, border, images)
        pignistic, occupied, free, unknown = images
        return cls(geometry, pignistic, occupied, free, unknown)

    def to_metres(self, pixels: npt.ArrayLike) -> FloatArray:
        """Carry image coordinates (N, 2), x to the right, y down, pixel centres whole, to the grid's frame [m]."""
        xy = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        geometry = self.geometry
        x = geometry.origin_x + (xy[:, 0] + 0.5) * geometry.resolution
        y = geometry.origin_y + (geometry.rows - 0.5 - xy[:, 1]) * geometry.resolution
        return np.column_stack((x, y))


def flipped(cells: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Turn an array of cells (rows, cols, ...) into an image, or an image into cells."""
    return np.ascontiguousarray(cells[::-1])


def _widened(geometry: GridGeometry, border: int) -> GridGeometry:
    return GridGeometry(
        geometry.resolution,
        geometry.origin_x - border * geometry.resolution,
        geometry.origin_y - border * geometry.resolution,
        geometry.rows + 2 * border,
        geometry.cols + 2 * border,
    )


ORB_EDGE = 31
"""ORB finds no keypoints nearer than this to an image's edge [px]."""

_BITWISE: dict[Descriptor, np.ufunc] = {"and": np.bitwise_and, "or": np.bitwise_or, "xor": np.bitwise_xor}


@dataclass(frozen=True)
class Features:
    """Keypoints of one map."""

    points: FloatArray
    """Positions (N, 2) in the map's frame [m]."""
    descriptors: npt.NDArray[np.uint8]
    """Descriptors (N, bytes)."""

    @classmethod
    def none(cls) -> "Features":
        """Return no keypoints."""
        return cls(np.empty((0, 2)), np.empty((0, 0), dtype=np.uint8))

    def __len__(self) -> int:
        """Return the number of keypoints."""
        return len(self.points)


@dataclass(frozen=True)
class Matches:
    """Matched keypoints of two maps: row i of one map belongs to row i of the other."""

    target_points: FloatArray
    source_points: FloatArray
    """Positions (M, 2), each in the frame of its map [m]."""

    def __len__(self) -> int:
        """Return the number of matches."""
        return len(self.target_points)


def describe(grid: TbmGrid, config: FeatureConfig) -> Features:
    """Find and describe the keypoints of a grid; a grid without contrast has none."""
    return describe_all([grid], config)[0]


def describe_all(grids: Sequence[TbmGrid], config: FeatureConfig) -> list[Features]:
    """Find and describe the keypoints of grids side by side; see `describe`."""
    looks = in_threads(lambda grid: _detect(grid, config), grids)
    tasks = [(image, keypoints) for channels, keypoints in looks for image in _described_images(channels, config)]
    # ORB drops and reorders keypoints by their place and octave alone, so in the same way on every image.
    described = in_threads(lambda task: orb_of(config).compute(*task), tasks)
    each = len(tasks) // max(len(looks), 1)
    return [
        _features_of(channels, described[each * index : each * (index + 1)], config.descriptor)
        for index, (channels, _) in enumerate(looks)
    ]


def _detect(grid: TbmGrid, config: FeatureConfig) -> tuple[Channels, Sequence[cv2.KeyPoint]]:
    channels = Channels.from_grid(grid, border=ORB_EDGE + 1)
    return channels, orb_of(config).detect(channels.pignistic, None)


def _described_images(channels: Channels, config: FeatureConfig) -> list[Image]:
    if config.descriptor == "pignistic":
        return [channels.pignistic]
    return [channels.occupied, channels.free, channels.unknown]


def _features_of(
    channels: Channels, described: Sequence[tuple[Sequence[cv2.KeyPoint], object]], how: Descriptor
) -> Features:
    """Return the features of a grid from the keypoints and descriptors of each of its images."""
    if not described[0][0] or any(descriptors is None for _, descriptors in described):
        return Features.none()
    points = channels.to_metres(cv2.KeyPoint.convert(described[0][0]))
    return Features(points, joined([np.asarray(descriptors, dtype=np.uint8) for _, descriptors in described], how))


def match(target: Features, source: Features, config: FeatureConfig) -> Matches:
    """Match the source's keypoints to the target's; fewer than two keypoints on a side match nothing."""
    if len(target) < 2 or len(source) < 2:
        return Matches(np.empty((0, 2)), np.empty((0, 2)))
    distances, nearest = cv2.batchDistance(  # what cv2.BFMatcher calls, without an object for every pair
        source.descriptors, target.descriptors, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=2
    )
    kept = np.flatnonzero(distances[:, 0] < config.ratio * distances[:, 1])
    return Matches(target.points[nearest[kept, 0]], source.points[kept])


def orb_of(config: FeatureConfig) -> cv2.ORB:
    """Return the detector and describer of keypoints."""
    return cv2.ORB.create(
        nfeatures=config.keypoints,
        scaleFactor=config.pyramid_step,
        nlevels=config.pyramid_levels,
        edgeThreshold=ORB_EDGE,
        fastThreshold=config.fast_threshold,
    )


def joined(descriptors: list[npt.NDArray[np.uint8]], how: Descriptor) -> npt.NDArray[np.uint8]:
    """Combine the descriptors (N, bytes) of the images; the paper's table II compares the combinations."""
    if how in _BITWISE:
        return np.asarray(_BITWISE[how].reduce(descriptors), dtype=np.uint8)
    return np.hstack(descriptors)
