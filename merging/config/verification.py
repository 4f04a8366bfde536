"""Every number of the judgement of a hypothesis, and of how exact it is."""

from typing import Annotated, ClassVar

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig, Metres, Share
from tbmslam.wall_limits import FACING, Limits


class VerificationConfig(FrozenConfig):
    """When an alignment is believed.

    Parameters
    ----------
    agreement_distance_m
        How near to a wall of the other map, seen from the same side, a wall must lie to agree [m].
    conflict_distance_m
        How far from every wall of the other map a wall on its free space must lie to contradict it [m].
    see_through_m
        A map that knows so much free space before and behind a wall, and nothing else, saw through it [m].
    front_m
        How far before a wall the other robot must have seen free space to have seen the wall [m].
    other_weight
        What a metre of wall that the other robot should have seen where it is, and did not, costs when candidates are
        chosen, in metres of agreeing wall.
    min_confidence
        Least probability of an alignment that is accepted.
    min_overlap_m2
        Least area known to both maps.
    min_ambiguous_wall_m, min_ambiguous_agreement, ambiguous_share
        Refused maps are called ambiguous, and not foreign, where the best place has so much agreeing wall, such a share
        of the compared walls agrees, and another place is at least so likely, as a share of the best one's.
    """

    PUBLIC: ClassVar = ("min_confidence", "min_overlap_m2")

    agreement_distance_m: Metres = 0.15
    conflict_distance_m: Metres = 0.3
    see_through_m: Metres = 0.5
    front_m: Metres = 0.3
    other_weight: Annotated[float, Field(ge=0.0)] = 0.6
    min_confidence: Share = 0.85
    min_overlap_m2: Annotated[float, Field(ge=0.0)] = 2.0
    min_ambiguous_wall_m: Annotated[float, Field(ge=0.0)] = 8.0
    min_ambiguous_agreement: Share = 0.7
    ambiguous_share: Share = 0.3

    def limits(self) -> Limits:
        """Return the distances as the kernels take them."""
        return Limits(self.agreement_distance_m, self.conflict_distance_m, self.front_m, FACING)


class ExactnessConfig(FrozenConfig):
    """How exactly agreeing walls tell where a map lies; see `merging.verification.covariance`.

    Parameters
    ----------
    wall_m
        Standard deviation of where a metre of wall lies beside where it should, in two maps that are bent [m].
    place_m, turn_rad
        Standard deviations of an alignment that was found, before any wall is counted.
    bend_m, bend_rad
        What stays however many walls agree: maps have cells, and long drives bend as a whole [m], [rad].
    """

    wall_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.08
    place_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.075
    turn_rad: Annotated[float, Field(ge=1e-4, le=1e1)] = 0.0285
    bend_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.015
    bend_rad: Annotated[float, Field(ge=1e-5, le=1e1)] = 0.003
