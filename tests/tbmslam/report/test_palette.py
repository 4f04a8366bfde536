import io

import numpy as np
import pytest
from PIL import Image

from tbmslam.report.palette import STEPS, Palette, levels_of

RAMP = Palette.ramp((255, 255, 255), (0, 0, 200), (40, 0, 0), alphas=(0,))


def test_a_ramp_runs_from_its_first_colour_over_the_middle_to_the_last():
    assert len(RAMP.colours) == STEPS + 1
    assert (RAMP.colours[0], RAMP.colours[STEPS // 2], RAMP.colours[-1]) == ((255, 255, 255), (0, 0, 200), (40, 0, 0))


def test_values_are_read_back_from_the_picture():
    values = np.linspace(0.0, 1.0, 63).reshape(7, 9)
    picture = Image.open(io.BytesIO(RAMP.png(levels_of(values))))
    assert (picture.mode, picture.size) == ("P", (9, 7))
    seen = np.asarray(picture.convert("RGBA"))
    levels = [[RAMP.colours.index(tuple(pixel[:3])) for pixel in row] for row in seen.tolist()]
    np.testing.assert_allclose(np.array(levels) / STEPS, values, atol=0.5 / STEPS)
    np.testing.assert_array_equal(seen[..., 3] == 0, np.array(levels) == 0)


def test_colours_that_cannot_be_told_apart_are_refused():
    with pytest.raises(ValueError, match="colours must be at most 256 and differ"):
        Palette(((1, 2, 3), (1, 2, 3)))


def test_the_same_levels_give_the_same_bytes():
    levels = np.arange(20, dtype=np.uint8).reshape(4, 5)
    assert RAMP.png(levels) == RAMP.png(levels.copy())
