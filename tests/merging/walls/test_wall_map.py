import numpy as np

from merging.config.registration import StructureConfig
from merging.walls import WallMap
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
