import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.belief.evidence_grid import GridTooLargeError
from tbmslam.kernels.grids.tiles import TILE
from tbmslam.related.tile_maps import TileMaps
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors

FACTORS = beam_factors(SensorModelConfig(hit_quality=0.4, miss_quality=0.1, wall_blur=0.0), 0.1, 1.0)


def ratios_of(maps, number, row, col):
    grid = maps.grid(number)
    tile_row, tile_col = row // TILE - grid.first_row, col // TILE - grid.first_col
    if not (0 <= tile_row < grid.places.shape[0] and 0 <= tile_col < grid.places.shape[1]):
        return (1.0, 1.0)
    return tuple(grid.tiles[grid.places[tile_row, tile_col], row % TILE, col % TILE].tolist())


def write(maps, number, row, col, hit=True):
    maps.insert(number, np.array([[row, col]], dtype=np.int32), np.array([hit]), FACTORS)


def test_a_copy_is_made_when_one_writes():
    maps = TileMaps(3, 0.1)
    write(maps, 0, 5, -7)
    maps.resample(np.array([0, 0, 0]))
    assert maps.tiles_in_use == 1
    write(maps, 1, 6, -7, hit=False)
    assert maps.tiles_in_use == 2
    assert ratios_of(maps, 0, 5, -7) == ratios_of(maps, 1, 5, -7) == pytest.approx(tuple(FACTORS.hit))
    assert ratios_of(maps, 0, 6, -7) == (1.0, 1.0)
    assert ratios_of(maps, 1, 6, -7) == pytest.approx(tuple(FACTORS.miss))
    maps.resample(np.array([2, 2, 2]))
    assert maps.tiles_in_use == 1


actions = st.lists(
    st.one_of(
        st.tuples(st.just("write"), st.integers(0, 3), st.integers(-200, 200), st.integers(-200, 200), st.booleans()),
        st.tuples(st.just("resample"), st.lists(st.integers(0, 3), min_size=4, max_size=4)),
    ),
    max_size=30,
)


@given(actions)
def test_maps_are_as_if_each_had_its_own_cells(steps):
    maps, plain = TileMaps(4, 0.1), [{} for _ in range(4)]
    for kind, *values in steps:
        if kind == "resample":
            maps.resample(np.array(values[0]))
            plain = [dict(plain[ancestor]) for ancestor in values[0]]
        else:
            number, row, col, hit = values
            write(maps, number, row, col, hit)
            factors = FACTORS.hit if hit else FACTORS.miss
            plain[number][row, col] = plain[number].get((row, col), np.ones(2)) * factors
    for number, cells in enumerate(plain):
        for (row, col), expected in cells.items():
            assert ratios_of(maps, number, row, col) == pytest.approx(tuple(expected), rel=1e-5)
    distinct = {tile for number in range(4) for tile in maps.grid(number).places.ravel() if tile}
    assert maps.tiles_in_use == len(distinct)


def test_endless_evidence_stays_finite():
    maps = TileMaps(1, 0.1)
    for _ in range(500):
        write(maps, 0, 0, 0)
    assert np.isfinite(ratios_of(maps, 0, 0, 0)).all()


def test_memory_is_bounded():
    maps = TileMaps(2, 0.1, max_cells=10 * TILE**2)
    with pytest.raises(GridTooLargeError, match=r"maps of 2 particles would take \d+ tiles .* fewer tracker.particles"):
        write(maps, 0, 0, 0)
