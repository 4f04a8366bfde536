"""Limits of the comparison of walls: agreement and contradiction."""

from typing import NamedTuple

FACING = 0.7
"""Least cosine between the normals of two walls that may be one wall seen from the same side."""


class Limits(NamedTuple):
    """Distances [m] and a cosine, as the kernels take them.

    Parameters
    ----------
    agreement
        Walls nearer to each other than this agree, if they face the same way.
    conflict
        A wall on free space farther than this from every wall contradicts.
    front
        Distance before a wall in which the other map must have free space, so that its robot could see the wall.
    facing
        Least cosine between the normals of walls that may be one.
    """

    agreement: float
    conflict: float
    front: float
    facing: float
