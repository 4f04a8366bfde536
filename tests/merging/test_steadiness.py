import cv2
import numpy as np
import pytest

from merging.components import Components
from merging.config import StructureConfig
from merging.steadiness import steadiness

CELL = 0.05
CONFIG = StructureConfig(movable_m=0.8, steady_m=1.2, least_weight=0.1, block_m=0.25)


def weights_of(walls):
    """The weights (rows, cols) of all walls."""
    weights = np.full(walls.shape, np.nan)
    weights[walls] = steadiness(Components.of(walls), walls, walls, CELL, CONFIG)
    return weights


def box(side_m, degrees, *, solid):
    """A square thing that stands turned by so much in the middle of a floor."""
    corners = cv2.boxPoints(((60.0, 60.0), (side_m / CELL, side_m / CELL), degrees)).round().astype(np.int32)
    image = np.zeros((120, 120), np.uint8)
    if solid:
        cv2.fillPoly(image, [corners], 1)
    else:
        cv2.polylines(image, [corners], isClosed=True, color=1)
    return image > 0


@pytest.mark.parametrize("solid", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
def test_small_things_weigh_little_however_they_are_turned(degrees, solid):
    walls = box(0.7, degrees, solid=solid)
    np.testing.assert_allclose(weights_of(walls)[walls], 0.1)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_large_things_weigh_whole(degrees):
    walls = box(1.4, degrees, solid=False)
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_weights_rise_with_length():
    walls = np.zeros((60, 60), np.bool_)
    lengths_m = np.array([0.5, 0.9, 1.0, 1.1, 1.5])
    for row, length_m in zip(range(5, 60, 10), lengths_m, strict=False):
        walls[row, 10 : 10 + round(length_m / CELL)] = True
    found = [float(weights_of(walls)[row, 10]) for row in range(5, 55, 10)]
    np.testing.assert_allclose(found, [0.1, 0.25, 0.5, 0.75, 1.0])


def test_a_block_against_a_wall_weighs_little_and_the_wall_whole():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:12] = True
    walls[12:22, 30:42] = True
    weights = weights_of(walls)
    np.testing.assert_allclose(weights[14:22, 30:42], 0.1)
    np.testing.assert_allclose(weights[10:12, :28], 1.0)
    np.testing.assert_allclose(weights[10:12, 44:], 1.0)


def test_a_thick_wall_is_no_block():
    walls = np.zeros((60, 80), np.bool_)
    walls[10:20, 5:75] = True
    np.testing.assert_allclose(weights_of(walls)[walls], 1.0)


def test_no_walls_have_no_weights():
    none = np.zeros((5, 5), np.bool_)
    assert len(steadiness(Components.of(none), none, none, CELL, CONFIG)) == 0
