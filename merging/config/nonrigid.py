"""Every number of the registration of a map that is deformed."""

from typing import Annotated, ClassVar

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share


class NonrigidConfig(FrozenConfig):
    """Non-rigid registration of pairs that no rigid transform aligns; see `merging.nonrigid.search`.

    Parameters
    ----------
    enabled
        Whether refused pairs are registered non-rigidly.
    side_m
        Side of the tiles that slide at first, about [m]; later ones have half of it.
    most
        Tiles of a map at the most; those of larger maps are larger.
    places
        So many of the places that the correlation likes most are tried.
    rivals
        So many more of them, and of those that fit best as they are, must not fit as well once they are bent too.
    min_agreement, min_wall_m
        A tile says where it belongs if so large a share of its walls that can be compared agrees, and so much [m].
    farthest_m
        How far a tile may slide from where its neighbours have it [m].
    """

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = True
    side_m: Metres = 16.0
    most: Annotated[int, Field(ge=2)] = 24
    places: Count = 1
    rivals: Count = 8
    min_agreement: Share = 0.5
    min_wall_m: Metres = 3.0
    farthest_m: Metres = 1.0
