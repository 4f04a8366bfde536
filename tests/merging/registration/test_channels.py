import numpy as np

from merging.registration.channels import Channels, flipped
from tbmslam.belief.grid import GridGeometry, TbmGrid

GEOMETRY = GridGeometry(0.1, 2.0, -1.0, 2, 3)


def grid():
    masses = np.zeros((2, 3, 4), dtype=np.float32)
    masses[0] = [(0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]
    masses[1] = [(0, 0.6, 0.25, 0.15), (0.5, 0.5, 0, 0), (1, 0, 0, 0)]
    return TbmGrid(GEOMETRY, masses)


def test_each_image_shows_its_mass_with_the_largest_y_on_top():
    channels = Channels.from_grid(grid())
    np.testing.assert_array_equal(channels.pignistic, [[172, 255, 128], [255, 0, 128]])
    np.testing.assert_array_equal(channels.occupied, [[64, 0, 0], [0, 255, 0]])
    np.testing.assert_array_equal(channels.free, [[153, 255, 0], [255, 0, 0]])
    np.testing.assert_array_equal(channels.unknown, [[38, 0, 255], [0, 0, 255]])


def test_a_border_is_unknown_and_moves_no_cell():
    plain, bordered = Channels.from_grid(grid()), Channels.from_grid(grid(), border=4)
    for name, outside in (("pignistic", 128), ("occupied", 0), ("free", 0), ("unknown", 255)):
        image = getattr(bordered, name)
        np.testing.assert_array_equal(image[4:-4, 4:-4], getattr(plain, name))
        assert np.all(image[:4] == outside)
    np.testing.assert_allclose(bordered.to_metres([(4, 5)]), plain.to_metres([(0, 1)]))


def test_pixels_lie_where_their_cells_lie():
    channels = Channels.from_grid(grid())
    rows, cols = np.nonzero(channels.occupied == 255)  # the occupied cell is row 0, column 1
    np.testing.assert_allclose(channels.to_metres(np.column_stack((cols, rows))), [GEOMETRY.centre_of(0, 1)])
    np.testing.assert_allclose(channels.to_metres((0, 0)), [GEOMETRY.centre_of(1, 0)])


def test_flipping_twice_is_nothing():
    cells = np.arange(6).reshape(3, 2)
    np.testing.assert_array_equal(flipped(cells)[0], cells[2])
    np.testing.assert_array_equal(flipped(flipped(cells)), cells)
