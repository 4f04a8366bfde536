import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure.sequence_consistency import ClosureVotes, ClosureVotesConfig, PlacedBundle
from tbmslam.optimisation.pose_graph import relative_pose

CONFIG = ClosureVotesConfig(stops=3, memory=5.0, margin=1.5)
POSES = np.column_stack((np.arange(30.0), np.zeros(30), np.zeros(30)))
ANCHOR = 2


def vote(keyframe, correction, weight=0.4, anchor=ANCHOR):
    """Return a find that says the keyframe lies a correction, in the world, from where it is thought to be."""
    corrected = np.array([POSES[anchor], (correction @ SE2.from_array(POSES[keyframe]))])
    return PlacedBundle(keyframe, 0, anchor, relative_pose(corrected, 0, 1), np.eye(3), weight)


def elected_after(votes_of_stops, config=CONFIG):
    votes = ClosureVotes(config, POSES[:, 0])
    for found in votes_of_stops:
        votes.add(found)
        if chosen := votes.elected(POSES):
            return chosen
    return []


def test_what_several_stops_say_is_elected_whichever_submap_says_it():
    right = SE2(2.0, 1.0, 0.1)
    stops = [[vote(20 + k, right, anchor=ANCHOR + k), vote(20 + k, SE2(-k, 3.0 + k, 0.1))] for k in range(3)]
    chosen = elected_after(stops)
    assert [one.keyframe for one in chosen] == [20, 21, 22]
    for one in chosen:
        there = SE2.from_array(POSES[one.anchor]) @ one.pose
        np.testing.assert_allclose(there, right @ SE2.from_array(POSES[one.keyframe]), atol=1e-9)


def test_one_stop_alone_is_not_believed_however_many_places_it_names():
    assert elected_after([[vote(20, SE2(1.0, 0.0, 0.0), 0.8)] * 9, [vote(21, SE2(5.0, 0.0, 0.0))]]) == []


def test_two_places_that_are_named_alike_are_not_told_apart():
    stops = [[vote(20 + k, SE2(2.0, 0.0, 0.0), 0.5), vote(20 + k, SE2(-2.0, 0.0, 0.0), 0.4)] for k in range(6)]
    assert elected_after(stops) == []
    assert len(elected_after([[first, second._replace(weight=0.3)] for first, second in stops])) == 3


def test_each_contradicting_place_is_a_rival_once():
    votes = ClosureVotes(CONFIG, POSES[:, 0])
    right, rivals = SE2(2.0, 0.0, 0.0), [SE2(-2.0, 0.0, 0.1), SE2(0.0, 5.0, -0.3)]
    votes.add([vote(20, right), vote(20, rivals[0])])
    votes.add([vote(21, right), vote(21, right @ SE2(0.6, 0.0, 0.0))])
    votes.add([vote(22, right), vote(22, rivals[1]), vote(22, rivals[0])])
    elected = votes.elected(POSES)
    assert len(elected) == 3
    found = votes.rivals(elected, POSES)
    np.testing.assert_allclose(found, rivals, atol=1e-9)
    others = [vote(20 + k, rivals[0], 0.3) for k in range(3)]
    assert not votes.outweighs(elected, others)
    assert votes.outweighs(elected, others[:2])
    assert votes.outweighs(elected, [others[0], others[0], others[1]])


def test_a_place_that_slides_along_with_the_robot_is_not_believed():
    assert elected_after([[vote(10 + k, SE2(-0.6 * k, 0.0, 0.0))] for k in range(12)]) == []


def test_what_was_found_far_behind_is_forgotten():
    assert elected_after([[vote(k, SE2(1.0, 0.0, 0.0))] for k in (10, 14, 19, 24)]) == []
    assert len(elected_after([[vote(k, SE2(1.0, 0.0, 0.0))] for k in (10, 12, 14)])) == 3


def test_what_was_forgotten_is_not_elected():
    votes = ClosureVotes(CONFIG, POSES[:, 0])
    for k in range(3):
        votes.add([vote(20 + k, SE2(1.0, 0.0, 0.0))])
    assert len(votes.elected(POSES)) == 3
    votes.forget()
    votes.add([vote(23, SE2(1.0, 0.0, 0.0))])
    assert votes.elected(POSES) == []


@pytest.mark.parametrize(
    ("matched", "violated", "weight"), [(0.7, 0.0, 0.5), (0.7, 0.05, 0.3), (0.7, 0.2, 0.0), (0.2, 0.0, 0.0)]
)
def test_free_space_outweighs_what_matches(matched, violated, weight):
    assert ClosureVotes(ClosureVotesConfig(), POSES[:, 0]).weight(matched, violated) == pytest.approx(weight)


def test_weak_votes_must_add_up():
    stops = [[vote(20 + k, SE2(2.0, 1.0, 0.1))] for k in range(3)]
    assert len(elected_after(stops, CONFIG.model_copy(update={"min_sum": 1.1}))) == 3
    assert elected_after(stops, CONFIG.model_copy(update={"min_sum": 1.3})) == []
