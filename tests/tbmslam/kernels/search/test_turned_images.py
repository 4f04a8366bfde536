import cmath

import numpy as np
import pytest

from tbmslam.kernels.search.turned_images import block_peaks, draw_turned, multiply

ROWS, COLS, CELL = 12, 15, 0.5


def complex_points(rng, count, reach):
    return rng.uniform(-reach, reach, count) + 1j * rng.uniform(-reach, reach, count)


def drawn(points, weights):
    image = np.zeros((ROWS, COLS), dtype=complex)
    for point, weight in zip(points, weights, strict=True):
        image[int(np.floor(point.imag / CELL)) % ROWS, int(np.floor(point.real / CELL)) % COLS] += weight
    return image


def test_turned_points_are_drawn_where_they_lie():
    rng = np.random.default_rng(2)
    walls, facing, free = (complex_points(rng, count, 4.0) for count in (60, 60, 300))
    metres, filled = rng.uniform(0.0, 0.1, 60), rng.uniform(0.1, 0.9, 300)
    turn = cmath.exp(0.7j)
    images = np.full((2, ROWS, COLS), 9.0, dtype=np.complex64)
    draw_turned(walls, facing, metres, free, filled, turn, CELL, images)
    np.testing.assert_allclose(images[0], drawn(walls * turn, facing * turn), atol=1e-5)
    np.testing.assert_allclose(images[1].real, drawn(walls * turn, metres).real, atol=1e-6)
    np.testing.assert_allclose(images[1].imag, np.minimum(drawn(free * turn, filled).real, 1.0), atol=1e-6)
    assert images[1].imag.max() == 1.0


def test_no_points_leave_empty_images():
    nothing, images = np.zeros(0, dtype=complex), np.ones((2, 3, 4), dtype=np.complex64)
    draw_turned(nothing, nothing, np.zeros(0), nothing, np.zeros(0), 1.0 + 0.0j, 1.0, images)
    assert not images.any()


@pytest.mark.parametrize("size", [(5, 7), (6, 8)])
def test_the_inverse_of_the_products_is_the_real_part_of_the_correlations(size):
    rng = np.random.default_rng(3)
    a, b, c, d = (complex_points(rng, size[0] * size[1], 2.0).reshape(size).astype(np.complex64) for _ in range(4))
    half = np.empty((size[0], size[1] // 2 + 1), dtype=np.complex64)
    expected = np.fft.ifft2(np.conj(a) * b + np.conj(c) * d).real
    multiply(a, b, c, d, half)
    np.testing.assert_allclose(np.fft.irfft2(half, size), expected, atol=1e-5)


@pytest.mark.parametrize("size", [(9, 8), (17, 25), (3, 40)])
def test_each_block_offers_its_best_cell(size):
    scores = np.random.default_rng(4).integers(-5, 5, size).astype(np.float32)  # many are equal
    side = 4
    down, across = size[0] // side, size[1] // side
    values = np.empty(down * across, dtype=np.float32)
    rows, cols = np.zeros((2, down * across), dtype=np.int64)
    block_peaks(scores, side, values, rows, cols)
    for number, (row, col) in enumerate(np.ndindex(down, across)):
        block = scores[row * side : (row + 1) * side, col * side : (col + 1) * side]
        best = np.unravel_index(block.argmax(), block.shape)
        assert values[number] == block.max()
        assert (rows[number], cols[number]) == (row * side + best[0], col * side + best[1])
