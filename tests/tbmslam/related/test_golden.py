"""The original program's own runs, reproduced with its quirks switched on."""

import lzma
import math
from pathlib import Path

import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.rays.insertion import walk_beam
from tbmslam.kernels.search.scoring import impact_at
from tbmslam.related.viny_tracker import (
    GridTrackerConfig,
    HillClimbingConfig,
    MonteCarloConfig,
    MonteCarloMatcher,
    beam_weights,
)
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors
from tbmslam.slam import Slam
from tbmslam.tracking.motion_config import MotionConfig

GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "vinyslam"


def readings():
    for line in (GOLDEN / "scans60.log").read_text().splitlines():
        if line.startswith("#"):
            continue
        values = np.array(line.split(), dtype=np.float64)
        stamp, x, y, theta, angle_min, angle_increment, range_min, range_max = values[:8]
        ranges = values[9:]
        ranges = np.where(ranges < range_min, np.nan, np.where(ranges >= range_max, np.inf, ranges))
        # The program holds the increment as a float32, as ROS messages do.
        scan = LaserScan(stamp, angle_min, float(np.float32(angle_increment)), range_min, range_max, ranges)
        yield Reading(scan, SE2(float(x), float(y), float(theta)))


class OriginalNormals:
    """libstdc++'s std::mt19937 shared by three std::normal_distributions, each keeping its second number."""

    def __init__(self, seed):
        self.words = np.random.RandomState(seed)
        self.kept = [None, None, None]

    def uniform(self):
        low, high = (int(word) for word in self.words.randint(0, 2**32, size=2, dtype=np.uint64))
        return (low + high * 2.0**32) / 2.0**64

    def normal(self, axis):
        if self.kept[axis] is not None:
            value, self.kept[axis] = self.kept[axis], None
            return value
        while True:
            u, v = 2 * self.uniform() - 1, 2 * self.uniform() - 1
            r = u * u + v * v
            if 0 < r <= 1:
                break
        scale = math.sqrt(-2 * math.log(r) / r)
        self.kept[axis] = u * scale
        return v * scale

    def __call__(self, count):
        return np.array([[self.normal(axis) for axis in range(3)] for _ in range(count)])


def with_quirks(matcher) -> SlamConfig:
    return preset("viny").model_copy(
        update={"motion": MotionConfig(composition="component"), "tracker": GridTrackerConfig(matcher=matcher)}
    )


@pytest.mark.parametrize(
    ("name", "matcher"),
    [
        # The smallest deviations never find anything better: the idle matcher.
        ("idle", MonteCarloConfig(position_deviation=1e-300, heading_deviation=1e-300)),
        ("HC", HillClimbingConfig(extra_candidate=True)),
        ("MC666666", MonteCarloConfig()),
    ],
)
def test_run(name, matcher, monkeypatch):
    monkeypatch.setattr(
        MonteCarloMatcher,
        "from_seed",
        classmethod(lambda _, config, *_seed: MonteCarloMatcher(config, OriginalNormals(666666))),
    )
    slam = Slam(with_quirks(matcher))
    for reading in readings():
        slam.process(reading)
    tbm_map = slam.finish()

    expected = np.loadtxt(GOLDEN / f"{name}.tum")
    poses = tbm_map.drives[0].trajectory.poses
    np.testing.assert_allclose(poses[:, :2], expected[:, 1:3], atol=1e-6)
    np.testing.assert_allclose(poses[:, 2], 2 * np.arctan2(expected[:, 6], expected[:, 7]), atol=1e-6)
    assert_maps_agree(tbm_map.grid, *golden_map(name))


def golden_map(name):
    content = lzma.decompress((GOLDEN / f"{name}.tbmf32.xz").read_bytes())
    _, header, cells = content.split(b"\n", 2)
    cols, rows, _, origin_col, origin_row = (int(float(v)) for v in header.split())
    masses = np.frombuffer(cells, dtype="<f4").reshape(rows, cols, 4)
    return masses[..., [3, 1, 2, 0]], origin_row, origin_col


def assert_maps_agree(grid, masses, origin_row, origin_col):
    known = np.argwhere(masses[..., 3] < 1.0)
    assert len(known) == grid.is_known().sum()
    first_row = round(grid.geometry.origin_y / grid.geometry.resolution)
    first_col = round(grid.geometry.origin_x / grid.geometry.resolution)
    mine = grid.masses[known[:, 0] - origin_row - first_row, known[:, 1] - origin_col - first_col]
    np.testing.assert_allclose(mine, masses[known[:, 0], known[:, 1]], atol=1e-6)


def vectors(kind):
    return [line for line in (GOLDEN / "vectors.txt").read_text().splitlines() if line.startswith(kind)]


def test_belief_vectors():
    """Counts of hits and misses, and what the cell then holds."""
    for line in vectors(("fresh", "hit", "miss", "blur")):
        label, _, fields = line.partition(" u=")
        values = dict(field.split("=") for field in f"u={fields}".split())
        quality = 0.6 if "q=0.6" in label else 0.9
        factors = beam_factors(SensorModelConfig(), 0.1, quality)
        grid = EvidenceGrid(0.1)
        grid.grow_to_contain(np.zeros((1, 2)))
        for part in label.split(","):
            word, _, amount = part.split("(")[0].strip().partition(" ")
            if word == "blur":
                grid.ratios[0, 0] *= factors.blur[int(amount.removeprefix("d2="))]
            elif word != "fresh":
                grid.ratios[0, 0] *= getattr(factors, word) ** int(amount.removeprefix("x"))
        masses = grid.to_tbm_grid().masses[0, 0]
        expected = [float(values[key]) for key in "ceou"]
        np.testing.assert_allclose(masses, expected, atol=1e-6, err_msg=line)
        assert impact_at(grid.ratios, 0, 0) == pytest.approx(float(values["impact"]), abs=1e-9), line


def test_ray_vectors():
    lines = vectors("ray")
    assert len(lines) >= 9
    for line in lines:
        ends, _, path = line.partition(":")
        cells = np.empty((1000, 2), dtype=np.int64)
        count = walk_beam(*(float(v) for v in ends.split()[1:]), 0.1, cells)
        assert [f"({col},{row})" for row, col in cells[:count]] == path.split(), line


def test_weight_vectors():
    lines = vectors("weight")
    assert lines
    for line in lines:
        r, a, w = (float(field.split("=")[1]) for field in line.split()[1:])
        scan = LaserScan(0.0, 0.0, a, 0.0, 30.0, np.array([1.0, r]))
        weights = beam_weights(scan, "viny")
        assert weights[1] / weights[0] * 3.0 == pytest.approx(w), line


def test_monte_carlo_vectors():
    lines = vectors("mc ")
    draws = OriginalNormals(666666)(len(lines)) * [0.2, 0.2, 0.1]
    np.testing.assert_allclose(draws, [[float(v) for v in line.split()[1:]] for line in lines], atol=1e-12)
