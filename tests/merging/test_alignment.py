import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merging.alignment import Alignment, PoseHypothesis, bent_by, covariance_of, deviations, known_best_at, seen_from
from merging.config.registration import ExactnessConfig, StructureConfig, VerificationConfig
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

COVARIANCE = ((0.04, 0.01, -0.002), (0.01, 0.09, 0.003), (-0.002, 0.003, 0.0004))
PLACE, ELSEWHERE = SE2(3.0, -2.0, 1.0), SE2(-7.0, 1.0, 2.5)
FOUND = Alignment(
    "correlation",
    True,
    "",
    PLACE,
    covariance=COVARIANCE,
    alternatives=(PoseHypothesis(ELSEWHERE, 0.1, 5.0, COVARIANCE),),
)


def test_a_reversed_alignment_has_the_inverse_pose():
    back = FOUND.reversed()
    assert back.T_target_source == PLACE.inverse()
    assert back.alternatives[0].T_target_source == ELSEWHERE.inverse()
    assert back.covariance == seen_from(COVARIANCE, PLACE)
    assert deviations(back.covariance) == pytest.approx(deviations(COVARIANCE), rel=1e-6)
    again = back.reversed()
    assert again.T_target_source == pytest.approx(PLACE)
    np.testing.assert_allclose(again.covariance, COVARIANCE, atol=1e-9)


def test_unknown_poses_and_covariances_stay_unknown_in_reverse():
    assert Alignment("correlation", False, "").reversed() == Alignment("correlation", False, "")
    assert Alignment("hough", True, "", SE2(1.0, 0.0, math.pi / 2.0)).reversed().covariance is None


def test_an_alignment_is_written_with_lists_of_numbers():
    written = FOUND.as_json()
    assert written["T_target_source"] == list(PLACE)
    assert written["covariance"] == COVARIANCE
    assert written["alternatives"][0]["T_target_source"] == list(ELSEWHERE)


def test_it_is_shown_in_a_line():
    found = Alignment("correlation", True, "confidence 0.986", SE2(3.0, -2.0, math.pi / 2.0))
    assert repr(found) == "Alignment(accepted, x 3.000 m, y -2.000 m, turned 90.00 degrees: confidence 0.986)"
    assert repr(Alignment("correlation", False, "the map is empty")) == "Alignment(refused: the map is empty)"


LIMITS, CONFIG = VerificationConfig().limits(), ExactnessConfig()
POSES = st.builds(SE2, st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-math.pi, math.pi))
HERE = SE2.identity()


