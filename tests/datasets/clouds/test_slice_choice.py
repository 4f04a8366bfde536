import math

import numpy as np
import pytest

from datasets.clouds.slice_choice import choose_slice, mounting
from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tests.datasets.clouds.room import LEVEL, room_cloud

HANGING = SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def chosen(clouds, mount=LEVEL, heights=None, step_deg=None):
    return choose_slice(mount, heights, step_deg, clouds, "/points")


@pytest.mark.parametrize("step_deg", [0.2, 0.4, 0.5, 1.0])
def test_the_beams_are_as_fine_as_the_points(step_deg):
    cut = chosen([room_cloud(step_deg=step_deg)] * 3)
    assert (math.degrees(cut.angle_step), cut.beams) == (pytest.approx(step_deg), round(360.0 / step_deg))
    assert cut.time_step == 0.0
    assert chosen([room_cloud(step_deg=step_deg)], step_deg=2.0).beams == 180


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sensor_that_turns_is_measured(sign):
    cut = chosen([room_cloud(turn_s=0.1, sign=sign), room_cloud(turn_s=0.1004, sign=sign)])
    assert cut.angle_step == pytest.approx(sign * math.radians(0.4))
    assert cut.time_step * cut.beams == pytest.approx(0.1, rel=5e-3)
    assert abs(math.remainder(cut.angle_min - math.pi, 2.0 * math.pi)) < math.radians(2.0)


def test_times_in_no_order_mean_that_nothing_turns():
    cloud = room_cloud(turn_s=0.1)
    shuffled = cloud._replace(times=np.random.default_rng(3).permutation(cloud.times))
    assert chosen([shuffled] * 4).time_step == 0.0


def test_the_heights_are_around_the_sensor_and_above_the_floor():
    assert (chosen([room_cloud()]).low, chosen([room_cloud()]).high) == (pytest.approx(0.35), pytest.approx(0.85))
    low = LEVEL._replace(z=0.3)
    assert chosen([room_cloud(low)], low).low == pytest.approx(0.1)
    unknown = LEVEL._replace(z=0.0)  # heights count from the sensor
    assert chosen([room_cloud(unknown, rings=(0.0,))], unknown).low == pytest.approx(-0.25)
    assert (chosen([room_cloud()], heights=(0.5, 0.7)).low, chosen([room_cloud()], heights=(0.5, 0.7)).high) == (
        0.5,
        0.7,
    )


def test_a_slice_without_walls_is_refused_with_the_heights_that_there_are():
    said = (
        r"the clouds of /points hold hardly any point between 1\.00 and 2\.00 m above the robot's frame; they lie "
        r"mostly between 0\.00 and 0\.\d\d m: choose heights at which there are walls with --cloud-heights"
    )
    with pytest.raises(DatasetError, match=said):
        chosen([room_cloud()], heights=(1.0, 2.0))
    with pytest.raises(DatasetError, match="they are empty"):
        chosen([room_cloud()._replace(points=np.zeros((0, 3)))])


def test_what_is_stated_replaces_what_tf_says_in_the_plane():
    tilted = LEVEL._replace(qy=math.sin(0.2), qw=math.cos(0.2))
    stated = SE2(1.0, 2.0, 0.7)
    assert mounting(tilted, None, None) == tilted
    both = mounting(tilted, stated, None)
    assert both.planar() == pytest.approx(stated)
    assert (both.z, both.up()) == (pytest.approx(0.6), pytest.approx(tilted.up()))
    assert mounting(None, None, None) == SE3.identity()
    assert mounting(None, stated, None).planar() == pytest.approx(stated)
    assert mounting(None, None, True) == HANGING
