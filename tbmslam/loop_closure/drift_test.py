"""Test of proposed loop closures against the motions of the drive.

In a corridor of equal doors several stops may agree on a wrong place, while no target shows the true one yet. Two
measurements decide. The pose graph gives the covariance of the drift. Hits in the free space of the target contradict
the pose without the closure. A place far beyond the drift is accepted only with such hits.
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
"""Increase of that limit if all hits of a bundle lie in free space: twice 4 nats for each of the 25 independent hits
that a stop adds, as if one hit of fifty lay on no known surface at the right pose."""


class DriftTest:
    """Tests proposed places against the motions of the drive.

    Closures have a robust kernel of `robust_width` standard deviations. A bundle covers a `length` of the path before
    and after a keyframe [m] and has a number of `points`.
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
        self, elected: Sequence[PlacedBundle], covariance: FloatArray, poses: FloatArray, closures: Sequence[MotionEdge]
    ) -> bool:
        """Return whether the drift and the free space allow elected poses, given in the order of the drive.

        `covariance` (3, 3) is that of the last fit, in its keyframe's frame. `poses` (K, 3) are those of the laser at
        the keyframes. `closures` are the earlier closures.
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
        """Return the squared Mahalanobis distance of an elected pose from the keyframe's pose."""
        ends = {end for edge in closures for end in (edge.source, edge.target)}
        chain = self._chain.between(np.array(sorted(ends | {found.anchor, found.keyframe})))
        drift = relative_covariance(poses, chain, closures, self._robust_width, found.anchor, found.keyframe)
        error = np.array(found.pose.to(relative_pose(poses, found.anchor, found.keyframe)))
        return float(error @ np.linalg.solve(drift + covariance, error))

    def _violated_before(self, found: PlacedBundle, poses: FloatArray) -> float:
        """Return the share of a bundle in the free space of a target at the pose without the closure."""
        bundle = self._hits.bundle(found.keyframe, *self._bundle)
        guess = relative_pose(poses, found.anchor, found.keyframe)
        return self._targets.submap(found.target).fit(bundle, guess).violated
