import math
from dataclasses import replace

import numpy as np
import pytest

from merging.alignment import Alignment
from merging.map_graph.grouping import Group
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.propagation import deformed_maps
from merging.nonrigid.search import NonrigidRegistration
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap

GEOMETRY = GridGeometry(0.05, 0.0, 0.0, 240, 320)  # 16 x 12 m
MIDDLES = np.array([[4.0, 3.0], [12.0, 3.0], [4.0, 9.0], [12.0, 9.0]])
SPOT = (11.0, 8.5)
NEAR_M = 1.5 * GEOMETRY.resolution
MOTIONS = {"b": SE2(3.0, -2.0, 0.7), "c": SE2(-1.0, 2.0, -0.4)}
ASIDE = {
    "b": [(0.3, 0.0), (-0.2, 0.2), (0.1, -0.3), (0.5, 0.3)],
    "c": [(0.0, 0.3), (0.2, 0.0), (-0.3, 0.1), (0.4, 0.2)],
}


def spot_of(one):
    """The position of the only wall of a map."""
    walls = np.nonzero(one.grid.masses[..., OCCUPIED] > one.grid.masses[..., FREE])
    return one.grid.geometry.centres_of(*walls).mean(axis=0)


def spotted():
    """A map of one spot of wall."""
    masses = np.tile(np.float32([0.0, 1.0, 0.0, 0.0]), (240, 320, 1))
    row, col = GEOMETRY.cell_at(*SPOT)
    masses[row - 1 : row + 2, col - 1 : col + 2] = (0.0, 0.0, 1.0, 0.0)
    return TbmMap(TbmGrid(GEOMETRY, masses))


def registration(name):
    """A registration whose four tiles differ from one rigid transform."""
    motion = MOTIONS[name]
    deformation = Deformation(MIDDLES, [SE2(x, y, 0.0) @ motion for x, y in ASIDE[name]], 4.0)
    return NonrigidRegistration(Alignment("correlation", accepted=True, reason="", T_target_source=motion), deformation)


def backward(one):
    """The same with target and source exchanged."""
    return NonrigidRegistration(one.alignment.reversed(), one.deformation.inverse())


def alone(names):
    return [Group({name: SE2.identity()}) for name in names]


def driven(one):
    drive = Drive("robot", Trajectory(np.zeros(0), np.zeros((0, 3))), Keyframes.from_scans([], [], []))
    return replace(one, drives=(drive,))


@pytest.fixture
def maps():
    return {name: spotted() for name in "abc"}


def bent_spot(name):
    """The position of the spot in the deformed map, in the map's frame."""
    return MOTIONS[name].inverse().apply(registration(name).deformation.apply(np.array([SPOT])))[0]


def test_the_source_is_deformed(maps):
    group = Group({"a": SE2.identity(), "b": MOTIONS["b"]}, (("a", "b"),))
    bent = deformed_maps({("a", "b"): registration("b")}, maps, [group], alone("ab"))
    assert list(bent) == ["b"]
    assert math.dist(bent_spot("b"), SPOT) > 0.1
    assert math.dist(spot_of(bent["b"]), bent_spot("b")) < NEAR_M


def test_a_map_without_keyframes_is_deformed_rather_than_one_with_keyframes(maps):
    group = Group({"a": SE2.identity(), "b": MOTIONS["b"]}, (("a", "b"),))
    bent = deformed_maps({("a", "b"): registration("b")}, {**maps, "b": driven(maps["b"])}, [group], alone("ab"))
    assert list(bent) == ["a"]
    expected = MOTIONS["b"].apply(registration("b").deformation.inverse().apply(np.array([SPOT])))[0]
    assert math.dist(expected, SPOT) > 0.1
    assert math.dist(spot_of(bent["a"]), expected) < NEAR_M


def test_cells_that_no_keyframe_saw_are_kept(maps):
    """A map merged from a drive and a picture has such cells."""
    group = Group({"a": SE2.identity(), "b": MOTIONS["b"]}, (("a", "b"),))
    all_driven = {name: driven(one) for name, one in maps.items()}
    bent = deformed_maps({("a", "b"): registration("b")}, all_driven, [group], alone("ab"))
    assert math.dist(spot_of(bent["b"]), bent_spot("b")) < NEAR_M
    assert bent["b"].grid.is_known().sum() == pytest.approx(maps["b"].grid.is_known().sum(), rel=0.1)


@pytest.mark.parametrize("first", ["a", "b"])
def test_maps_that_were_joined_rigidly_are_not_deformed(maps, first):
    """Two rigidly joined maps are registered with a third map, whichever is named first."""
    poses = {"a": SE2.identity(), "b": MOTIONS["b"], "c": MOTIONS["b"]}
    registrations = {("a", "b"): registration("b"), ("b", "c"): backward(registration("b"))}
    if first == "b":
        registrations = {("b", "a"): backward(registration("b")), ("b", "c"): backward(registration("b"))}
    group = Group(poses, (*registrations, ("a", "c")))
    before = [Group({"a": SE2.identity(), "c": SE2.identity()}, (("a", "c"),)), *alone("b")]
    bent = deformed_maps(registrations, {**maps, "b": driven(maps["b"])}, [group], before)
    assert list(bent) == ["b"]


def test_a_map_registered_to_a_deformed_map_takes_over_its_deformation(maps):
    registrations = {("a", "b"): registration("b"), ("b", "c"): registration("c")}
    group = Group({"a": SE2.identity(), "b": MOTIONS["b"], "c": MOTIONS["b"] @ MOTIONS["c"]}, tuple(registrations))
    bent = deformed_maps(registrations, maps, [group], alone("abc"))
    assert list(bent) == ["b", "c"]
    on_b = registration("c").deformation.apply(np.array([SPOT]))
    expected = group.poses["c"].inverse().apply(registration("b").deformation.apply(on_b))[0]
    assert math.dist(expected, bent_spot("c")) > 0.1
    assert math.dist(spot_of(bent["c"]), expected) < NEAR_M


def test_a_map_of_the_rigid_set_of_a_deformed_map_is_deformed_with_it(maps):
    T_b_c = SE2(1.0, 0.5, 0.2)
    others = dict.fromkeys(("a0", "a1"), maps["a"])  # the larger set
    fixed = dict.fromkeys(("a", *others), SE2.identity())
    before = [Group(fixed), Group({"b": SE2.identity(), "c": T_b_c}, (("b", "c"),))]
    group = Group({**fixed, "b": MOTIONS["b"], "c": MOTIONS["b"] @ T_b_c}, (("a", "b"), ("b", "c")))
    bent = deformed_maps({("a", "b"): registration("b")}, {**maps, **others}, [group], before)
    assert list(bent) == ["b", "c"]
    spot_in_b = T_b_c.apply(np.array([SPOT]))
    expected = group.poses["c"].inverse().apply(registration("b").deformation.apply(spot_in_b))[0]
    assert math.dist(expected, SPOT) > 0.1
    assert math.dist(spot_of(bent["c"]), expected) < NEAR_M


def test_unused_registrations_deform_no_map(maps):
    registrations = {("a", "b"): registration("b"), ("b", "c"): registration("c")}
    group = Group({"a": SE2.identity(), "c": SE2.identity()}, (("a", "c"),))
    assert deformed_maps(registrations, maps, [group, *alone("b")], alone("abc")) == {}
