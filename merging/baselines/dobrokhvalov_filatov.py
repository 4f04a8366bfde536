"""Dobrokhvalov and Filatov, the paper on which this project is based: every transform of the keypoints is accepted.

M. Dobrokhvalov, A. Filatov, "Merging occupancy grid map based on Transferable Belief Model", SEIM 2021. The keypoints,
their descriptors on three masses and their matches are those of `--method features`. That method also confirms and
refines a transform by the walls. The paper's program accepts any transform that it can fit to three matches or more.
The rule `disjunctive` fuses cells.

Choice of this project: The motion is rigid, as in the paper's text. The paper's program also stretches and shears.
"""

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.registration.features import describe_all, match
from merging.registration.ransac import find_consensus
from tbmslam.belief.grid import TbmGrid

_ENOUGH = 3  # least number of matches for the program's affine transform


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame."""
    features = describe_all([target, source], config.features)
    matches = match(features[0], features[1], config.features)
    rigid = config.consensus.model_copy(update={"min_inliers": _ENOUGH})
    consensus = find_consensus(matches, rigid)
    if consensus is None or consensus.count < _ENOUGH:
        reason = f"no {_ENOUGH} of {len(matches)} matches agree on a motion"
        return Alignment("dobrokhvalov-filatov", accepted=False, reason=reason, matches=len(matches))
    return Alignment(
        method="dobrokhvalov-filatov",
        accepted=True,
        reason=f"{consensus.count} of {len(matches)} matches agree",
        T_target_source=consensus.T_target_source,
        matches=len(matches),
        inliers=consensus.count,
        rmse_m=consensus.rmse_m,
        scale=consensus.scale,
    )
