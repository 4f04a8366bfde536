"""Every number the related work's methods depend on, with its default.

Each limit of acceptance is the one that leaves most right less wrong alignments on pairs cut from ten simulated
buildings (`tools/make_map_pairs.py`, five kinds, 150 m2 each); no real map was used for the limits. How long the
methods search, and Carpin's penalty, were settled after a look at a few real pairs.
"""

from typing import Annotated

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share


class BirkCarpinConfig(FrozenConfig):
    """Adaptive random walk on the image similarity.

    Parameters
    ----------
    walkers, steps
        Random walks, and the steps of each.
    memory
        Accepted steps from which a walk adapts its next ones.
    daring
        Probability that a step for the worse is taken.
    sample
        Cells of each map and state that are compared in a step.
    lock
        Cost of disagreeing cells, and gain of agreeing cells, beside the similarity, if they are all cells [cells].
    max_index
        Largest acceptance index, 1 - agr / (agr + dis), of an alignment that is accepted.
    seed
        Of the walks.
    """

    walkers: Count = 64
    steps: Count = 300
    memory: Count = 8
    daring: Share = 0.05
    sample: Count = 200
    lock: Annotated[float, Field(ge=0.0)] = 100.0
    max_index: Share = 0.06
    seed: int = 0


class CarpinConfig(FrozenConfig):
    """Hough spectra.

    Parameters
    ----------
    turns, peaks
        Rotations that the spectra offer, and peaks along x and along y that each rotation offers.
    penalty
        Cost of a disagreeing cell, in agreeing cells, in the choice of a pose.
    max_index
        As of Birk and Carpin.
    """

    turns: Count = 6
    peaks: Count = 6
    penalty: Annotated[float, Field(ge=0.0)] = 3.0
    max_index: Share = 0.045


class LiConfig(FrozenConfig):
    """Occupancy likelihood, maximised by a genetic algorithm.

    Parameters
    ----------
    population, generations
        Size of the population and number of generations.
    sample
        Walls and free cells of the source that are compared with the target.
    blur_m
        Standard deviation of the target's blurred likelihood [m].
    min_likelihood
        Least mean likelihood of the source's walls, where the target knows anything, of an accepted alignment.
    seed
        Of the algorithm.
    """

    population: Annotated[int, Field(ge=5)] = 400
    generations: Count = 200
    sample: Count = 500
    blur_m: Metres = 0.15
    min_likelihood: Share = 0.79
    seed: int = 0


class SaeediConfig(FrozenConfig):
    """Probabilistic generalised Voronoi diagrams.

    Parameters
    ----------
    min_apart_m
        Least distance of the two walls that a cell of the diagram lies between [m].
    turns, peaks
        Rotations that the diagrams' Hough spectra offer, and shifts that each offers.
    cell_m
        Cells of the correlation [m].
    min_gain
        Least share of the overlap whose entropy sinks when the log odds are added, for an alignment to be accepted.
    """

    min_apart_m: Metres = 0.5
    turns: Count = 6
    peaks: Count = 8
    cell_m: Metres = 0.2
    min_gain: Share = 0.94


class TrehardConfig(FrozenConfig):
    """Consistency of masses by the disjunctive operator.

    Parameters
    ----------
    turns, peaks
        Rotations that are tried, and best shifts taken from each.
    cells_along
        Cells along both maps together in the search.
    finalists
        Best motions that are made exact.
    sample
        Walls of each map that are compared then.
    min_consistency
        Least consistency of an accepted alignment.
    """

    turns: Count = 180
    peaks: Count = 4
    cells_along: Annotated[int, Field(ge=8)] = 180
    finalists: Count = 24
    sample: Count = 1500
    min_consistency: Share = 0.72


class BaselinesConfig(FrozenConfig):
    """The related work.

    Parameters
    ----------
    min_overlap_share
        Least overlap of an accepted alignment, as a share of the smaller map's known cells.
    """

    min_overlap_share: Share = 0.1
    birk_carpin: BirkCarpinConfig = BirkCarpinConfig()
    carpin: CarpinConfig = CarpinConfig()
    li: LiConfig = LiConfig()
    saeedi: SaeediConfig = SaeediConfig()
    trehard: TrehardConfig = TrehardConfig()
