"""Buildings by name and seed; another seed is another building of the same kind."""

from collections.abc import Callable

import numpy as np

from datasets.synthetic.buildings.along_corridors import draw_corridor, draw_hospital, draw_office, draw_wings
from datasets.synthetic.buildings.without_corridors import draw_apartment, draw_halls, draw_open_plan, draw_store
from datasets.synthetic.world.floor_plan import FloorPlan
from datasets.synthetic.world.world import World

_DRAW: dict[str, Callable[[np.random.Generator], FloorPlan]] = {
    "office": draw_office,
    "halls": draw_halls,
    "store": draw_store,
    "corridor": draw_corridor,
    "wings": draw_wings,
    "apartment": draw_apartment,
    "open_plan": draw_open_plan,
    "hospital": draw_hospital,
}

WORLDS = ("office", "halls", "store", "corridor", "wings", "apartment", "open_plan", "variety", "hospital")
"""Names of the worlds. New names are added at the end, because the position of a name is part of the seed."""

VARIETY = ("office", "halls", "store", "wings", "apartment", "open_plan")
"""Kinds of buildings that differ from place to place. Their order is part of the seed."""


def make_world(name: str, seed: int = 0) -> World:
    """Build a world.

    Parameters
    ----------
    name
        `office`: a corridor loop with rooms on both sides; `halls`: large halls with pillars; `store`: shelves and
        clutter; `corridor`: looks the same everywhere; `wings`: corridors with dead ends; `apartment`: rooms that
        open into one another; `open_plan`: partitions around a core; `variety`: the seed picks one of these, but no
        corridor; `hospital`: long corridors around courts, 90 to 220 m long.
    seed
        Any whole number from 0; the same one gives the same building.
    """
    if name not in WORLDS:
        raise ValueError(f"name must be one of {', '.join(WORLDS)}, got {name!r}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    kind = VARIETY[seed % len(VARIETY)] if name == "variety" else name
    rng = np.random.default_rng([seed, WORLDS.index(name)])
    return _DRAW[kind](rng).world(name, seed)
