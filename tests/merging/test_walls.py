import cv2
import numpy as np
import pytest

from merging.config.registration import StructureConfig
from merging.walls import Components, WallMap, steadiness
from tbmslam.belief.grid import GridGeometry, TbmGrid


def room(free_mass=1.0, wall_mass=1.0, thickness=3):
    """A free room of 30 x 40 cells behind walls, in unknown surroundings."""
    grid = TbmGrid.unknown(GridGeometry(0.1, -1.0, 2.0, 50, 60))
    inner, outer = np.s_[10:40, 10:50], np.s_[10 - thickness : 40 + thickness, 10 - thickness : 50 + thickness]
    grid.masses[outer] = (0.0, 0.0, wall_mass, 1.0 - wall_mass)
    grid.masses[inner] = (0.0, free_mass, 0.0, 1.0 - free_mass)
    return grid


def test_only_the_surface_of_a_thick_wall_is_wall_and_faces_the_room():
    structure = WallMap.from_grid(room(), StructureConfig())
    assert len(structure.points) == 2 * (30 + 40) + 4
    centre = np.array([-1.0 + 30 * 0.1, 2.0 + 25 * 0.1])
    assert np.all(np.einsum("ij,ij->i", structure.normals, centre - structure.points) > 0.0)
    along = np.abs(structure.points[:, 1] - centre[1]) < 1.0  # the middle of the left and the right wall
    np.testing.assert_allclose(np.abs(structure.normals[along, 0]), 1.0, atol=1e-3)


def test_free_space_counts_however_weak_its_evidence():
    strong, weak = (WallMap.from_grid(room(mass, 0.3), StructureConfig()) for mass in (1.0, 0.003))
    np.testing.assert_array_equal(strong.free, weak.free)
    np.testing.assert_array_equal(strong.points, weak.points)


def test_blur_is_no_wall():
    assert len(WallMap.from_grid(room(wall_mass=0.05), StructureConfig()).points) == 0


def test_specks_are_no_wall():
    grid = room()
    grid.masses[20, 20] = (0.0, 0.0, 1.0, 0.0)
    clean = WallMap.from_grid(room(), StructureConfig())
    assert len(WallMap.from_grid(grid, StructureConfig()).points) == len(clean.points)
    assert len(WallMap.from_grid(grid, StructureConfig(min_speck_m=0.0)).points) == len(clean.points) + 1


def test_a_thin_wall_between_two_rooms_faces_both():
    grid = room()
    grid.masses[10:40, 30] = (0.0, 0.0, 1.0, 0.0)
    structure = WallMap.from_grid(grid, StructureConfig())
    thin = np.isclose(structure.points[:, 0], grid.geometry.centre_of(0, 30)[0])
    thin &= np.abs(structure.points[:, 1] - 4.5) < 1.0
    assert thin.sum() == 20
    assert structure.two_sided[thin].all()
    np.testing.assert_allclose(np.abs(structure.normals[thin, 0]), 1.0, atol=1e-3)
    assert not structure.two_sided[~thin & (structure.points[:, 0] < 0.1)].any()


def test_small_things_count_little():
    grid = room()
    grid.masses[30:34, 30:36] = (0.0, 0.0, 1.0, 0.0)
    found = WallMap.from_grid(grid, StructureConfig(least_weight=0.1))
    assert sorted(set(found.weights)) == [0.1, 1.0]
    np.testing.assert_array_equal(found.walls.weights, found.weights)


def test_the_nearest_wall_of_every_cell_is_found():
    structure = WallMap.from_grid(room(), StructureConfig())
    for row, col in ((25, 30), (12, 11), (0, 0), (38, 45)):
        apart = np.linalg.norm(structure.points - structure.geometry.centre_of(row, col), axis=1)
        assert abs(structure.distances_m[row, col] - apart.min()) < 0.1
        assert apart[structure.nearest[row, col]] < apart.min() + 0.1


