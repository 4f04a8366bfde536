"""The headings of a drive by odometry, weighed by their drift over whole loops.

The noise learnt per keyframe cannot tell errors that add up from errors that cancel, nor the odometry's errors from
those of the scans. Loop closures measure both chains over hundreds of metres. On a real drive among trees (fr-clinic)
the headings by odometry err by 0.06 rad at the closures where their noise per keyframe predicts 0.3 rad; headings by
scans err by 0.19 rad. The difference of both chains alone would not show which of them drifts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray, compose, wrap_angles
from tbmslam.map.drive import DriveMotions
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry


class OdometryHeadings(NamedTuple):
    """Turns of the laser between keyframes by odometry alone."""

    turns: FloatArray
    """(K - 1,) [rad]; nan if unknown."""
    variances: FloatArray
    """Their variances (K - 1,) by the noise learnt per keyframe and the trust in each [rad^2]; inf if unknown."""
    trusts: FloatArray
    """(K - 1,) in [0, 1]; below 1 where the scan contradicts the odometry, for example after a slip."""

    @classmethod
    def of(cls, keyframes: Sequence[TrackedKeyframe]) -> "OdometryHeadings":
        """Return the turns between keyframes."""
        headings = odometry(keyframes)[:, 2] + np.array([keyframe.T_robot_sensor.theta for keyframe in keyframes])
        turns = wrap_angles(np.diff(headings))
        variances = np.linalg.inv([keyframe.prior for keyframe in keyframes[1:]])[:, 2, 2]
        variances[[keyframe.follows_gap for keyframe in keyframes[1:]]] = np.inf
        trusts = np.minimum([keyframe.match.trust for keyframe in keyframes[1:]], 1.0)
        return cls(turns, np.where(np.isfinite(turns), variances, np.inf), trusts)

    def drift(self, closures: Sequence[MotionEdge]) -> float:
        """Return the ratio of the squared errors at closures to their expectation from independent turns.

        1 if no closure spans known turns. A closure cannot show errors below its own noise, which is counted as an
        error. So a single loop that closes by chance does not make the odometry perfect. The expectation is of the
        learnt noise alone, so that a slip that the closures confirm counts as drift.
        """
        ends, motions, informations = EdgeArrays.of(closures)
        first, last = np.sort(ends, axis=1).T
        is_known = np.isfinite(self.variances)
        sums = [
            np.concatenate(([0.0], np.cumsum(np.where(is_known, values, 0.0))))
            for values in (self.turns, self.variances * self.trusts, ~is_known)
        ]
        turned, expected, unknown = (values[last] - values[first] for values in sums)
        measured = np.where(ends[:, 0] <= ends[:, 1], motions[:, 2], -motions[:, 2])
        errors = wrap_angles(turned - measured) ** 2 + np.linalg.inv(informations)[:, 2, 2]
        usable = (unknown == 0.0) & (expected > 0.0)
        return float(errors[usable].sum() / expected[usable].sum()) if usable.any() else 1.0

    def fused(self, motions: DriveMotions, drift: float) -> DriveMotions:
        """Return motions between keyframes fused with these turns, for a `drift` below 1.

        The turns' variances are the sum of a part that adds up and of jitter, which the next turn takes back. The
        motions know the odometry already as independent turns. So only the information beyond that is added. Jitter is
        smoothed out of the difference of both headings, and their variances share the rest of it.
        """
        more = (1.0 / drift - 1.0) / self.variances
        covariances = np.linalg.inv(motions.informations)
        own = covariances[:, 2, 2]
        apart = np.where(more > 0.0, wrap_angles(self.turns - motions.steps[:, 2]), 0.0)
        links = more / (1.0 + own * more)
        jitter = 0.5 * (1.0 - drift) * self.variances
        steady = np.diff(_smoothed(np.cumsum(np.append(0.0, apart)), links, 1.0 / np.append(jitter[0], jitter)))
        # A change of the heading also moves the end of a step, as far as their errors are correlated.
        corrections = covariances[:, :, 2] * (links * steady)[:, None]
        informations = motions.informations.copy()
        informations[:, 2, 2] += more
        return DriveMotions(compose(motions.steps, corrections), informations)


def _smoothed(values: FloatArray, links: FloatArray, weights: FloatArray) -> FloatArray:
    """Return smooth values (K,): a random walk with noise, by Thomas' algorithm.

    `links` (K - 1,) are the inverse variances of its steps, and `weights` (K,) those of the values.
    """
    between = links.tolist()
    own = (weights + np.append(links, 0.0) + np.append(0.0, links) + _LEAST).tolist()
    right = (weights * values).tolist()
    for k, link in enumerate(between):
        ratio = link / own[k]
        own[k + 1] -= ratio * link
        right[k + 1] += ratio * right[k]
    right[-1] /= own[-1]
    for k in range(len(between) - 1, -1, -1):
        right[k] = (right[k] + between[k] * right[k + 1]) / own[k]
    return np.array(right)


_LEAST = 1e-9
"""Weight of zero where nothing is known, so that the equations have a solution."""


def laid_out(start: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the poses (K, 3) from the first one (3,) along steps (K - 1, 3)."""
    headings = start[2] + np.append(0.0, np.cumsum(steps[:, 2]))
    cosines, sines = np.cos(headings[:-1]), np.sin(headings[:-1])
    along_x = np.cumsum(cosines * steps[:, 0] - sines * steps[:, 1])
    along_y = np.cumsum(sines * steps[:, 0] + cosines * steps[:, 1])
    places = np.column_stack((np.append(0.0, along_x), np.append(0.0, along_y)))
    return np.column_stack((start[:2] + places, wrap_angles(headings)))
