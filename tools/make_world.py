"""Simulate robots that drive through a building, and write their bags and the truth.

The output folder receives robot_0.bag, robot_1.bag, ... (or folders robot_0, ... with mcap of ROS 2), the true
trajectories robot_0.truth.tum, ..., truth.json, the building world.npz, and a picture of everything, world.png.
"""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tools.command_line.options import number_within
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program

if TYPE_CHECKING:
    from collections.abc import Sequence

    from datasets.synthetic.robot.faults import Fault
    from datasets.synthetic.robot.laser import SimulatedLaser
    from datasets.synthetic.robot.simulation import SimulatedRobot
    from datasets.synthetic.world.world import World
    from tbmslam.io.pictures import Picture

EXAMPLES = """examples:
  tbmslam world --world office --seed 1 --robots 3 --odometry good -o out/office
      three robots in an office; together they see all of it, and neighbours share 30 percent of their paths
  tbmslam world --world corridor --length 60 --odometry poor --beams 180 --format mcap -o out/corridor
      60 m of a featureless corridor as a ROS 2 bag, with an old laser and poor odometry
"""

WORLDS = ("office", "halls", "store", "corridor", "wings", "apartment", "open_plan", "variety", "hospital")
FAULTS = (
    *("odometry_gap", "odometry_jump", "odometry_reset", "odometry_freeze", "odometry_stuck"),
    *("odometry_reversed", "odometry_unit", "clock_offset", "clock_step", "stamps_back", "stamps_twice"),
    *("laser_gap", "beams_blocked", "parts_in_view", "range_scale", "range_offset", "angle_step", "mount"),
    *("laser_knocked", "scans_repeated", "glass", "people", "crowd", "furniture", "carried", "lift"),
)
"""Repeated from `datasets.synthetic.robot.faults`, so that `--help` loads nothing; a test compares both."""

_NO_RETURN = 65.533  # as in `datasets.synthetic.bag_writing`