def test_a_map_without_walls_is_far_from_any():
    structure = WallMap.from_grid(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 4, 4)), StructureConfig())
    assert len(structure.points) == 0
    assert np.all(np.isinf(structure.distances_m))


def test_points_outside_the_map_are_marked():
    structure = WallMap.from_grid(room(), StructureConfig())
    rows, cols, inside = structure.geometry.cells_at(
        np.array([(-0.95, 2.05), (-1.05, 2.05), (4.95, 6.95), (4.95, 7.05)])
    )
    np.testing.assert_array_equal(inside, [True, False, True, False])
    assert (rows[2], cols[2]) == (49, 59)


def test_what_lies_in_a_known_cell_is_known_and_nothing_outside_the_map():
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 4, 4))
    grid.masses[:, 2:] = (0.0, 1.0, 0.0, 0.0)
    known = WallMap.from_grid(grid, StructureConfig()).knows(np.array([(0.35, 0.15), (0.45, 0.15), (0.15, 0.15)]))
    np.testing.assert_array_equal(known, [True, False, False])


def test_cells_that_touch_are_a_piece():
    cells = np.zeros((6, 8), dtype=bool)
    cells[1, 1:4] = cells[2, 4] = cells[5, 7] = True  # the second touches the first at a corner
    pieces = Components.of(cells)
    assert pieces.labels.shape == cells.shape
    assert set(pieces.labels[~cells]) == {0}
    long, short = pieces.labels[1, 1], pieces.labels[5, 7]
    assert pieces.labels[2, 4] == long != short
    assert [side[long] for side in pieces.sides] == [4, 2]
    assert sorted(pieces.cells_of(long).tolist()) == [[0, 0], [1, 0], [2, 0], [3, 1]]
    assert pieces.cells_of(short).tolist() == [[0, 0]]


def test_short_pieces_may_be_dropped():
    cells = np.zeros((6, 9), dtype=bool)
    cells[0, 0] = cells[2, 1:5] = cells[4:, 7] = True
    kept = Components.of(cells).at_least(2)
    cells[0, 0] = False
    np.testing.assert_array_equal(kept, cells)


def test_there_may_be_no_piece():
    pieces = Components.of(np.zeros((3, 4), dtype=bool))
    assert len(pieces.stats) == 1


CELL = 0.05
CONFIG = StructureConfig(
    movable_m=0.8, steady_m=1.2, least_weight=0.1, gap_m=0.1, block_m=0.25, thing_m=1.8, hollow_m=0.45
)


def weights_of(walls, free=None):
    """The weights (rows, cols) of all walls; what is no wall is free."""
    weights = np.full(walls.shape, np.nan)
    weights[walls] = steadiness(walls, ~walls if free is None else free, walls, CELL, CONFIG)
    return weights


def box(side_m, degrees, *, solid):
    """A square thing that stands turned by so much in the middle of a floor."""
    corners = cv2.boxPoints(((60.0, 60.0), (side_m / CELL, side_m / CELL), degrees)).round().astype(np.int32)
    image = np.zeros((120, 120), np.uint8)
    if solid:
        cv2.fillPoly(image, [corners], 1)
    else:
        cv2.polylines(image, [corners], isClosed=True, color=1)
    return image > 0


@pytest.mark.parametrize("solid", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_small_things_weigh_little_however_they_are_turned(degrees, solid):
    walls = box(0.7, degrees, solid=solid)
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_large_things_weigh_whole(degrees):
    walls = box(2.2, degrees, solid=False)
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_weights_rise_with_length():
    walls = np.zeros((60, 60), np.bool_)
    lengths_m = np.array([0.5, 0.9, 1.0, 1.1, 1.5])
    for row, length_m in zip(range(5, 60, 10), lengths_m, strict=False):
        walls[row, 10 : 10 + round(length_m / CELL)] = True
    found = [float(weights_of(walls)[row, 10]) for row in range(5, 55, 10)]
    np.testing.assert_allclose(found, [0.1, 0.25, 0.5, 0.75, 1.0])


def test_a_block_against_a_wall_weighs_little_and_the_wall_whole():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:12] = True
    walls[12:22, 30:42] = True
    weights = weights_of(walls)
    np.testing.assert_allclose(weights[14:22, 30:42], 0.1)
    np.testing.assert_allclose(weights[10:12, :28], 1.0)
    np.testing.assert_allclose(weights[10:12, 44:], 1.0)


