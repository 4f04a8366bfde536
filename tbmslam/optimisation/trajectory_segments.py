"""Drives in short stretches that move as one: over a metre a tracker is exact."""

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray, compose, inverse, path_lengths, wrap_angles
from tbmslam.kernels.adjustment.wall_pieces import StretchHits, gather_hits
from tbmslam.map.scan_hits import ScanHits
from tbmslam.map.trajectory_correction import spread_corrections
from tbmslam.optimisation.config import AdjustmentConfig
from tbmslam.optimisation.pose_chain import MotionChain
from tbmslam.optimisation.pose_graph import MotionEdge

_MOST_HITS = 4_000_000
"""So many of all keyframes together are enough; half a gigabyte holds what is made of them."""


class RigidStretches:
    """The stretches of some drives.

    Parameters
    ----------
    poses
        Poses (K, 3) of the laser at the keyframes of all drives, one drive after the other.
    counts
        How many keyframes each drive has.
    config
        How long a stretch is.

    Attributes
    ----------
    middles
        The keyframe (N,) whose pose stands for each stretch.
    owners
        The stretch (K,) of each keyframe.
    ends
        Which stretch is each drive's first, and where the last one's end (D + 1,).
    places
        Poses (K, 3) of the keyframes in their stretches' frames.
    """

    def __init__(self, poses: FloatArray, counts: Sequence[int], config: AdjustmentConfig) -> None:
        self._poses = poses
        self._drive_ends = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        begins = [first + stretch_begins(poses[first:last], config) for first, last in self._drives()]
        self._starts = starts = np.concatenate(begins)
        ends = np.append(starts[1:], len(poses))
        self.ends = np.cumsum([0, *map(len, begins)]).tolist()
        self.middles: npt.NDArray[np.int64] = (starts + ends - 1) // 2
        self.owners: npt.NDArray[np.int64] = np.repeat(np.arange(len(starts)), ends - starts)
        self.places = compose(inverse(poses[self.middles][self.owners]), poses)

    def between(self, chain: Sequence[MotionEdge]) -> list[MotionEdge]:
        """Return the motions from the middle of each stretch to that of the next of its drive.

        `chain` are those from each keyframe to the next, without any from one drive to another.
        """
        motions, begin = list[MotionEdge](), 0
        for number, (first, last) in enumerate(self._drives()):
            own = chain[begin : begin + last - first - 1]
            begin += len(own)
            middles = self.middles[self.ends[number] : self.ends[number + 1]]
            motions += [
                MotionEdge(first + edge.source, first + edge.target, edge.T_source_target, edge.information)
                for edge in MotionChain(own).between(middles - first)
            ]
        return motions

    def hits(self, drives: Sequence[ScanHits], config: AdjustmentConfig) -> StretchHits:
        """Return what the stretches hit."""
        of_each = min(config.hits, max(_MOST_HITS // len(self._poses), 1))
        parts, limits = [], (config.max_range, config.gap, config.bulge)
        for scans, (first, last) in zip(drives, self._drives(), strict=True):
            every = max(len(scans.points) // (of_each * max(len(scans), 1)), 1)
            places = self.places[first:last]
            part, sines = gather_hits(scans.points, scans.normals, scans.offsets, places, every, limits)
            part.walls[:, 2] = np.arctan2(sines, part.walls[:, 2])
            parts.append(part)
        return StretchHits(
            _stacked([part.walls for part in parts]),
            self._begins([part.wall_begins for part in parts]),
            _stacked([part.loose for part in parts]),
            self._begins([part.loose_begins for part in parts]),
        )

    def _begins(self, of_keyframes: Sequence[npt.NDArray[np.int64]]) -> npt.NDArray[np.int64]:
        """Return where the hits of each stretch begin, where those of the keyframes of each drive are known."""
        begins = np.zeros(1, dtype=np.int64)
        for own in of_keyframes:
            begins = np.concatenate((begins, begins[-1] + own[1:]))
        of_stretches: npt.NDArray[np.int64] = begins[np.append(self._starts, len(self._poses))]
        return of_stretches

    def moved(self, stretches: FloatArray) -> FloatArray:
        """Return the poses (K, 3) of the keyframes where the stretches are at other poses (N, 3)."""
        parts = []
        for number, (first, last) in enumerate(self._drives()):
            own = slice(self.ends[number], self.ends[number + 1])
            parts.append(spread_corrections(self._poses[first:last], self.middles[own] - first, stretches[own]))
        return np.vstack(parts)

    def _drives(self) -> list[tuple[int, int]]:
        return list(itertools.pairwise(self._drive_ends.tolist()))


def _stacked(parts: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Return rows of drives one after the other; those of a single one are not copied."""
    return parts[0] if len(parts) == 1 else np.vstack(parts)


def stretch_begins(poses: FloatArray, config: AdjustmentConfig) -> npt.NDArray[np.int64]:
    """Return the keyframes of a drive at which stretches begin."""
    turns = np.cumsum(np.abs(wrap_angles(np.diff(poses[:, 2], prepend=poses[:1, 2]))))
    marks = np.column_stack((path_lengths(poses) // config.stretch, turns // config.turn))
    return np.flatnonzero(np.concatenate(([True], (marks[1:] != marks[:-1]).any(axis=1)))).astype(np.int64)
