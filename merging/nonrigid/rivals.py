"""Places of a map that is bent to fit each of them as well as it can, and places of its mirror image, bent as well."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merging.config import MergeConfig
from merging.nonrigid.tile_registration import DeformableMap, deform
from merging.registration.correlation import propose
from merging.registration.hypotheses import best_of, elsewhere, refine_all
from merging.scoring.decoys import mirrored
from merging.verification.evidence import Evidence, examine
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2


@dataclass(frozen=True)
class DeformedRivals:
    """What speaks for and against each place once the map is bent to fit there.

    Parameters
    ----------
    motions
        T_target_source (K,), roughly; of the place in question first.
    evidence
        Of each of them (K,).
    decoys
        Of places of the mirror image (D,).
    """

    motions: Sequence[SE2]
    evidence: Sequence[Evidence]
    decoys: Sequence[Evidence]

    @classmethod
    def of(
        cls, target: WallMap, source: DeformableMap, place: SE2, proposals: list[SE2], config: MergeConfig
    ) -> "DeformedRivals":
        """Deform a map at a place, at its rivals, and its mirror image at its own.

        Parameters
        ----------
        target
            The other map.
        source
            The map.
        place
            The place in question, T_target_source.
        proposals
            Places of the source, the best from afar first.
        config
            How maps are bent, and what is looked at.
        """
        mirror = DeformableMap.of(mirrored(source.grid), config)
        decoys = _rivals(target, mirror, propose(target, mirror.structure, config.correlation), config)
        places = [place, *_rivals(target, source, proposals, config)]
        motions = first_apart(places, source.structure, len(places))
        own, others = (
            [_evidence(target, one, motion, config) for motion in some]
            for one, some in ((source, motions), (mirror, decoys))
        )
        return cls(motions, own, others)


def first_apart(places: list[SE2], source: WallMap, count: int) -> list[SE2]:
    """Return so many of the first places, none near a better one."""
    return elsewhere(places, -np.arange(len(places), dtype=np.float64), source, count)


def _rivals(target: WallMap, source: DeformableMap, proposals: list[SE2], config: MergeConfig) -> list[SE2]:
    """Return the places that look best from afar, and those that fit best as they are."""
    fitting = [place for place, _ in best_of(proposals, target, source.structure, config)]
    some = [*first_apart(proposals, source.structure, config.nonrigid.rivals), *fitting[: config.nonrigid.rivals]]
    return first_apart(some, source.structure, len(some))


def _evidence(target: WallMap, source: DeformableMap, place: SE2, config: MergeConfig) -> Evidence:
    """Return what speaks for and against a place once the map is bent to fit there; as it is where it cannot be."""
    bent = deform(target, source, place, config)
    structure = source.structure if bent is None else WallMap.from_grid(bent.grid, config.structure)
    motion = refine_all(target, structure, [place if bent is None else bent.motion], config)[0]
    return examine(target, structure, motion, config.verification)
