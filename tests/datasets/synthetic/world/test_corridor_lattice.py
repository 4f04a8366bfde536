import numpy as np
import pytest

from datasets.synthetic.world.corridor_lattice import CorridorLattice


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


def test_every_block_and_every_seed_looks_different():
    shapes = []
    for seed, x, y in ((0, 1, 1), (0, 21, 1), (0, 1, 21), (0, -1, 1), (0, 1, -1), (1, 1, 1)):
        walls = CorridorLattice(seed).walls_near((x, y), (x, y))
        shapes.append(tuple(np.round(walls - walls.reshape(-1, 2).min(axis=0)[[0, 1, 0, 1]], 6).ravel().tolist()))
    assert len(set(shapes)) == 6


def test_a_corridor_too_wide():
    with pytest.raises(ValueError, match=r"width must be positive and below a quarter of the pitch, got 6\.0, 20\.0"):
        CorridorLattice(width=6.0)