def hall(length_m, width_m=0.0):
    """One long wall, and another that faces it where the hall has a width."""
    rows, cols = 60 + round(width_m / 0.05), round(length_m / 0.05)
    masses = np.zeros((rows, cols, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[10 : rows - 10] = (0.0, 1.0, 0.0, 0.0)
    masses[8:10] = (0.0, 0.0, 1.0, 0.0)
    if width_m:
        masses[rows - 10 : rows - 8] = (0.0, 0.0, 1.0, 0.0)
    return WallMap.from_grid(TbmGrid(GridGeometry(0.05, 0.0, 0.0, rows, cols), masses), StructureConfig())


def exact(one, motion=HERE):
    return covariance_of(one, one, motion, LIMITS, CONFIG)


def test_a_wall_holds_a_map_across_itself_and_not_along():
    here = seen_from(exact(hall(20.0)), SE2(-10.0, 0.0, 0.0))  # about its middle
    along, across, turn = np.sqrt(np.diag(here))
    assert along == pytest.approx(math.hypot(CONFIG.place_m, CONFIG.bend_m), rel=1e-3)
    across_m = (20.0 / CONFIG.wall_m**2 + CONFIG.place_m**-2) ** -0.5
    assert across == pytest.approx(math.hypot(across_m, CONFIG.bend_m), rel=0.02)
    levers = 20.0**3 / 12.0 / CONFIG.wall_m**2 + CONFIG.turn_rad**-2  # of a rod about its middle
    assert turn == pytest.approx(math.hypot(levers**-0.5, CONFIG.bend_rad), rel=0.03)


def test_the_longer_the_walls_the_more_exact():
    found = [deviations(exact(hall(length))) for length in (2.0, 5.0, 20.0, 80.0)]
    assert found == sorted(found, reverse=True)
    assert [turn for _, turn in found] == sorted((turn for _, turn in found), reverse=True)


def test_walls_that_face_each_other_count_both():
    assert deviations(exact(hall(10.0, 5.0)))[1] < deviations(exact(hall(10.0)))[1]


def test_where_no_wall_agrees_nothing_is_known_but_that_it_was_found():
    one = hall(20.0)
    place_m, turn = deviations(exact(one, SE2(500.0, 0.0, 0.0)))
    assert place_m == pytest.approx(math.sqrt(2.0) * math.hypot(CONFIG.place_m, CONFIG.bend_m))
    assert turn == pytest.approx(math.hypot(CONFIG.turn_rad, CONFIG.bend_rad))


def test_a_bent_map_lies_nowhere_as_exactly():
    one = exact(hall(20.0), SE2(500.0, 0.0, 0.0))
    for frame in (SE2.identity(), SE2(300.0, -20.0, 1.0)):
        there = seen_from(one, frame)
        place_m, turn = deviations(there)
        bent = bent_by(there, 0.4, 0.03)
        assert deviations(bent) == pytest.approx((math.hypot(place_m, 0.4), math.hypot(turn, 0.03)))
        assert known_best_at(bent) == pytest.approx(known_best_at(there))
    assert np.allclose(bent_by(one, 0.0, 0.0), one)


def test_walls_that_count_nothing_tell_nothing():
    one = hall(20.0)
    weightless = replace(one, weights=np.zeros_like(one.weights))
    assert exact(weightless) == exact(one, SE2(500.0, 0.0, 0.0))


def test_the_same_seen_from_either_map(rooms):
    one, other = (WallMap.from_grid(rooms(1), StructureConfig()) for _ in range(2))
    forth = exact(one)
    back = covariance_of(other, one, SE2.identity(), LIMITS, CONFIG)
    np.testing.assert_allclose(seen_from(forth, SE2.identity()), back, rtol=1e-9, atol=1e-12)


@given(T_here_there=POSES, error=st.tuples(*[st.floats(-1e-3, 1e-3)] * 3))
def test_an_error_in_one_frame_is_the_adjoint_of_that_in_another(T_here_there, error):
    """T exp(e) T^-1 = exp(Ad e): the covariance of one such error is its outer product."""
    there = np.outer(error, error)
    here = np.array((T_here_there @ SE2.exp(*error) @ T_here_there.inverse()).log())
    np.testing.assert_allclose(seen_from(tuple(map(tuple, there)), T_here_there), np.outer(here, here), atol=1e-8)


@given(pose=POSES)
def test_how_exact_it_is_does_not_depend_on_the_frame(pose):
    assert deviations(seen_from(COVARIANCE, pose)) == pytest.approx(deviations(COVARIANCE), rel=1e-4)
    np.testing.assert_allclose(seen_from(seen_from(COVARIANCE, pose), pose.inverse()), COVARIANCE, atol=1e-9)


@given(pose=POSES)
def test_the_point_known_best_is_one_whatever_the_frame(pose):
    point = known_best_at(COVARIANCE)
    np.testing.assert_allclose(known_best_at(seen_from(COVARIANCE, pose)), pose.apply(point), atol=1e-5)


def test_the_point_known_best_is_the_middle_of_what_agrees():
    one = hall(20.0)
    np.testing.assert_allclose(
        known_best_at(exact(one)), np.average(one.points, axis=0, weights=one.weights), atol=0.05
    )


def test_a_wall_of_one_cell_is_as_long_as_the_cell():
    masses = np.full((5, 5, 4), (0.0, 1.0, 0.0, 0.0), dtype=np.float32)
    masses[:2] = (0.0, 0.0, 0.0, 1.0)
    masses[2, 2] = (0.0, 0.0, 1.0, 0.0)
    one = WallMap.from_grid(TbmGrid(GridGeometry(0.5, 0.0, 0.0, 5, 5), masses), StructureConfig())
    one = replace(one, weights=np.ones(1), normals=np.array([[0.0, 1.0]]))
    across = math.sqrt(seen_from(exact(one), SE2(-1.25, -1.25, 0.0))[1][1])
    across_m = (0.5 / CONFIG.wall_m**2 + CONFIG.place_m**-2) ** -0.5
    assert across == pytest.approx(math.hypot(across_m, CONFIG.bend_m), rel=1e-6)


def test_an_alignment_without_grids_is_words_in_a_notebook():
    reason = "0.2 < 0.85 & so on"
    shown = Alignment("correlation", False, reason, confidence=0.2)._repr_html_()
    assert shown == "<p><b>Refused, confidence 0.200.</b></p><p>0.2 &lt; 0.85 &amp; so on.</p>"
    assert "<img" not in FOUND._repr_html_()
    assert "x 3.000 m, y -2.000 m, turned 57.30°" in FOUND._repr_html_()
