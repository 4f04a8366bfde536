"""Beams that end at one range wherever the robot drives, and whether others saw through the places where they ended."""

import math

import numpy as np

from tbmslam.kernels import BoolArray, FloatArray, Pose, kernel


@kernel
def smoothed_ranges(ranges: FloatArray) -> FloatArray:
    """Return the median (B,) of each beam and its two neighbours where all returned: single wrong ones do not count."""
    smooth = np.empty(len(ranges))
    for i in range(len(ranges)):
        one, two, three = ranges[max(i - 1, 0)], ranges[i], ranges[min(i + 1, len(ranges) - 1)]
        smooth[i] = max(min(one, two), min(max(one, two), three))
        if not math.isfinite(one + two + three):
            smooth[i] = two
    return smooth


@kernel
def follow_ranges(
    state: FloatArray, ranges: FloatArray, here: tuple[float, float], limits: tuple[float, float]
) -> None:
    """Learn which beams still end where they did.

    Parameters
    ----------
    state
        (5, B): the mean range since it is constant [m], the stamp [s] and the way [m] when that began, the looks since
        then, and how many of the ends seen then turned out to be no places.
    ranges
        Where the beams (B,) end now [m].
    here
        The stamp [s] and the way [m] by now.
    limits
        How far a range differs from the mean, at the most, and how near it is [m].
    """
    spread, near = limits
    for i in range(len(ranges)):
        if not math.isfinite(ranges[i]):  # what got lost on the way proves nothing
            continue
        if ranges[i] < near and abs(ranges[i] - state[0, i]) <= spread:
            state[0, i] += (ranges[i] - state[0, i]) / (state[3, i] + 1.0)
            state[3, i] += 1.0
        else:
            state[0, i] = ranges[i] if ranges[i] < near else np.nan
            state[1, i], state[2, i], state[3, i], state[4, i] = here[0], here[1], 1.0, 0.0


@kernel
def count_refuted(
    state: FloatArray,
    refuted: BoolArray,
    beams: tuple[float, float],
    lasers: FloatArray,
    stamps: FloatArray,
    seen: FloatArray,
    limits: tuple[float, float, float, float],
) -> None:
    """Count the ends of beams that are no places: another look saw through them, or the laser was there.

    Parameters
    ----------
    state
        As in `follow_ranges`.
    refuted
        Which ends (K, B) are known to be no places.
    beams
        Direction of the first beam and step between beams [rad].
    lasers, stamps, seen
        Poses (K, 3) of the laser, stamps (K,) [s] and ranges (K, B) [m] of the looks, the present one last.
    limits
        Beams that became constant after so long a way are not looked at [m]; how far beyond a place a beam went that
        saw through it [m]; how far beside it all beams must have done so, and how near no laser comes to anything [m];
        and how much farther beside, as no pose is exact [rad].
    """
    now = len(lasers) - 1
    for i in range(state.shape[1]):
        if not (state[3, i] >= 2.0 and state[2, i] <= limits[0]):
            continue
        angle = beams[0] + i * beams[1]
        cosine, sine = math.cos(angle), math.sin(angle)
        # Every other look is enough: one sees little more than the next.
        for k in range(now % 2, now + 1, 2):
            if refuted[k, i] or stamps[k] < state[1, i] or not math.isfinite(seen[k, i]):
                continue
            end = (seen[k, i] * cosine, seen[k, i] * sine)
            there = (lasers[k, 0], lasers[k, 1], lasers[k, 2])
            # What other looks said of earlier ends was asked when these were the present ones.
            for other in range(now % 2, now, 2) if k == now else range(now, now + 1):
                other_pose = (lasers[other, 0], lasers[other, 1], lasers[other, 2])
                before = max(other - 2, 0)
                if _is_seen_through(end, there, other_pose, beams, seen[other], limits) or _is_passed(
                    end, there, lasers[before], lasers[other], limits[2]
                ):
                    refuted[k, i] = True
                    state[4, i] += 1.0
                    break


@kernel
def _is_passed(end: tuple[float, float], pose: Pose, start: FloatArray, stop: FloatArray, near: float) -> bool:
    """Tell whether a laser went from one pose to another by way of a point in the frame of a third."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    x = pose[0] + cosine * end[0] - sine * end[1] - start[0]
    y = pose[1] + sine * end[0] + cosine * end[1] - start[1]
    along_x, along_y = stop[0] - start[0], stop[1] - start[1]
    length = along_x * along_x + along_y * along_y
    share = min(max((x * along_x + y * along_y) / (length + 1e-12), 0.0), 1.0)
    return bool((x - share * along_x) ** 2 + (y - share * along_y) ** 2 < near * near)


@kernel
def refuted_runs(state: FloatArray, way: float, limits: tuple[float, float, int]) -> BoolArray:
    """Return which beams (B,) end on no place of the world: for long enough, refuted often enough, with neighbours.

    Beside such beams one refutation is enough, and half the way: edges scatter.

    Parameters
    ----------
    state
        As in `follow_ranges`.
    way
        The way by now [m].
    limits
        The least way [m], the least number of ends that are no places, and how many neighbours there must be.
    """
    travelled, refuted, fewest = limits
    found = np.zeros(state.shape[1], dtype=np.bool_)
    begin, sure = 0, 0
    for i in range(len(found) + 1):
        if i < len(found) and way - state[2, i] >= 0.5 * travelled and state[4, i] >= 1.0:
            sure += int(way - state[2, i] >= travelled and state[4, i] >= refuted)
            continue
        if sure >= fewest:
            found[begin:i] = True
        begin, sure = i + 1, 0
    return found


@kernel
def _is_seen_through(
    end: tuple[float, float],
    pose: Pose,
    other: Pose,
    beams: tuple[float, float],
    seen: FloatArray,
    limits: tuple[float, float, float, float],
) -> bool:
    """Tell whether a point in the frame of a laser was seen through from another pose."""
    _, depth, beside, unsure = limits
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    away_x = pose[0] + cosine * end[0] - sine * end[1] - other[0]
    away_y = pose[1] + sine * end[0] + cosine * end[1] - other[1]
    bearing = math.atan2(away_y, away_x) - other[2]
    distance = math.sqrt(away_x * away_x + away_y * away_y)
    # The beam next to the bearing, counted from the first one within one turn; most ends are told by that one alone.
    turn = (bearing - beams[0]) * (1.0 if beams[1] > 0.0 else -1.0)
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi))
    # Asked before the division: a single beam may have no step, and numbers too large for a place in memory are any.
    if distance <= beside or turn >= len(seen) * abs(beams[1]):
        return False
    middle = round(turn / abs(beams[1]))
    if middle >= len(seen) or not seen[middle] >= distance + depth:
        return False
    wide = math.asin(beside / distance) + unsure
    first = math.floor((turn - wide) / abs(beams[1]))
    last = math.ceil((turn + wide) / abs(beams[1]))
    if first < 0 or last >= len(seen):
        return False
    returned = 0
    for i in range(first, last + 1):
        if math.isfinite(seen[i]):
            returned += 1
            if seen[i] < distance + depth:
                return False
    return returned >= 0.8 * (last - first + 1)
