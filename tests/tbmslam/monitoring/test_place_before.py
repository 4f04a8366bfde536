import math

import numpy as np
import pytest

from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.world import World
from tbmslam.monitoring.place_before import PlaceBefore, PlaceBeforeConfig, View
from tbmslam.se2 import SE2

CONFIG = PlaceBeforeConfig()
POSES = [(-1.0, 0.0, 0.0), (0.0, 0.3, 1.0), (1.0, -0.2, 2.0)]


def room(width, height):
    x, y = width / 2.0, height / 2.0
    corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)])
    return np.hstack((corners[:-1], corners[1:]))


def thing(x, y, size):
    return room(size, size) + np.array((x, y, x, y))


def views(walls, beams=720):
    laser = SimulatedLaser(
        beams=beams,
        angle_min=-math.pi,
        angle_increment=math.tau / beams,
        wrong_returns=0.0,
        T_robot_sensor=SE2.identity(),
    )
    world, rng = World("room", 0, walls, np.zeros((1, 2))), np.random.default_rng(1)
    scans = laser.scans(world, np.arange(float(len(POSES))), np.array(POSES), rng)
    return [View.of(scan, SE2(*pose), CONFIG.reach) for scan, pose in zip(scans, POSES, strict=True)]


def contrast(before, after, beams=720):
    place = PlaceBefore(views(before, beams), SE2.identity(), CONFIG)
    for view in views(after, beams):
        place.see(view)
    return place.contrast()


@pytest.mark.parametrize("beams", [120, 360, 720])
def test_the_same_room_agrees_all_around(beams):
    found = contrast(room(8.0, 10.0), room(8.0, 10.0), beams)
    assert found.contradicting() == 0.0
    assert found.agreeing > 0.4 * 36.0 * min(beams / 360.0, 1.0)


def test_another_room_contradicts_both_ways():
    """It is narrower and longer: walls stand where was seen through, and others are gone."""
    found = contrast(room(8.0, 10.0), room(6.0, 14.0))
    assert found.standing > 6.0
    assert found.gone > 4.0
    assert found.contradicting() == min(found.standing, found.gone)


def test_a_niche_that_opens_contradicts_one_way_only():
    narrow, wide = room(8.0, 10.0), room(8.0, 10.0)
    open_wall = np.array([(4.0, -5.0, 4.0, -1.0), (4.0, 1.0, 4.0, 5.0), (7.0, -2.0, 7.0, 2.0), (4.0, 1.0, 7.0, 1.0)])
    wide = np.vstack((wide[[0, 2, 3]], open_wall, [(4.0, -1.0, 7.0, -1.0)]))
    opened, closed = contrast(narrow, wide), contrast(wide, narrow)
    assert opened.gone == pytest.approx(2.0, abs=0.5)
    assert closed.standing == pytest.approx(2.0, abs=0.5)
    assert opened.contradicting() == closed.contradicting() == 0.0


def test_things_as_small_as_people_may_come_and_go():
    walls = room(8.0, 10.0)
    found = contrast(np.vstack((walls, thing(2.5, 2.5, 0.5))), np.vstack((walls, thing(-2.5, 2.5, 0.5))))
    assert found.standing == found.gone == 0.0


def test_what_comes_and_goes_within_one_time_is_no_wall():
    """A crowd is as wide as a wall, and may be at one place in several views."""
    walls = room(8.0, 10.0)
    crowded = np.vstack((walls, thing(2.0, 3.0, 1.4)))
    both = [*views(crowded), *views(walls)]
    for before, after in ((both, views(walls)), (views(walls), both)):
        place = PlaceBefore(before, SE2.identity(), CONFIG)
        for view in after:
            place.see(view)
        assert place.contrast()[1:] == (0.0, 0.0)
    assert contrast(walls, crowded).standing > 1.0
    assert contrast(crowded, walls).gone > 1.0


def test_what_is_near_the_place_is_its_own():
    """A cabin takes its walls along, and its door opens and shuts."""
    found = contrast(room(8.0, 10.0), np.vstack((room(8.0, 10.0), room(2.4, 2.4))))
    assert found == (0.0, 0.0, 0.0)


def test_without_anything_before_nothing_is_said():
    place = PlaceBefore([], SE2.identity(), CONFIG)
    for view in views(room(8.0, 10.0)):
        place.see(view)
    assert place.contrast() == (0.0, 0.0, 0.0)


def test_scans_without_a_hit_say_nothing():
    far = views(room(90.0, 90.0))
    assert all(len(view.points) == 0 for view in far)
    place = PlaceBefore(far, SE2.identity(), CONFIG)
    place.see(far[0])
    assert place.contrast() == (0.0, 0.0, 0.0)


def test_lasers_may_change_their_beams():
    walls, open_walls = room(8.0, 10.0), room(8.0, 12.0)
    coarse = [view._replace(seen=np.repeat(view.seen.min(), 90)) for view in views(walls)]
    place = PlaceBefore([*views(walls), *coarse], SE2.identity(), CONFIG)
    for view in views(open_walls):
        place.see(view)
    assert place.contrast() == contrast(walls, open_walls)


def test_a_robot_that_turns_for_hours_does_not_fill_the_memory():
    (view, *_) = views(room(8.0, 10.0))
    place = PlaceBefore([view], SE2.identity(), CONFIG)
    for _ in range(500):
        place.see(view)
    assert len(place._views_now) < 500