def parser(program: str = "make_world") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument(
        "-o", "--out", type=path_argument, required=True, help="folder for all results; created if missing"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    _add_world(grammar.add_argument_group("world and drives"))
    _add_laser(grammar.add_argument_group("laser (by default MIT Stata Center's)"))
    files = grammar.add_argument_group("files")
    files.add_argument("--format", choices=("ros1", "mcap"), default="ros1", help="ROS 1 bag or ROS 2 mcap (ros1)")
    files.add_argument("--compression", choices=("none", "bz2"), default="none", help="of ROS 1 bags (none)")
    files.add_argument("--no-return", type=float, metavar="CODE", help="range without a return, for scans (65.533)")
    return grammar


def _add_world(world: argparse._ArgumentGroup) -> None:
    world.add_argument("--world", choices=WORLDS, default="office", help="kind of building (office)")
    world.add_argument("--seed", type=int, default=0, help="seed of the building, the drives and all noise (0)")
    world.add_argument("--drive-seed", type=number_within(int, 0), help="another seed for the drives and the noise")
    world.add_argument("--robots", type=int, default=1, metavar="N", help="number of robots (1)")
    world.add_argument("--length", type=float, metavar="M", help="length of each drive (enough to see everything)")
    world.add_argument("--duration", type=float, metavar="S", help="longest duration of a drive")
    world.add_argument(
        "--overlap", type=float, default=0.3, metavar="F", help="common share of neighbours' paths (0.3)"
    )
    world.add_argument("--speed", type=float, default=0.65, metavar="M/S", help="largest speed (0.65)")
    world.add_argument(
        "--odometry", choices=("none", "good", "poor"), default="good", help="errors of the odometry (good)"
    )
    world.add_argument(
        "--fault", action="append", default=[], metavar="NAME@S[+S[xF]]",
        help="a fault at a time, with a duration (10) [s]; may be repeated; reversed odometry reports F times the "
        "distance (1): " + ", ".join(FAULTS),
    )  # fmt: skip


def _add_laser(laser: argparse._ArgumentGroup) -> None:
    laser.add_argument("--beams", type=int, default=1040, help="beams of a scan; 180, 181, 361 span 180 deg (1040)")
    laser.add_argument("--rate", type=float, default=20.0, metavar="HZ", help="scans a second (20)")
    laser.add_argument("--range-max", type=float, default=30.0, metavar="M", help="largest range (30)")
    laser.add_argument("--noise", type=float, default=0.01, metavar="M", help="standard deviation of a range (0.01)")
    laser.add_argument("--dropouts", type=float, default=0.003, metavar="F", help="share of lost returns (0.003)")
    laser.add_argument("--wrong-returns", type=float, default=0.001, metavar="F", help="share of short returns (0.001)")
    laser.add_argument(
        "--mount", nargs=3, type=float, default=(0.275, 0.0, 0.0), metavar=("X", "Y", "YAW_DEG"),
        help="pose of the laser on the robot [m, m, deg] (0.275 0 0)",
    )  # fmt: skip
    laser.add_argument("--sweep", type=float, default=0.0, metavar="S", help="duration of a scan [s] (0)")
    laser.add_argument("--rings", type=int, default=0, metavar="N", help="a lidar of N rings that sends clouds (0)")
    laser.add_argument("--upside-down", action="store_true", help="mount the laser upside down")


def main(argv: list[str] | None = None, program: str = "make_world") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    if args.format == "mcap" and args.compression != "none":
        grammar.error("--compression is for ROS 1 bags; drop it or --format mcap")
    if args.rings and args.no_return is not None:
        grammar.error("--no-return is for scans; drop it or --rings")
    args.no_return = _NO_RETURN if args.no_return is None else args.no_return
    if 0.0 < args.no_return <= args.range_max:
        grammar.error(f"--no-return must differ from every range that the laser may measure, got {args.no_return:g}")
    return run_program(program, lambda: _run(grammar, args), debug=args.debug)


def _run(grammar: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    from tools.command_line.output_folder import output_folder

    try:
        with output_folder(args.out):
            make(args)
    except ValueError as error:
        if args.debug:
            raise
        grammar.error(str(error))


def make(args: argparse.Namespace) -> None:
    """Simulate and write the requested recordings."""
    from datasets.synthetic.buildings import make_world
    from datasets.synthetic.robot.drives import plan_drives
    from datasets.synthetic.robot.faults import Fault, inject
    from datasets.synthetic.robot.simulation import OdometryNoise, simulate, write_truth
    from tbmslam.io.atomic_file import write_bytes
    from tbmslam.io.pictures import encode_png
    from tools.command_line.progress import ProgressBars

    faults = [Fault.parse(text) for text in args.fault]
    seed = args.seed if args.drive_seed is None else args.drive_seed
    world = make_world(args.world, args.seed)
    drives = plan_drives(
        world,
        args.robots,
        length=args.length,
        duration=args.duration,
        overlap=args.overlap,
        speed=args.speed,
        seed=seed,
    )
    noise = OdometryNoise.preset(args.odometry)
    progress = ProgressBars()
    robots = simulate(world, drives, laser_of(args), noise, seed, progress)
    for fault in faults:
        _check_moment(fault, robots)
        robots = [inject(robot, fault, world, seed) for robot in robots]
    bags = [robot.name if args.format == "mcap" else f"{robot.name}.bag" for robot in robots]
    for robot, bag in progress.each(zip(robots, bags, strict=True), "writing", len(bags), "bags"):
        _write_bag(robot, args.out / bag, args, seed)
    run = {"seed": seed, "overlap": args.overlap, "odometry": {"preset": args.odometry, **vars(noise)}}
    run["faults"] = [vars(fault) for fault in faults]
    write_truth(args.out, world, robots, bags, run)
    write_bytes(args.out / "world.png", encode_png(draw_world(world, robots)))
    print(f"{args.out / 'truth.json'}, world.npz, world.png: the truth, for evaluation only")


def _check_moment(fault: "Fault", robots: "Sequence[SimulatedRobot]") -> None:
    for robot in robots:
        lasts = float(robot.recorded[-1] - robot.recorded[0])
        if fault.at > lasts:
            raise ValueError(
                f"--fault {fault.name} must begin within the {lasts:.1f} s of {robot.name}, got {fault.at:g}"
            )


def _write_bag(robot: "SimulatedRobot", path: Path, args: argparse.Namespace, seed: int) -> None:
    from datasets.synthetic.bag_writing import write_mcap_bag, write_ros1_bag
    from datasets.synthetic.robot.laser import RingLidar

    lidar = RingLidar(args.rings) if args.rings else None
    if args.format == "mcap":
        write_mcap_bag(robot, path, no_return=args.no_return, lidar=lidar, seed=seed)
    else:
        write_ros1_bag(robot, path, compression=args.compression, no_return=args.no_return, lidar=lidar, seed=seed)
    print(f"{path}: {len(robot.readings)} scans, {robot.truth.length():.1f} m")


def laser_of(args: argparse.Namespace) -> "SimulatedLaser":
    """Return the laser that the arguments describe."""
    from datasets.synthetic.robot.laser import SimulatedLaser
    from tbmslam.geometry.se2 import SE2

    angle_min, angle_increment = SimulatedLaser.field_of(args.beams)
    if args.rings:  # a rotating lidar
        angle_min, angle_increment = -math.pi, 2.0 * math.pi / max(args.beams, 1)
    return SimulatedLaser(
        beams=args.beams,
        angle_min=angle_min,
        angle_increment=angle_increment,
        rate=args.rate,
        range_max=args.range_max,
        noise=args.noise,
        dropouts=args.dropouts,
        wrong_returns=args.wrong_returns,
        T_robot_sensor=SE2(args.mount[0], args.mount[1], math.radians(args.mount[2])),
        upside_down=args.upside_down,
        sweep=args.sweep,
    )


_PIXELS_PER_METRE = 25
_SIXTEENTHS = _PIXELS_PER_METRE * 16  # cv2 draws to 1/16 of a pixel
_PATH_COLOURS = ((200, 90, 0), (0, 150, 60), (40, 40, 220), (190, 0, 190), (0, 150, 200), (120, 120, 0))


def draw_world(world: "World", robots: "Sequence[SimulatedRobot]") -> "Picture":
    """Draw the walls, each robot's path in a colour and its start as a circle."""
    import cv2
    import numpy as np

    min_x, min_y, max_x, max_y = world.bounds()
    origin = np.array([min_x - 0.5, max_y + 0.5])
    size = (math.ceil((max_y - min_y + 1.0) * _PIXELS_PER_METRE), math.ceil((max_x - min_x + 1.0) * _PIXELS_PER_METRE))
    picture = np.full((*size, 3), 255, dtype=np.uint8)
    walls = np.round((world.walls.reshape(-1, 2, 2) - origin) * [_SIXTEENTHS, -_SIXTEENTHS]).astype(np.int32)
    cv2.polylines(picture, list(walls), isClosed=False, color=(0, 0, 0), thickness=1, lineType=cv2.LINE_AA, shift=4)
    for index, robot in enumerate(robots):
        colour = _PATH_COLOURS[index % len(_PATH_COLOURS)]
        path = np.round((robot.truth.poses[:, :2] - origin) * [_SIXTEENTHS, -_SIXTEENTHS]).astype(np.int32)
        cv2.polylines(picture, [path], isClosed=False, color=colour, thickness=2, lineType=cv2.LINE_AA, shift=4)
        start = (int(path[0, 0]), int(path[0, 1]))
        cv2.circle(picture, start, 8 * 16, colour, thickness=2, lineType=cv2.LINE_AA, shift=4)
    return picture


if __name__ == "__main__":
    sys.exit(main())
