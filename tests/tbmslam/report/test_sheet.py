import base64
import io

import numpy as np
from PIL import Image

from tbmslam.belief.grid import GridGeometry
from tbmslam.report.palette import Palette
from tbmslam.report.sheet import Marks, Raster, Sheet, Switch

TWO = Palette(((255, 255, 255), (10, 20, 30)))


def test_a_picture_lies_in_metres_with_y_upwards():
    levels = np.zeros((2, 3), dtype=np.uint8)
    levels[0, 2] = 1  # the cell of the smallest y and the largest x
    said = Raster(Switch("Map", "walls"), GridGeometry(0.5, -1.0, 2.0, 2, 3), levels, TWO, unit=1.0).as_json()
    assert said["bounds"] == [[2.0, -1.0], [3.0, 0.5]]
    png = base64.b64decode(said["image"].removeprefix("data:image/png;base64,"))
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png))), [[0, 0, 0], [0, 0, 1]])
    assert said["colours"] == [[255, 255, 255], [10, 20, 30]]


def test_points_are_told_as_y_and_x_to_the_millimetre():
    said = Marks(Switch("Robots", "a", "drive"), "line", np.array([[1.23456, -2.0]]), (1, 2, 3)).as_json()
    assert said["points"] == [[-2.0, 1.235]]
    assert (said["kind"], said["label"], said["column"], said["colour"]) == ("line", "a", "drive", "rgb(1, 2, 3)")


def test_a_sheet_tells_its_layers_in_order():
    layers = [Marks(Switch("Robots", name), "dots", np.zeros((0, 2)), (0, 0, 0)) for name in "ab"]
    assert [layer["label"] for layer in Sheet("map", tuple(layers)).as_json()["layers"]] == ["a", "b"]
