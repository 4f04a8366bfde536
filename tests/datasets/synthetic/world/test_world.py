import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets.synthetic.buildings import make_world
from datasets.synthetic.world.world import CorridorLattice, World, WorldError, load_world
from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2

BOX = np.array([[0.02, 0.02, 1.02, 0.02], [1.02, 0.02, 1.02, 1.02], [1.02, 1.02, 0.02, 1.02], [0.02, 1.02, 0.02, 0.02]])
ROOM = World("room", 0, BOX, np.array([[0.5, 0.5]]))


def test_a_room_is_walls_around_free_cells_in_the_unknown():
    labels = ROOM.occupancy(GridGeometry(0.1, -0.1, -0.1, 13, 14))
    assert (labels[1, 1:12] == OCCUPIED).all()
    assert (labels[1:12, 11] == OCCUPIED).all()
    assert (labels[2:11, 2:11] == FREE).all()
    assert (labels[0] == UNKNOWN).all()
    assert (labels[:, 12:] == UNKNOWN).all()


def test_cells_of_a_window_are_those_of_the_whole():
    world = make_world("apartment", 3)
    whole = world.grid(0.1)
    labels = world.occupancy(whole)
    part = GridGeometry(0.1, whole.origin_x + 4.0, whole.origin_y + 2.0, 50, 60)
    np.testing.assert_array_equal(world.occupancy(part), labels[20:70, 40:100])


def test_free_space_joined_only_outside_the_window_is_free():
    world = make_world("office", 1)
    col = GridGeometry(0.1, 20.0, -0.5, 260, 3)
    labels = world.occupancy(col)
    assert len(np.unique(np.flatnonzero(np.diff(labels[:, 1])))) > 4
    assert (labels == FREE).sum() > 300


@settings(max_examples=30, deadline=None)
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4))
def test_a_turned_grid_has_the_area_of_the_room(x, y, theta):
    T_world_grid = SE2(x, y, theta)
    room = T_world_grid.inverse().apply(np.array([0.52, 0.52]))
    geometry = GridGeometry(0.02, float(room[0]) - 1.0, float(room[1]) - 1.0, 100, 100)
    labels = ROOM.occupancy(geometry, T_world_grid)
    free, occupied = (labels == FREE).sum() * 0.0004, (labels == OCCUPIED).sum() * 0.0004
    # Where the walls lie on the edges between cells, no cell of theirs is taken from the inside.
    assert 0.88 < free < 1.0 + 1e-9
    assert 1.0 - 1e-9 < free + occupied < 1.12


def test_every_cell_that_a_slanted_wall_touches_is_occupied():
    world = World("wall", 0, np.array([[-0.95, -0.63, 1.9, 1.37]]), np.array([[0.0, 1.0]]))
    geometry = GridGeometry(0.1, -1.0, -1.0, 30, 30)
    along = np.linspace(0, 1, 100_000)[:, None]
    points = (1 - along) * world.walls[0, :2] + along * world.walls[0, 2:]
    touched = {geometry.cell_at(x, y) for x, y in points.tolist()}
    labels = world.occupancy(geometry)
    assert {(int(row), int(col)) for row, col in np.argwhere(labels == OCCUPIED)} == touched


def test_a_saved_world_is_loaded_and_has_the_same_bytes(tmp_path):
    world = make_world("store", 5)
    world.save(tmp_path / "world.npz")
    again = load_world(tmp_path)
    assert (again.name, again.seed) == ("store", 5)
    np.testing.assert_array_equal(again.walls, world.walls)
    np.testing.assert_array_equal(again.places, world.places)
    again.save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "world.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.npz", "world.npz"]


def test_an_invalid_world_is_reported_in_one_line(tmp_path):
    with pytest.raises(WorldError, match=r"world\.npz is not a world: .*make one with `tbmslam world`"):
        load_world(tmp_path)
    (tmp_path / "world.npz").write_bytes(b"PK\x03\x04 not really")
    with pytest.raises(WorldError, match="is not a world"):
        load_world(tmp_path)
    np.savez(tmp_path / "other.npz", walls=np.zeros((3, 4)))
    with pytest.raises(WorldError, match="is not a world"):
        load_world(tmp_path / "other.npz")


