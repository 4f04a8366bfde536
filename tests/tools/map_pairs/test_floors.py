import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import Building
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tools.map_pairs.floors import floor_of_grid, floors_of, pairs_of, shows_part, variants_of

NAMES = [
    "crop_lab_f_035", "crop_corridor3_1_015", "crop_ex3_025", "crop_ex3part2mir_5_015",
    "negd_00_lab_f_ex3", "negd_ex3part1_ex3part1mir_4", "negs_02_ex3", "negs_office7_1",
    "negd_office7mir_store9_3", "negd_store9_store9mir_1",
]  # fmt: skip


def test_a_pair_shows_the_buildings_that_its_name_names():
    shown = floors_of(NAMES)
    assert shown["crop_lab_f_035"] == {"lab-f"}
    assert shown["crop_corridor3_1_015"] == {"corridor3"}
    assert shown["negd_00_lab_f_ex3"] == {"lab-f", "ex3"}
    assert shown["negs_office7_1"] == shown["negd_office7mir_store9_3"] == {"office7"}
    assert shown["negd_store9_store9mir_1"] == frozenset()  # no pair shows one place of it


def test_a_part_and_a_mirror_image_are_no_other_building():
    shown = floors_of(NAMES)
    assert shown["crop_ex3part2mir_5_015"] == shown["negd_ex3part1_ex3part1mir_4"] == shown["negs_02_ex3"] == {"ex3"}


def test_parts_are_distinguished_from_whole_buildings():
    assert [name for name in NAMES if shows_part(name)] == ["crop_ex3part2mir_5_015", "negd_ex3part1_ex3part1mir_4"]


@pytest.fixture
def grid():
    """A hall of 12 by 8 m with a table in it and a wall across."""
    masses = np.zeros((180, 260, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10:170, 10:250] = (0.0, 1.0, 0.0, 0.0)
    wall = (0.0, 0.0, 1.0, 0.0)
    masses[8:10, 8:252] = masses[170:172, 8:252] = masses[8:172, 8:10] = masses[8:172, 250:252] = wall
    masses[10:90, 100:102] = wall
    masses[120:128, 60:68] = wall
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 180, 260), masses)


def test_small_things_are_taken_out_of_a_real_floor_and_walls_stay(grid):
    floor = floor_of_grid("hall", grid)
    assert (floor.occupancy[120:128, 60:68] == 0).all()
    assert (floor.occupancy[10:90, 100:102] == 100).all()
    assert floor.occupancy[0, 0] == -1


def test_variants_are_the_floor_its_mirror_image_and_parts_of_it(grid):
    floor = floor_of_grid("hall", grid)
    names = [one.name for one in variants_of(floor, 2)]
    assert names == ["hall", "hallmir", "hallpart1mir", "hallpart2"]
    sizes = [np.count_nonzero(one.occupancy == 0) for one in variants_of(floor, 2)]
    assert max(sizes[2:]) < 0.75 * sizes[0]


def test_a_floor_too_small_for_parts_has_none(grid):
    floor = floor_of_grid("hall", grid)
    corner = Building("corner", floor.occupancy[:80, :90].copy(), 0.05)
    assert [one.name for one in variants_of(corner, 3)] == ["corner", "cornermir"]


def test_one_floor_twice_is_never_a_pair_of_two_places(grid):
    variants = variants_of(floor_of_grid("hall", grid), 2)
    names = [pair.name for pair in pairs_of(variants, 1, (0.5,))]
    assert "negd_hall_hallmir_1" in names
    assert not [name for name in names if name.startswith(("negd_hallmir_hallpart1mir", "negd_hallpart2_hall_"))]


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_no_pair_of_two_buildings_comes_twice(grid, number):
    floor = floor_of_grid("hall", grid)
    buildings = [Building(f"hall{name}", floor.occupancy, floor.resolution) for name in "abcd"[:number]]
    names = [pair.name for pair in pairs_of(buildings, 1, ())]
    assert len(set(names)) == len(names)
    assert sum("mir" not in name for name in names if name.startswith("negd_")) == (0, 2, 3, 8)[number - 1]
