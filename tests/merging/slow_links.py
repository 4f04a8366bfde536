"""The slow plain twin of `merging.map_graph.links`: one place and one way after another."""

import itertools
import math

from merging.map_graph.hypothesis import is_same_place


def slow_links_of(groups, offers, config):
    between = _by_groups(groups, offers)
    pairs = itertools.combinations(range(len(groups)), 2)
    return [joint for pair in pairs if (joint := _best_link(groups, *pair, between, config)) is not None]


def _by_groups(groups, offers):
    """Sort offers by the groups that they join, either way round."""
    where = {name: index for index, group in enumerate(groups) for name in group}
    between = {}
    for offer in offers:
        ends = tuple(where.get(name) for name in offer.pair)
        for first, second in (ends, ends[::-1]):
            if first is not None and second is not None and first != second:
                motion = _between(groups[first], groups[second], offer)
                between.setdefault((first, second), []).append((offer, motion))
    return between


def _best_link(groups, first, second, between, config):
    """Return the place of the second group in the first's frame for which most speaks; None if too little does."""
    direct = between.get((first, second), ())
    if not direct:
        return None
    others = [index for index in range(len(groups)) if index not in {first, second}]
    ways = [way for other in others for way in _ways_over(first, other, second, between)]
    joints = [(_support(motion, direct, ways, config), offer.wall_m, first, second, motion) for offer, motion in direct]
    good = [joint for joint in joints if joint[0] >= config.min_support]
    return max(good, key=lambda joint: joint[:2]) if good else None


def _support(place, direct, ways, config):
    leading = sorted(
        (offer for offer, there in direct if is_same_place(place, there, config)), key=lambda one: -one.odds
    )
    further = [(offer.probability, offer.accepted) for offer in leading[1:]]
    further += [(likely, sure) for likely, sure, _, there in ways if is_same_place(place, there, config)]
    against = [offer.odds for offer, there in direct if offer.accepted and not is_same_place(place, there, config)]
    against += [odds for _, _, odds, there in ways if odds > 0.0 and not is_same_place(place, there, config)]
    worth = [(math.log(1.0 - likely + likely / config.coincidence), sure) for likely, sure in further]
    refused = min(sum(one for one, sure in worth if not sure), math.log(1.0 / config.coincidence))
    return leading[0].odds + sum(one for one, sure in worth if sure) + refused - sum(against)


def _between(first, second, offer):
    """Return where an offer that joins two groups puts the second in the first's frame."""
    target, source = offer.pair
    if target in first:
        return first[target] @ offer.motion @ second[source].inverse()
    return first[source] @ offer.motion.inverse() @ second[target].inverse()


def _ways_over(first, middle, second, between):
    """Return of every way over a third group how likely it is right, whether it was accepted, its odds, its place."""
    there, onward = between.get((first, middle), ()), between.get((middle, second), ())
    # A way is right where both of its halves are.
    return [
        (a.probability * b.probability, a.accepted and b.accepted, min(a.odds, b.odds) - math.log(2.0), p @ q)
        for (a, p), (b, q) in itertools.product(there, onward)
    ]
