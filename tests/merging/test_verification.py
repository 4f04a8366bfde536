import math

import numpy as np
import pytest

from merging.config import StructureConfig, VerificationConfig
from merging.structure import Structure
from merging.verification import Evidence, examine, objection
from merging.warping import warp
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import SE2

CONFIG = VerificationConfig(
    min_overlap_m2=4.0, min_agreed_wall_m=6.0, min_weakest_wall_m=1.5, min_agreement=0.6, max_conflict=0.15
)
SOUND = Evidence(
    overlap_m2=50.0,
    compared_wall_m=40.0,
    agreed_wall_m=35.0,
    weakest_wall_m=12.0,
    rmse_m=0.03,
    agreement=0.875,
    conflict=0.02,
)


def structure(grid):
    return Structure.from_grid(grid, StructureConfig())


def corridor(length=200):
    """Two long walls and nothing else, 2 m apart."""
    masses = np.zeros((60, length, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10:50] = (0.0, 1.0, 0.0, 0.0)
    masses[8:10] = masses[50:52] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 60, length), masses)


def test_a_map_agrees_with_itself(rooms):
    grid = rooms(1)
    evidence = examine(structure(grid), structure(grid), SE2.identity(), CONFIG)
    assert evidence.agreement == 1.0
    assert evidence.conflict == 0.0
    assert evidence.overlap_m2 == pytest.approx(240 * 320 * 0.05**2)
    assert evidence.weakest_wall_m > 10.0
    assert evidence.rmse_m == 0.0
    assert objection(evidence, CONFIG) is None


def test_it_agrees_with_itself_turned(rooms):
    grid, motion = rooms(1), SE2(3.0, -4.0, math.radians(33.0))
    evidence = examine(structure(warp(grid, motion, grid.geometry)), structure(grid), motion, CONFIG)
    assert evidence.agreement > 0.9
    assert 0.0 < evidence.rmse_m < 0.05
    assert evidence.conflict < 0.01


def test_the_same_either_way_round(rooms):
    first, second = structure(rooms(1)), structure(rooms(2))
    motion = SE2(1.0, -2.0, 0.4)
    forth, back = examine(first, second, motion, CONFIG), examine(second, first, motion.inverse(), CONFIG)
    assert forth.agreement == pytest.approx(back.agreement)
    assert forth.conflict == pytest.approx(back.conflict)
    assert forth.overlap_m2 == pytest.approx(back.overlap_m2, rel=0.01)


def test_another_floor_conflicts(rooms):
    evidence = examine(structure(rooms(1)), structure(rooms(2)), SE2.identity(), CONFIG)
    assert evidence.conflict > 0.2
    assert "stand on free space of the other" in objection(evidence, CONFIG)


def test_a_wall_seen_from_the_other_side_does_not_agree():
    left = corridor()
    beyond = SE2(0.0, -42 * 0.05, 0.0)  # the other corridor's far wall on this one's near wall, back to back
    evidence = examine(structure(left), structure(left), beyond, CONFIG)
    assert evidence.agreement == 0.0


def test_a_bare_corridor_could_slide():
    evidence = examine(structure(corridor()), structure(corridor()), SE2(3.0, 0.0, 0.0), CONFIG)
    assert evidence.agreement > 0.99
    assert evidence.weakest_wall_m < 0.1
    assert "the maps could slide: only 0.0 m of wall resist" in objection(evidence, CONFIG)


def test_maps_apart_have_nothing_in_common(rooms):
    evidence = examine(structure(rooms(1)), structure(rooms(1)), SE2(500.0, 0.0, 0.0), CONFIG)
    assert (evidence.overlap_m2, evidence.agreement, evidence.conflict) == (0.0, 0.0, 0.0)
    assert objection(evidence, CONFIG) == "overlap of 0.0 m2 is under 4 m2"


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"overlap_m2": 1.04}, "overlap of 1.0 m2 is under 4 m2"),
        ({"conflict": 0.4}, "40% of the walls in the overlap stand on free space of the other, over 15%"),
        ({"agreed_wall_m": 2.0}, "only 2.0 m of wall agree, under 6 m"),
        ({"agreement": 0.2}, "only 20% of the walls in the overlap agree, under 60%"),
        ({"weakest_wall_m": 0.5}, "the maps could slide: only 0.5 m of wall resist, under 1.5 m"),
    ],
)
def test_each_objection_gives_its_numbers(fault, message):
    evidence = Evidence(**{**vars(SOUND), **fault})
    assert message in objection(evidence, CONFIG)


def test_bent_maps_may_contradict_more_where_chance_is_out_of_the_question():
    bent = {"conflict": 0.27, "agreement": 0.65}
    assert "27% of the walls" in objection(Evidence(**{**vars(SOUND), **bent}), CONFIG)
    assert objection(Evidence(**{**vars(SOUND), **bent, "weakest_wall_m": 100.0}), CONFIG) is None
    hopeless = Evidence(**{**vars(SOUND), "conflict": 0.5, "weakest_wall_m": 100.0})
    assert "50% of the walls in the overlap stand on free space of the other, over 35%" in objection(hopeless, CONFIG)


def test_a_map_without_walls_confirms_nothing(rooms):
    blank = structure(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 50, 50)))
    assert objection(examine(structure(rooms(1)), blank, SE2.identity(), CONFIG), CONFIG) is not None
