"""Whether the motions of the drive allow a loop closure that votes elect.

In a corridor of equal doors several stops may agree on a wrong place, while no target shows the true one yet. Two
measurements decide. The pose graph says how far the drive may have drifted. The target says what contradicts the pose
without the closure: hits in space that it knows to be free. A place far beyond the drift needs such hits.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.loop_closure.candidates import ClosingTargets
from tbmslam.loop_closure.sequence_consistency import PlacedBundle
from tbmslam.map.scan_hits import DriveHits
from tbmslam.optimisation.graph_optimisation import relative_covariance
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose

_SURPRISING = 16.3
"""Squared Mahalanobis distance (three dimensions) that chance exceeds once in 1000. Right places of five real drives
stay below 10. Wrong doors of simulated hospitals reach 22 and 67, right places after reversed odometry 12 to 102."""

_CONTRADICTION = 200.0
"""What a share of 1 of a bundle in free space adds to that distance: twice 4 nats, the odds of a stray hit, for each of
25 independent hits that a stop adds."""


class DriftTest:
    """Tests elected places against the motions of the drive.

    Parameters
    ----------
    chain
        Motions between consecutive keyframes.
    targets
        The submaps that places refer to.
    hits
        What the drive's keyframes hit.
    robust_width
        Width of the kernel of closures [standard deviations].
    length, points
        Length of way before and after a keyframe [m] that a bundle covers, and the bundle's number of hits.
    """

    def __init__(
        self,
        chain: MotionChain,
        targets: ClosingTargets,
        hits: DriveHits,
        robust_width: float,
        length: float,
        points: int,
    ) -> None:
        self._chain, self._targets, self._hits, self._robust_width = chain, targets, hits, robust_width
        self._bundle = length, points

    def allows(
        self,
        elected: Sequence[PlacedBundle],
        covariance: FloatArray,
        poses: FloatArray,
        closures: Sequence[MotionEdge],
    ) -> bool:
        """Return whether the drive may have come to places.

        Parameters
        ----------
        elected
            Places that agree, in the order of the drive.
        covariance
            Of the last one's fit (3, 3), in its keyframe's frame.
        poses
            Poses (K, 3) of the laser at the keyframes.
        closures
            Loops that are closed already.
        """
        surprise = self._surprise(elected[-1], covariance, poses, closures)
        if surprise <= _SURPRISING:
            return True
        gains = defaultdict(list)
        for found in elected:
            gains[found.keyframe].append(self._violated_before(found, poses) - found.violated)
        return surprise <= _SURPRISING + _CONTRADICTION * sum(float(np.mean(gain)) for gain in gains.values())

    def _surprise(
        self, found: PlacedBundle, covariance: FloatArray, poses: FloatArray, closures: Sequence[MotionEdge]
    ) -> float:
        """Return the squared Mahalanobis distance of a place from where the drive has the keyframe."""
        ends = {end for edge in closures for end in (edge.source, edge.target)}
        chain = self._chain.between(np.array(sorted(ends | {found.anchor, found.keyframe})))
        drift = relative_covariance(poses, chain, closures, self._robust_width, found.anchor, found.keyframe)
        error = np.array(found.pose.to(relative_pose(poses, found.anchor, found.keyframe)))
        return float(error @ np.linalg.solve(drift + covariance, error))

    def _violated_before(self, found: PlacedBundle, poses: FloatArray) -> float:
        """Return which share of a bundle lies in the free space of a target without the closure."""
        bundle = self._hits.bundle(found.keyframe, *self._bundle)
        guess = relative_pose(poses, found.anchor, found.keyframe)
        return self._targets.submap(found.target).fit(bundle, guess).violated
