import math

import numpy as np
import pytest

from tbmslam.kernels.surfels.outline import outline_of, share_on_outline
from tests import reference

STEP = 2.0 * math.pi / 120
POSE = (0.4, -0.3, 1.0)


def room_ranges():
    """Ranges from the middle of a room of 8 x 4 m with a pillar; some beams show nothing."""
    generator, angles = np.random.default_rng(1), STEP * np.arange(120)
    ranges = np.minimum(4.0 / np.abs(np.cos(angles)), 2.0 / np.maximum(np.abs(np.sin(angles)), 1e-9))
    ranges[20:26] = 1.2
    ranges[generator.random(120) < 0.1] = math.inf
    ranges[generator.random(120) < 0.1] = math.nan
    return ranges


@pytest.mark.parametrize("step", [STEP, -STEP])
def test_shares_equal_those_of_the_slow_twin(step):
    ranges, generator = room_ranges(), np.random.default_rng(2)
    outline = outline_of(ranges, 0.3, step, POSE), 0.3, step, POSE
    shares = []
    for k in generator.integers(0, 120, 600):
        angle, distance = POSE[2] + 0.3 + step * (k + generator.uniform(-0.5, 0.5)), ranges[k]
        if not np.isfinite(distance):
            distance = 3.0
        distance += generator.normal(0.0, 0.2)
        place = np.array([POSE[0] + distance * math.cos(angle), POSE[1] + distance * math.sin(angle)])
        turn = angle + math.pi + generator.normal(0.0, 0.5)
        normal = np.array([math.cos(turn), math.sin(turn)])
        shares.append(share_on_outline(outline, *place, *normal, 0.1))
        assert shares[-1] == pytest.approx(reference.share_on_outline(ranges, 0.3, step, POSE, place, normal), abs=1e-4)
    assert 100 < np.count_nonzero(np.array(shares) > 0.5) < 500


def test_the_back_and_the_jambs_of_a_wall_are_not_on_its_outline():
    ranges = 2.0 / np.cos(np.linspace(-0.5, 0.5, 11))
    outline = outline_of(ranges, -0.5, 0.1, (0.0, 0.0, 0.0)), -0.5, 0.1, (0.0, 0.0, 0.0)
    assert share_on_outline(outline, 2.0, 0.1, -1.0, 0.0, 0.1) == pytest.approx(1.0)
    assert share_on_outline(outline, 2.0, 0.1, 1.0, 0.0, 0.1) == 0.0
    assert share_on_outline(outline, 2.0, 0.1, 0.0, 1.0, 0.1) == 0.0
    assert share_on_outline(outline, 2.1, 0.1, -1.0, 0.0, 0.1) == pytest.approx(0.5)
    assert share_on_outline(outline, 2.1, 0.1, -1.0, 0.0, 0.05) == pytest.approx(0.2)


def test_beams_without_a_hit_and_steps_of_depth_make_no_surface():
    step = 0.1
    wall = 2.0 / np.cos(step * np.arange(-5, 6))
    ranges = np.concatenate((wall[:4], [math.inf], wall[5:7], [3.5, 2.1, math.nan, 2.5]))
    surfaces = outline_of(ranges, -0.5, step, (0.0, 0.0, 0.0))
    assert np.flatnonzero(surfaces.any(axis=1)).tolist() == [0, 1, 2]
    assert outline_of(np.zeros(0), 0.0, 0.1, (0.0, 0.0, 0.0)).shape == (0, 5)
