"""What every method of the related work owes: the transform of an easy pair, and answers to empty maps."""

import math
from typing import get_args

import numpy as np
import pytest

from merging import MergeConfig, align, merge
from merging.baselines import BASELINES, align_baseline
from merging.config import Method
from merging.fusion import warp
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

T_SOURCE_TARGET = SE2(2.1, -1.3, 0.7)


def turned(grid):
    """The same floor in another frame."""
    return warp(grid, T_SOURCE_TARGET, GridGeometry(0.05, 0.0, 0.0, 1, 1))


def error_of(found, grid):
    """How far the middle of the source, and its direction, are from their true place."""
    centre = grid.geometry.centre_of(grid.geometry.rows // 2, grid.geometry.cols // 2)
    apart = found @ T_SOURCE_TARGET
    return math.dist(apart.apply(centre), centre), abs(math.degrees(apart.theta))


def found(method, target, source, **changes):
    return align(TbmMap(target), TbmMap(source), MergeConfig.model_validate({"method": method, **changes}))


@pytest.mark.parametrize("method", BASELINES)
def test_an_easy_pair_is_found_and_accepted_the_same_way_every_time(method, rooms):
    target = rooms(3)
    answers = [found(method, target, turned(target)) for _ in range(2)]
    assert answers[0] == answers[1]
    assert answers[0].accepted, answers[0].reason
    assert answers[0].method == method
    metres, degrees = error_of(answers[0].T_target_source, target)
    assert metres < 0.2
    assert degrees < 1.0


def blocks(seed):
    """A floor full of blocks, half a metre wide, in a place of their own for every seed."""
    masses = np.tile(np.array([0.0, 0.9, 0.0, 0.1], dtype=np.float32), (160, 200, 1))
    crowded = np.random.default_rng(seed).random((16, 20)) < 0.25
    masses[np.kron(crowded, np.ones((10, 10), dtype=bool))] = (0.0, 0.0, 0.9, 0.1)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 160, 200), masses)


@pytest.mark.parametrize("method", ["birk-carpin", "carpin", "saeedi", "trehard"])
def test_unrelated_maps_are_refused(method):
    answer = found(method, blocks(1), blocks(2))
    assert not answer.accepted, answer
    assert answer.T_target_source is not None  # what was refused


def test_the_likelihood_demanded_is_a_parameter():
    answer = found("li", blocks(1), blocks(2), baselines={"li": {"min_likelihood": 0.95}})
    assert not answer.accepted
    assert answer.reason.endswith("of the walls on known cells, accepted from 0.95")


def test_three_keypoints_that_agree_are_enough_for_the_paper_s_program_and_not_for_ours():
    assert found("dobrokhvalov-filatov", blocks(1), blocks(2)).accepted
    assert not found("features", blocks(1), blocks(2)).accepted


@pytest.mark.parametrize("method", BASELINES)
def test_maps_without_walls_or_without_anything_are_refused(method, rooms):
    nothing = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 40, 40))
    bare = TbmGrid(nothing.geometry, np.tile(np.array([0.0, 0.9, 0.0, 0.1], dtype=np.float32), (40, 40, 1)))
    assert "the source map is empty: no cell of it was seen" in found(method, rooms(3), nothing).reason
    assert "the target map is empty" in found(method, nothing, rooms(3)).reason
    if method != "birk-carpin":  # which looks at free cells too
        assert not found(method, rooms(3), bare).accepted
        assert not found(method, bare, rooms(3)).accepted


def test_a_sliver_of_overlap_is_not_accepted(rooms):
    target = rooms(3)
    answer = found("birk-carpin", target, turned(target), baselines={"min_overlap_share": 1.0})
    assert not answer.accepted
    assert answer.reason.startswith("the maps overlap by ")
    assert answer.reason.endswith(", under 100%")


def test_other_names_are_no_baselines(rooms):
    with pytest.raises(ValueError, match=r"method must be one of birk-carpin, .*, got 'correlation'"):
        align_baseline(rooms(3), rooms(3), 0.05, MergeConfig())


def test_every_method_of_the_merger_is_its_own_or_a_baseline():
    assert set(get_args(Method)) == {"correlation", "features", *BASELINES}


def test_maps_are_merged_by_a_baseline(rooms):
    target = rooms(3)
    maps = {"here": TbmMap(target), "there": TbmMap(turned(target))}
    result = merge(maps, MergeConfig(method="trehard", rule="conjunctive"))
    assert result.merged is not None
    assert error_of(result.poses["there"], target)[0] < 0.2
