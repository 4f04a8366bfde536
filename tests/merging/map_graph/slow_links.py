"""The slow plain twin of `merging.map_graph.links`: one pose and one path after another."""

import itertools
import math

from merging.map_graph.links import is_same_pose


def slow_links_of(groups, edges, config):
    between = _by_groups(groups, edges)
    pairs = itertools.combinations(range(len(groups)), 2)
    return [link for pair in pairs if (link := _best_link(groups, *pair, between, config)) is not None]


def _by_groups(groups, edges):
    """Sort edges by the groups that they join, in both directions."""
    where = {name: index for index, group in enumerate(groups) for name in group}
    between = {}
    for edge in edges:
        ends = tuple(where.get(name) for name in edge.pair)
        for first, second in (ends, ends[::-1]):
            if first is not None and second is not None and first != second:
                motion = _between(groups[first], groups[second], edge)
                between.setdefault((first, second), []).append((edge, motion))
    return between


def _best_link(groups, first, second, between, config):
    """Return the link with the largest support between two groups; None if no support suffices."""
    direct = between.get((first, second), ())
    if not direct:
        return None
    others = [index for index in range(len(groups)) if index not in {first, second}]
    paths = [path for other in others for path in _paths_over(first, other, second, between)]
    links = [
        (_support(motion, direct, paths, config), edge.hypothesis.agreed_wall_m, first, second, motion)
        for edge, motion in direct
    ]
    good = [link for link in links if link[0] >= config.min_support]
    return max(good, key=lambda link: link[:2]) if good else None


def _support(pose, direct, paths, config):
    leading = sorted(
        (edge for edge, there in direct if is_same_pose(pose, there, config)), key=lambda one: -one.hypothesis.log_odds
    )
    further = [(edge.probability, edge.hypothesis.accepted) for edge in leading[1:]]
    further += [(likely, sure) for likely, sure, _, there in paths if is_same_pose(pose, there, config)]
    against = [
        edge.hypothesis.log_odds
        for edge, there in direct
        if edge.hypothesis.accepted and not is_same_pose(pose, there, config)
    ]
    against += [odds for _, _, odds, there in paths if odds > 0.0 and not is_same_pose(pose, there, config)]
    worth = [(math.log(1.0 - likely + likely / config.coincidence), sure) for likely, sure in further]
    refused = min(sum(one for one, sure in worth if not sure), math.log(1.0 / config.coincidence))
    return leading[0].hypothesis.log_odds + sum(one for one, sure in worth if sure) + refused - sum(against)


def _between(first, second, edge):
    """Return the pose of the second group in the frame of the first, by an edge between two of their maps."""
    target, source = edge.pair
    if target in first:
        return first[target] @ edge.motion @ second[source].inverse()
    return first[source] @ edge.motion.inverse() @ second[target].inverse()


def _paths_over(first, middle, second, between):
    """Return probability, acceptance, log odds and pose of every path over a third group."""
    there, onward = between.get((first, middle), ()), between.get((middle, second), ())
    # A path is right if both of its edges are.
    return [
        (
            a.probability * b.probability,
            a.hypothesis.accepted and b.hypothesis.accepted,
            min(a.hypothesis.log_odds, b.hypothesis.log_odds) - math.log(2.0),
            p @ q,
        )
        for (a, p), (b, q) in itertools.product(there, onward)
    ]
