import math

import numpy as np

from tbmslam.kernels.correlation import correlate
from tbmslam.kernels.lattice import Lattice


def test_sums_are_the_plain_ones():
    generator = np.random.default_rng(0)
    lattice = Lattice(0.2, -7, 3)
    field = generator.normal(size=(20, 30)).astype(np.float32)
    points = generator.uniform(-4.0, 4.0, (40, 2))
    turns = np.array([-0.3, 0.0, 0.8])
    x, y, theta = guess = (3.7, 0.4, 0.2)
    sums = correlate(field, lattice, points, guess, turns, 4)
    assert sums.shape == (3, 9, 9)
    for k, turn in enumerate(turns):
        c, s = math.cos(theta + turn), math.sin(theta + turn)
        for dr in range(-4, 5):
            for dc in range(-4, 5):
                total = 0.0
                for px, py in points:
                    row = math.floor((y + s * px + c * py) / 0.2) + 7 + dr
                    col = math.floor((x + c * px - s * py) / 0.2) - 3 + dc
                    if 0 <= row < 20 and 0 <= col < 30:
                        total += field[row, col]
                np.testing.assert_allclose(sums[k, dr + 4, dc + 4], total, atol=1e-4)


def test_a_field_out_of_reach_is_nothing():
    field = np.ones((5, 5), dtype=np.float32)
    assert not correlate(field, Lattice(0.2, 0, 0), np.zeros((3, 2)), (100.0, 0.0, 0.0), np.zeros(1), 3).any()
