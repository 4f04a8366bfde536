"""The rivals of a pose at which a map was deformed: other poses of the map, and poses of its mirror image."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merging.nonrigid.deformation import DeformableMap
from merging.nonrigid.hypotheses import DeformedPose, DeformedPoses
from merging.registration.correlation import best_distinct, best_of
from merging.verification import Evidence
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2


@dataclass(frozen=True)
class DeformedRivals:
    """The evidence for a pose and for its rivals, each after the map was deformed to fit there."""

    motions: Sequence[SE2]
    """T_target_source (K,) of the deformed maps; the pose in question is the first."""
    evidence: Sequence[Evidence]
    """The evidence for each of them (K,)."""
    decoys: Sequence[Evidence]
    """The evidence for poses of the mirror image (D,)."""

    @classmethod
    def of(cls, poses: DeformedPoses, pose: DeformedPose) -> "DeformedRivals":
        """Deform a map at the rivals of a pose, and deform its mirror image at the best poses of the image.

        Rivals that end at the same place, or at the place of the tested pose, count once.
        """
        mirror = DeformableMap.of(poses.source.grid.mirrored(), poses.config)
        mirrored = DeformedPoses(poses.target, mirror, poses.config)
        rivals = [pose, *poses.best(_rivals(poses))]
        evidence = {rival.motion: rival.evidence for rival in rivals}
        motions = first_distinct(list(evidence), poses.source.structure, len(evidence))
        decoys = [decoy.evidence for decoy in mirrored.best(_rivals(mirrored))]
        return cls(motions, [evidence[motion] for motion in motions], decoys)


def first_distinct(poses: list[SE2], source: WallMap, count: int) -> list[SE2]:
    """Return the first poses, at most `count`, without those near an earlier one."""
    return best_distinct(poses, -np.arange(len(poses), dtype=np.float64), source, count)


def _rivals(poses: DeformedPoses) -> list[SE2]:
    """Return the first poses of the correlation, and those that fit best without deformation."""
    source, config = poses.source.structure, poses.config
    fitting = [pose for pose, _ in best_of(poses.proposals, poses.target, source, config)]
    rivals = [*first_distinct(poses.proposals, source, config.nonrigid.rivals), *fitting[: config.nonrigid.rivals]]
    return first_distinct(rivals, source, len(rivals))
