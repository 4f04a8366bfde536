"""Faults of sensors and of the world: a right map, or a warning that names the time."""

import math
from functools import partial
from pathlib import Path
from typing import Any

from datasets.synthetic.robot.faults import Fault
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.trajectory_file import read_tum
from tests.faults.fault_case import FaultCase, Outcome, mapped, simulated

_RIGHT_M = 0.1
"""Error of the trajectory (root mean square) up to which a map is right [m], told faults or not."""

_SOON_S = 8.0


def _tried(
    folder: Path, fault: str, *, told: str = "", world: str = "office", remedy: bool = False, at_end: bool = False
) -> Outcome:
    """Map a simulated drive with a fault; where something must be told, the time must be right, too.

    With `remedy` the warning tells that the map may be wrong, or what to do about it, and that is enough. What a fault
    does may show `at_end`, when it is over.
    """
    bag = simulated(folder / "drive", "--world", world, "--fault", fault)
    done, run = mapped(bag, folder / "maps")
    if done.code or not run:
        return Outcome(f"exit {done.code}: {done.stderr.strip()[-100:]}", "everything", survived=False)
    trajectory = read_tum(folder / "maps" / "robot_0" / "trajectory.tum")
    ate = align_trajectories(read_tum(bag.with_suffix(".truth.tum")), trajectory).ate_m
    since, until = Fault.parse(fault).at, Fault.parse(fault).at + (Fault.parse(fault).seconds if at_end else 0.0)
    # What a fault does shows a little later: at the next keyframe, at the next turn, when it ends.
    incidents = [incident for incident in run["incidents"] if since - 1.0 <= incident["at_s"] <= until + _SOON_S]
    fitting = next((incident for incident in incidents if told in incident["what"]), None)
    shown = (incidents or run["incidents"])[:2]
    warned = "; ".join(
        incident["what"] if incident["all_along"] else f"at {incident['at_s']:.1f} s: {incident['what']}"
        for incident in shown
    )
    result, counts = run["result"], run["counts"]
    used = result["scans"] - len(trajectory)
    lost = [f"{n} scans {reason}" for reason, n in counts["dropped"].items()]
    lost += [f"{counts['gap_seconds']:.0f} s without scans"] if counts["gaps"] else []
    lost += [f"{used} scans left out"] if used else []
    said = f"ATE {ate:.3f} m" + (f"; {warned}" if warned else "")
    limit = math.inf if remedy else _RIGHT_M
    right = ate <= limit and (not told or fitting is not None)
    return Outcome(said, ", ".join(lost) or "nothing", survived=right)


def _case(name: str, fault: str, told: str = "", *, quick: bool = False, **more: Any) -> FaultCase:
    return FaultCase(name, partial(_tried, fault=fault, told=told, **more), quick)


CASES = (
    _case("odometry missing for 20 s", "odometry_gap@20+20", "no odometry", quick=True),
    _case("odometry jumps by 2 m and a radian", "odometry_jump@20", "disagree"),
    _case("odometry restarts at zero", "odometry_reset@20", "disagree"),
    _case("odometry freezes for 2 s, then jumps", "odometry_freeze@20+2", "odometry"),
    _case("robot pushed for 15 s, wheels do not turn", "odometry_stuck@20+15", "disagree"),
    _case("odometry tells forward while the robot reverses, 6 s", "odometry_reversed@20+6x2.7", "disagree"),
    _case("odometry tells backward along an office's corridor, 6 s", "odometry_reversed@36+6", "disagree"),
    _case("odometry in centimetres", "odometry_unit@0+600", "--odometry-scale 0.01", quick=True),
    _case("clock of the laser 82.2 s behind", "clock_offset@0"),
    _case("clock of the laser 3 s wrong for 20 s", "clock_step@20+20", "clock of the scans", quick=True),
    _case("stamps step back every second", "stamps_back@20+20", "step back"),
    _case("every other stamp twice", "stamps_twice@20+20"),
    _case("laser unplugged for 20 s, robot drives on", "laser_gap@20+20", "no scans", quick=True),
    _case("half of the beams covered", "beams_blocked@20+60", "blocks", quick=True),
    # Posts are detected once the robot has turned. Here it never turns, and its own posts fit no wall.
    _case("two posts of the robot in view, straight along a corridor", "parts_in_view@0+600", world="corridor"),
    _case("all ranges 10 % too long", "range_scale@0+600", "wrong scale", remedy=True),
    _case("all ranges 0.1 m too long", "range_offset@0+600", "--range-offset -0.1", quick=True),
    _case("angles between beams stated 3 % too large", "angle_step@0+600", "--angle-step-deg", remedy=True),
    _case("laser stated 0.3 m aside and turned by 10°", "mount@0+600", "--sensor-pose 0.28 0.00 0", remedy=True),
    _case("laser knocked, turned by 10°", "laser_knocked@30+600", "the laser turned by 10 degrees", quick=True),
    _case("one scan sent again and again for 3 s", "scans_repeated@25+3", "disagree", remedy=True),
    _case("walls of glass", "glass@0+600"),
    _case("people cross the way all the time", "people@0+600"),
    _case("five people go along, 1 to 2 m away", "crowd@0+600"),
    _case("five people go along a corridor alike everywhere", "crowd@0+600", world="corridor"),
    _case("a dozen boxes moved", "furniture@30"),
    _case("robot carried elsewhere", "carried@20+15", "--interval", remedy=True, quick=True),
    _case(
        "robot carried along a corridor alike everywhere", "carried@20+15", "--interval", world="corridor", remedy=True
    ),
    _case(
        "robot shut in as in a lift, comes out elsewhere",
        "lift@25+12",
        "--interval",
        remedy=True,
        at_end=True,
        quick=True,
    ),
)