@pytest.mark.parametrize("flipped", [4, 255])
def test_a_world_with_any_damaged_byte_is_another_world_or_an_error_of_one_line(tmp_path, flipped):
    ROOM.save(tmp_path / "world.npz")
    content = (tmp_path / "world.npz").read_bytes()
    said = []
    for at in range(len(content)):
        (tmp_path / "world.npz").write_bytes(content[:at] + bytes([content[at] ^ flipped]) + content[at + 1 :])
        try:
            load_world(tmp_path)
        except WorldError as error:
            said.append(str(error))
    assert all(text.count("tbmslam world") == 1 and "\n" not in text for text in said)
    assert len(said) > len(content) / 2


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"walls must be segments \(N, 4\)"):
        World("x", 0, np.zeros((3, 2)), np.zeros((1, 2)))
    with pytest.raises(ValueError, match=r"places must be points \(M, 2\)"):
        World("x", 0, BOX, np.zeros((0, 2)))


@pytest.mark.parametrize("place", [np.nan, 1e300])
def test_a_wall_or_place_that_is_nowhere_is_refused(place):
    for walls, places in ((BOX * place, np.zeros((1, 2))), (BOX, np.full((1, 2), place))):
        with pytest.raises(ValueError, match=r"walls and places must lie within 1e\+08 m"):
            World("x", 0, walls, places)


def test_points_far_outside_the_walls_change_nothing():
    world = World("x", 0, BOX, np.array([[1e7, 0.0], [-1e7, 0.0], BOX.reshape(-1, 2).mean(axis=0)]))
    inside = World("x", 0, BOX, BOX.reshape(-1, 2).mean(axis=0, keepdims=True))
    np.testing.assert_array_equal(world.occupancy(world.grid(0.1)), inside.occupancy(world.grid(0.1)))


def test_cells_too_far_from_a_world_are_refused():
    world = World("hall", 0, BOX, np.zeros((1, 2)))
    with pytest.raises(WorldError, match=r"reach together over .* give the pose of the map in it"):
        world.occupancy(world.grid(0.05), SE2(1e8, 1e8, 0.0))


def test_the_grid_holds_all_walls():
    world = make_world("wings", 2)
    min_x, min_y, max_x, max_y = world.grid(0.05, margin=0.5).bounds()
    inner = world.bounds()
    assert min_x <= inner[0] - 0.5 < inner[2] + 0.5 <= max_x
    assert min_y <= inner[1] - 0.5 < inner[3] + 0.5 <= max_y
    assert math.isclose(max_x - min_x, inner[2] - inner[0] + 1.0, abs_tol=0.2)


def as_set(walls):
    return {tuple(wall) for wall in np.round(walls, 9).tolist()}


def test_the_building_is_the_same_from_wherever_one_looks():
    lattice = CorridorLattice(seed=3)
    left, right = lattice.walls_near((-50.0, -30.0), (10.0, 30.0)), lattice.walls_near((-10.0, -30.0), (50.0, 30.0))
    whole = as_set(lattice.walls_near((-50.0, -30.0), (50.0, 30.0)))
    assert as_set(left) | as_set(right) == whole
    assert as_set(left) & as_set(right)


def test_blocks_are_closed_outlines_that_leave_the_corridors_free():
    walls = CorridorLattice(seed=1).walls_near((0.1, 0.1), (19.9, 19.9))
    starts, ends = walls[:, :2], walls[:, 2:]
    np.testing.assert_allclose(np.roll(starts, -1, axis=0), ends)
    assert (np.hypot(*(ends - starts).T) > 1e-3).all()
    assert walls.min() == pytest.approx(1.2)
    assert walls.max() == pytest.approx(18.8)


def test_every_block_and_every_seed_is_different():
    shapes = []
    for seed, x, y in ((0, 1, 1), (0, 21, 1), (0, 1, 21), (0, -1, 1), (0, 1, -1), (1, 1, 1)):
        walls = CorridorLattice(seed).walls_near((x, y), (x, y))
        shapes.append(tuple(np.round(walls - walls.reshape(-1, 2).min(axis=0)[[0, 1, 0, 1]], 6).ravel().tolist()))
    assert len(set(shapes)) == 6


def test_a_corridor_too_wide():
    with pytest.raises(ValueError, match=r"width must be positive and below a quarter of the pitch, got 6\.0, 20\.0"):
        CorridorLattice(width=6.0)
