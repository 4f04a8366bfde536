"""The keyframes of the current drive, and the poses of the robot between them."""

import logging
from array import array
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray, compose, inverse, path_lengths, stacked
from tbmslam.map.drive import spread_corrections
from tbmslam.optimisation.pose_graph import MotionEdge, relative_pose
from tbmslam.tracking.forgetting import ForgettingConfig, may_be_forgotten
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe

logger = logging.getLogger(__name__)

_UNSETTLED = 20.0
"""Travelled length at the end of a drive in which no keyframe is forgotten [m]."""

_GAP = np.diag([0.05**-2.0, 0.05**-2.0, 0.01**-2.0])
"""Information of the motion across forgotten keyframes; closures on both sides are more accurate."""


class KeyframeBuffer:
    """The kept keyframes of a drive; their indices count the drive's readings.

    If there are many, redundant keyframes of known places are forgotten, so that memory grows with the explored area.
    The drive then continues as if it had not been there. Forgotten poses are stored relative to kept keyframes.
    """

    def __init__(self, config: ForgettingConfig) -> None:
        self.keyframes: list[TrackedKeyframe] = []
        self._config = config
        self._limit = config.limit
        self._settled = 0
        self._T_kept_tracked = SE2.identity()
        # Forgotten poses: reading, reading of the kept keyframe, and pose relative to its laser, five numbers.
        self._forgotten = array("d")

    def add(self, keyframe: TrackedKeyframe) -> None:
        """Keep a keyframe."""
        self.keyframes.append(keyframe.moved(self._T_kept_tracked) if self._forgotten else keyframe)

    def is_full(self) -> bool:
        """Return whether keyframes are to be forgotten now."""
        return len(self.keyframes) >= self._limit

    def forget(self, closed: FloatArray, closures: Sequence[MotionEdge]) -> None:
        """Forget redundant keyframes, given the poses (K, 3) of the laser after the loop closures."""
        travelled = path_lengths(closed)
        settled = int(np.searchsorted(travelled, travelled[-1] - _UNSETTLED))
        gone = may_be_forgotten(closed, closures, self._settled, settled, self._config)
        if gone.any():  # later keyframes may be forgotten next time
            settled = min(settled, int(np.flatnonzero(gone)[-1]))
        self._remember(closed, travelled, gone, settled)
        T_new_old = SE2.identity()
        kept: list[TrackedKeyframe] = []
        numbers = np.flatnonzero(~gone).tolist()
        for before, number in zip([0, *numbers], numbers, strict=False):
            keyframe = self.keyframes[number]
            if number > before + 1:
                T_new_old = (
                    kept[-1].match.T_map_sensor
                    @ relative_pose(closed, before, number)
                    @ keyframe.match.T_map_sensor.inverse()
                )
                match = keyframe.match._replace(information=None)
                keyframe = replace(keyframe, match=match, prior=_GAP, follows_gap=True)
            kept.append(keyframe.moved(T_new_old))
        logger.info("%d of %d keyframes kept, as the others show the same", len(kept), len(self.keyframes))
        self.keyframes = kept
        self._T_kept_tracked = T_new_old @ self._T_kept_tracked
        self._settled = int(np.count_nonzero(~gone[:settled]))
        self._limit = max(self._config.limit, 2 * len(kept))

    def corrected(self, poses: FloatArray, closed: FloatArray) -> FloatArray:
        """Return the poses (N, 3) of the robot at all readings by the corrected poses of the laser at the keyframes."""
        kept = np.array([k.index for k in self.keyframes], dtype=np.int64)
        sensor_poses = stacked([k.T_robot_sensor for k in self.keyframes])
        known = np.array(self._forgotten).reshape(-1, 5)
        forgotten, anchors = known[:, :2].astype(np.int64).T
        seen_from = closed[np.searchsorted(kept, anchors)]
        indices = np.concatenate((kept, forgotten))
        moved = np.vstack((compose(closed, inverse(sensor_poses)), compose(seen_from, known[:, 2:])))
        order = np.argsort(indices)
        return spread_corrections(poses, indices[order], moved[order])

    def _remember(self, closed: FloatArray, travelled: FloatArray, gone: BoolArray, settled: int) -> None:
        """Store poses of the robot in forgotten parts, a metre apart, relative to the nearest kept laser poses."""
        anchors = np.flatnonzero(~gone[:settled])
        _, stops = np.unique(travelled.astype(np.int64), return_index=True)
        for number in stops[gone[stops]].tolist():
            anchor = int(anchors[np.argmin(np.hypot(*(closed[anchors, :2] - closed[number, :2]).T))])
            keyframe = self.keyframes[number]
            pose = relative_pose(closed, anchor, number) @ keyframe.T_robot_sensor.inverse()
            self._forgotten.extend((keyframe.index, self.keyframes[anchor].index, *pose))
