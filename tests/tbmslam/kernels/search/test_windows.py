import numpy as np
import pytest

from tbmslam.kernels.search.windows import BLOCK, add_window, blocks_for


@pytest.mark.parametrize(("reach", "cols"), [(0, 16), (7, 16), (8, 32), (40, 96)])
def test_windows_are_whole_blocks(reach, cols):
    assert blocks_for(reach) == cols
    assert cols % BLOCK == 0
    assert cols >= 2 * reach + 1


@pytest.mark.parametrize(("kind", "total"), [(np.int8, np.int16), (np.uint8, np.uint16)])
def test_windows_add_up(generator, kind, total):
    cells = generator.integers(0, 100, (60, 70)).astype(kind)
    sums, expected = np.zeros(11 * 32, dtype=total), np.zeros((11, 32), dtype=int)
    for row, col in generator.integers(0, 38, (20, 2)):
        add_window(sums, cells.reshape(-1), row * 70 + col, 70, 11, 32)
        expected += cells[row : row + 11, col : col + 32]
    np.testing.assert_array_equal(sums.reshape(11, 32), expected)
