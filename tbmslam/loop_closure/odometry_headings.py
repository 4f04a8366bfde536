"""The headings of a drive by odometry, weighed by their drift over whole loops.

The noise learnt per keyframe tells neither errors that add up from errors that cancel, nor errors of the odometry from
those of the scans. Loop closures measure both over hundreds of metres. On fr-clinic, among trees, headings by odometry
err at closures by 0.03 rad (RMS), where their noise predicts 0.12 rad. Tracked headings err by 0.10 rad. On mit-csail,
aces and intel headings by odometry err by 0.4, 0.4 and 1.9 rad, and tracked headings by less than 0.05 rad. Without
closures nobody knows which of the two drifts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray, compose, wrap_angles
from tbmslam.loop_closure.heading_chain import HeadingChain
from tbmslam.map.drive import DriveMotions
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry

_UNKNOWN = 1e-9
"""Weight of a heading that nothing determines, so that the equations have a solution [1/rad^2]."""


class OdometryHeadings(NamedTuple):
    """Turns of the laser between keyframes by odometry alone."""

    turns: FloatArray
    """(K - 1,) [rad]; nan if unknown."""
    learnt: FloatArray
    """Their variances (K - 1,) by the noise learnt per keyframe [rad^2]; inf if unknown."""
    variances: FloatArray
    """The same, larger where a scan contradicted the odometry, for example after a slip."""

    @classmethod
    def of(cls, keyframes: Sequence[TrackedKeyframe]) -> "OdometryHeadings":
        """Return the turns between keyframes."""
        later = keyframes[1:]
        headings = odometry(keyframes)[:, 2] + np.array([keyframe.T_robot_sensor.theta for keyframe in keyframes])
        turns = wrap_angles(np.diff(headings))
        unknown = ~np.isfinite(turns) | np.array([keyframe.follows_gap for keyframe in later], dtype=np.bool_)
        stated = np.linalg.inv(np.array([keyframe.prior for keyframe in later], dtype=np.float64))[:, 2, 2]
        variances: FloatArray = np.where(unknown, np.inf, stated)
        # Above 1 the trust is ignored, so that the learnt noise is rather too small and nothing is fused by mistake.
        trusts = np.minimum(np.array([keyframe.match.trust for keyframe in later], dtype=np.float64), 1.0)
        return cls(turns, variances * trusts, variances)

    def fused(self, motions: DriveMotions, closures: Sequence[MotionEdge]) -> DriveMotions | None:
        """Return motions between keyframes fused with these turns; None if these drift as their noise predicts.

        The motions contain the odometry already, as independent turns. So only the information beyond that is added, in
        units of the motions' own variances. One part of a turn's variance adds up, and the rest is jitter that the next
        turn takes back. Jitter is smoothed out of the difference of both headings.
        """
        covariances: FloatArray = np.asarray(np.linalg.inv(motions.informations), dtype=np.float64)
        own = covariances[:, 2, 2]
        drift = HeadingChain(self.turns, self.learnt).drift(closures)
        if not drift < 1.0:
            return None
        scale = HeadingChain(motions.steps[:, 2], own).drift(closures)
        more = scale * (1.0 / drift - 1.0) / self.variances
        apart = np.where(more > 0.0, wrap_angles(self.turns - motions.steps[:, 2]), 0.0)
        links = more / (1.0 + own * more)
        jitter = 0.5 * (1.0 - drift) * self.variances
        weights = 1.0 / np.concatenate((jitter[:1], jitter))
        steady = np.diff(_smoothed(np.concatenate(([0.0], np.cumsum(apart))), links, weights))
        # A change of the heading also moves the end of a step, as far as their errors are correlated.
        corrections = covariances[:, :, 2] * (links * steady)[:, None]
        informations = motions.informations.copy()
        informations[:, 2, 2] += more
        return DriveMotions(compose(motions.steps, corrections), informations)


def _smoothed(values: FloatArray, links: FloatArray, weights: FloatArray) -> FloatArray:
    """Return a random walk (K,) that was observed with noise, by Thomas' algorithm.

    `links` (K - 1,) are the inverse variances of its steps, and `weights` (K,) those of the observed values.
    """
    between = links.tolist()
    own = (weights + np.append(links, 0.0) + np.append(0.0, links) + _UNKNOWN).tolist()
    right = (weights * values).tolist()
    for k, link in enumerate(between):
        ratio = link / own[k]
        own[k + 1] -= ratio * link
        right[k + 1] += ratio * right[k]
    right[-1] /= own[-1]
    for k in range(len(between) - 1, -1, -1):
        right[k] = (right[k] + between[k] * right[k + 1]) / own[k]
    return np.array(right)