def test_a_thick_wall_is_no_block():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:20, 5:75] = True
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_no_walls_have_no_weights():
    none = np.zeros((5, 5), np.bool_)
    assert len(steadiness(none, none, none, CELL, CONFIG)) == 0


def test_gaps_do_not_part_a_wall():
    walls = np.zeros((40, 80), np.bool_)
    walls[20, 10:70] = True
    walls[20, 16:70:8] = walls[20, 17:70:8] = False  # pieces of 0.3 m, 0.1 m apart
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)
    walls[20, 18:70:8] = walls[20, 19:70:8] = False  # now 0.2 m apart
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_an_outline_against_a_wall_weighs_little_and_the_wall_whole(degrees):
    walls = box(1.2, degrees, solid=False)
    walls[47:49] = True  # through its lower part
    weights = weights_of(walls)
    np.testing.assert_allclose(weights[55:][walls[55:]], 0.1)
    np.testing.assert_allclose(weights[47:49, :35], 1.0)


def test_outlines_that_touch_weigh_little():
    walls = np.zeros((60, 100), np.bool_)
    for left in (20, 40, 60):
        walls[[20, 40], left : left + 21] = True
        walls[20:41, [left, left + 20]] = True
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


def test_two_faces_of_a_short_wall_are_no_thing():
    """Of a wall 0.3 m thick between two doors both faces were seen, and nothing between them."""
    walls = np.zeros((60, 60), np.bool_)
    walls[20:27, 14:46] = True
    free = ~walls
    walls[21:26, 15:45] = False
    np.testing.assert_allclose(weights_of(walls, free)[walls], 1.0)
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)  # a low cupboard whose inside was seen


def test_a_room_is_no_thing():
    np.testing.assert_allclose(weights_of(box(2.0, 0.0, solid=False))[box(2.0, 0.0, solid=False)], 1.0)


def test_a_part_has_the_walls_of_its_cells_and_their_distances(rooms):
    whole = WallMap.from_grid(rooms(1), StructureConfig())
    part = whole.cut((30, 110), (40, 150))
    left, bottom, right, top = part.geometry.bounds()
    assert (left, bottom, right, top) == pytest.approx((2.0, 1.5, 7.5, 5.5))
    inside = np.all((whole.points > (left, bottom)) & (whole.points < (right, top)), axis=1)
    for name in ("points", "normals", "two_sided", "weights"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[inside])
    np.testing.assert_array_equal(part.known, whole.known[30:110, 40:150])
    np.testing.assert_array_equal(part.free, whole.free[30:110, 40:150])
    rows, cols = np.nonzero(np.isfinite(part.distances_m))
    assert 0 < len(rows) < part.known.size  # the nearest walls of some cells lie outside
    np.testing.assert_array_equal(part.distances_m[rows, cols], whole.distances_m[rows + 30, cols + 40])
    np.testing.assert_array_equal(
        part.points[part.nearest[rows, cols]], whole.points[whole.nearest[rows + 30, cols + 40]]
    )
    outside = ~np.isfinite(part.distances_m)
    beyond = whole.points[whole.nearest[30:110, 40:150][outside]]
    assert not np.any(np.all((beyond > (left, bottom)) & (beyond < (right, top)), axis=1))
    assert part.cut((0, 80), (0, 110)).wall_m == pytest.approx(part.wall_m)
