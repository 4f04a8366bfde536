"""When two pieces of wall are one, or contradict each other."""

from typing import NamedTuple

FACING = 0.7
"""Least cosine between the normals of two pieces of wall that may be one wall seen from the same side."""


class Limits(NamedTuple):
    """Distances [m] and a cosine, as the kernels take them.

    Parameters
    ----------
    agreement
        Walls nearer to each other than this agree, if they face the same way.
    conflict
        A wall on free space farther than this from every wall contradicts.
    front
        How far before a wall one looks whether another robot was there to see it.
    facing
        Least cosine between the normals of walls that may be one.
    """

    agreement: float
    conflict: float
    front: float
    facing: float
