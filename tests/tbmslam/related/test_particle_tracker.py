import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.belief.evidence_grid import GridTooLargeError
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.kernels.grids.tiles import TILE
from tbmslam.related.particle_tracker import Ancestry, ParticleTracker, ParticleTrackerConfig, TileMaps
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors
from tbmslam.slam import Slam
from tbmslam.timed_slam import TimedSlam


def tiles_of(maps):
    return len(maps._tiles) - 1 - maps._free_count


def test_weights_and_their_effective_number():
    ancestry = Ancestry(4)
    assert ancestry.effective_number() == pytest.approx(4.0)
    ancestry.weigh(np.log([1.0, 1.0, 2.0, 4.0]) - 1000.0)
    np.testing.assert_allclose(ancestry.weights(), [0.125, 0.125, 0.25, 0.5])
    assert ancestry.effective_number() == pytest.approx(64.0 / 22.0)
    assert ancestry.best() == 3


@pytest.mark.parametrize("draw", [0.1, 0.5, 0.9])
def test_descendants_are_as_many_as_the_weight_says(draw):
    ancestry = Ancestry(8)
    weights = np.array([0.0, 1.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0]) + 1e-12
    ancestry.weigh(np.log(weights))
    chosen = ancestry.resample(draw)
    np.testing.assert_array_equal(np.bincount(chosen, minlength=4)[1:4], [1, 2, 5])
    assert ancestry.effective_number() == pytest.approx(8.0)


def test_the_path_is_that_of_the_best_ones_ancestors():
    ancestry = Ancestry(3)
    assert ancestry.path().shape == (0, 3)
    poses = np.arange(9.0).reshape(3, 3)
    ancestry.record(poses)
    ancestry.weigh(np.log([0.1, 0.1, 0.8]))
    chosen = ancestry.resample(0.5)
    ancestry.record(poses[chosen] + 10.0)
    ancestry.weigh(np.array([1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(ancestry.path(), [poses[chosen[0]], poses[chosen[0]] + 10.0])


def config_of(**changes):
    values = preset("particles").model_dump()
    values["tracker"] |= {"particles": 6} | changes
    return changed(SlamConfig(), values)


def mapped(readings, config, kind=Slam):
    slam = kind(config)
    for reading in readings:
        slam.process(reading)
    return slam.finish()


def test_particles_follow_poor_odometry(drive_in):
    robot = drive_in("apartment", 30.0)
    tbm_map = mapped(robot.readings, config_of())
    drive = tbm_map.drives[0]
    assert align_trajectories(robot.truth, drive.trajectory).ate_m < 0.06
    assert len(drive.trajectory) == len(robot.readings)
    assert 10 < len(drive.keyframes) < len(robot.readings) / 2


def test_the_seed_decides(drive_in):
    readings = drive_in("apartment", 15.0).readings
    first, again = mapped(readings, config_of()), mapped(readings, config_of(), TimedSlam)
    np.testing.assert_array_equal(first.drives[0].trajectory.poses, again.drives[0].trajectory.poses)
    np.testing.assert_array_equal(first.grid.masses, again.grid.masses)
    other = mapped(readings, config_of().model_copy(update={"seed": 1}))
    assert (first.drives[0].trajectory.poses[-1] != other.drives[0].trajectory.poses[-1]).any()


def test_resampling_keeps_the_pool_of_tiles_small(drive_in):
    readings = drive_in("apartment", 30.0).readings
    tiles = {}
    for share in (0.0, 1.0):
        slam = Slam(config_of(resample_below=share))
        for reading in readings:
            slam.process(reading)
        tiles[share] = tiles_of(slam._front_end._tracker._maps)
        assert slam._front_end.revised_poses().shape == (len(slam._buffer), 3)
    assert tiles[1.0] <= tiles[0.0]


def test_maps_and_particles_must_be_as_many():
    factors = beam_factors(SensorModelConfig(), 0.1, 1.0)
    with pytest.raises(ValueError, match=r"maps must be one for each of 30 particles, got 2"):
        ParticleTracker(ParticleTrackerConfig(), TileMaps(2, 0.1), factors, 0)


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
    assert tiles_of(maps) == 1
    write(maps, 1, 6, -7, hit=False)
    assert tiles_of(maps) == 2
    assert ratios_of(maps, 0, 5, -7) == ratios_of(maps, 1, 5, -7) == pytest.approx(tuple(FACTORS.hit))
    assert ratios_of(maps, 0, 6, -7) == (1.0, 1.0)
    assert ratios_of(maps, 1, 6, -7) == pytest.approx(tuple(FACTORS.miss))
    maps.resample(np.array([2, 2, 2]))
    assert tiles_of(maps) == 1


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
    assert tiles_of(maps) == len(distinct)


def test_endless_evidence_stays_finite():
    maps = TileMaps(1, 0.1)
    for _ in range(500):
        write(maps, 0, 0, 0)
    assert np.isfinite(ratios_of(maps, 0, 0, 0)).all()


def test_memory_is_bounded():
    maps = TileMaps(2, 0.1, max_cells=10 * TILE**2)
    with pytest.raises(GridTooLargeError, match=r"maps of 2 particles would take \d+ tiles .* fewer tracker.particles"):
        write(maps, 0, 0, 0)
