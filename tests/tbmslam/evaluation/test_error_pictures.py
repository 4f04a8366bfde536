import cv2
import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.evaluation.error_pictures import Backdrop, draw_map_errors, draw_trajectory_errors
from tbmslam.io.pictures import encode_png

LINE = np.column_stack((np.linspace(0.0, 10.0, 200), np.zeros(200)))


def colour_at(picture, x, y):
    """Return blue, green, red of a picture whose trajectory is LINE without a backdrop, at a place in metres."""
    scale = (1600 - 40) / 10.0
    return picture[round((0.0 - y) * scale) + 20, round(x * scale) + 20].astype(int)


def test_small_errors_are_blue_and_large_ones_red():
    picture = draw_trajectory_errors(LINE, np.linspace(0.0, 0.3, 200))
    blue, red = colour_at(picture, 2.0, 0.0), colour_at(picture, 10.0, 0.0)
    assert blue[0] > blue[2] + 50
    assert red[2] > red[0] + 50
    assert colour_at(picture, 5.0, 0.08).tolist() == [255, 255, 255]


def test_no_error_at_all_and_a_single_point_can_be_drawn():
    assert draw_trajectory_errors(LINE, np.zeros(200)).shape[2] == 3
    assert draw_trajectory_errors(LINE[:1], np.ones(1)).min() < 255


def test_walls_lie_beneath_where_they_are():
    labels = np.full((40, 120), UNKNOWN, dtype=np.uint8)
    labels[10:30, 10:110] = FREE
    labels[30, 10:110] = OCCUPIED  # a wall at y = 1.05 above the line
    geometry = GridGeometry(0.1, -1.0, -2.0, 40, 120)
    picture = draw_trajectory_errors(LINE, np.zeros(200), Backdrop(labels, geometry))
    scale = (1600 - 40) / 12.0
    row = int((2.0 - 1.05) * scale) + 20
    assert (picture[row] == 130).all(axis=1).sum() == pytest.approx(10.0 * scale, abs=2)
    assert picture[row + 20, 800].tolist() == [250, 250, 250]
    assert picture[row - 20, 800].tolist() == [225, 225, 225]


def test_cells_that_differ_are_coloured_and_y_is_up():
    labels = np.array([[FREE, OCCUPIED, FREE], [OCCUPIED, UNKNOWN, FREE]], dtype=np.uint8)
    truth = np.array([[FREE, OCCUPIED, OCCUPIED], [FREE, UNKNOWN, UNKNOWN]], dtype=np.uint8)
    picture = draw_map_errors(labels, truth)
    assert picture[1, 0].tolist() == [255, 255, 255]
    assert picture[1, 1].tolist() == [0, 0, 0]
    blue, red = picture[1, 2].astype(int), picture[0, 0].astype(int)
    assert blue[0] > blue[2]
    assert red[2] > red[0]
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 6


def test_a_picture_survives_its_file():
    picture = draw_map_errors(np.array([[FREE, OCCUPIED]], np.uint8), np.array([[OCCUPIED, FREE]], np.uint8))
    read = cv2.imdecode(np.frombuffer(encode_png(picture), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(read, picture)


def test_what_does_not_belong_together():
    with pytest.raises(ValueError, match="points and errors must agree in length above 0, got 200, 3"):
        draw_trajectory_errors(LINE, np.zeros(3))
    with pytest.raises(ValueError, match="points and errors must agree in length above 0, got 0, 0"):
        draw_trajectory_errors(LINE[:0], np.zeros(0))
    with pytest.raises(ValueError, match="labels and truth must have the same shape"):
        draw_map_errors(np.zeros((1, 2), np.uint8), np.zeros((2, 1), np.uint8))
