"""Compute and draw the errors of a trajectory or a map.

A trajectory in TUM format is compared with a true trajectory (ATE, RPE after a rigid alignment) or with the true
relations of the public SLAM benchmark. A map is compared with another map or a simulated world, cell by cell.
"""

import argparse
import json
import sys
from collections.abc import Mapping

from tools.command_line.options import number_within
from tools.command_line.paths import check_exist, path_argument
from tools.command_line.program import ProgramParser, loading, run_program

EXAMPLES = """examples:
  tbmslam evaluate trajectory out/robot_0/trajectory.tum --truth world/robot_0.truth.tum --picture where.png
      ATE and RPE over steps of 1 m, and the drive coloured by its error
  tbmslam evaluate trajectory out/intel/robot_0/trajectory.tum --relations intel.relations --json
      the errors of Kuemmerle et al. (2009) as JSON
  tbmslam evaluate map out/office/robot_0 --truth world/world.npz \\
      --trajectories out/office/robot_0/trajectory.tum world/robot_0.truth.tum --refine
      the share of right cells, with the map placed in the world by its trajectory
  tbmslam evaluate map out/office/merged --truth floor-plan.yaml --transform 12 30 0 --align 5
      the same on a floor plan, with a pose that is known to five metres

figures of a map: known_map, known_truth and known_both count the cells that are known in the map, in the truth and in
both. All other figures consider only the cells known in both. agree is the share of cells that are equal. agree_nearby
also accepts a neighbouring cell. agree_occupied is the share of the map's occupied cells that are occupied in the
truth. agree_free is the share of the map's free cells that are free in the truth. found_occupied is the share of the
truly occupied cells that are occupied in the map. found_free is the share of the truly free cells that are free in the
map. wall_distance_m is the mean distance from the map's walls to the nearest true wall.
"""


def parser(program: str = "evaluate") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    commands = grammar.add_subparsers(dest="command", required=True, metavar="trajectory|map")
    _add_trajectory(commands.add_parser("trajectory", help="ATE and RPE, or errors of relations", epilog=EXAMPLES))
    _add_map(commands.add_parser("map", help="share of cells that agree with the truth", epilog=EXAMPLES))
    return grammar


def _add_trajectory(command: argparse.ArgumentParser) -> None:
    command.add_argument("estimate", type=path_argument, metavar="EST.tum", help="the estimated trajectory")
    truth = command.add_mutually_exclusive_group(required=True)
    truth.add_argument(
        "--truth", type=path_argument, metavar="GT.tum", help="the true trajectory: TUM, or *.gt.laser.poses"
    )
    truth.add_argument(
        "--relations", type=path_argument, metavar="FILE", help="true relations: t1 t2 x y z roll pitch yaw"
    )
    of_what = command.add_argument_group("frame of the true trajectory")
    of_what.add_argument(
        "--frame", choices=("robot", "laser"), help="robot or laser (robot for TUM, laser for *.gt.laser.poses)"
    )
    of_what.add_argument(
        "--sensor-pose", type=float, nargs=3, metavar=("X", "Y", "DEG"),
        help="pose of the laser on the robot [m, m, deg] (as in the map beside EST.tum)",
    )  # fmt: skip
    step = command.add_argument_group("relative errors (with --truth)").add_mutually_exclusive_group()
    step.add_argument("--step-m", type=number_within(float, 1e-6), metavar="M", help="length of a step (1)")
    step.add_argument("--step-s", type=number_within(float, 1e-6), metavar="S", help="duration of a step instead")
    command.add_argument(
        "--max-stamp-difference", type=number_within(float, 0.0), metavar="S",
        help="largest difference of the stamps of matching poses (0.01; 0.001 for relations)",
    )  # fmt: skip
    _add_output(command)
    command.add_argument(
        "--map", type=path_argument, metavar="MAP", help="background: a map in the estimate's frame, or a world.npz"
    )


def _add_map(command: argparse.ArgumentParser) -> None:
    command.add_argument("map", type=path_argument, metavar="MAP", help="the map: a folder, map.npz or ROS yaml")
    command.add_argument("--truth", type=path_argument, required=True, metavar="MAP2|world.npz", help="the true map")
    place = command.add_argument_group("pose of the map in the truth (identity)")
    either = place.add_mutually_exclusive_group()
    either.add_argument("--transform", type=float, nargs=3, metavar=("X", "Y", "DEG"), help="T_truth_map [m, m, deg]")
    either.add_argument(
        "--trajectories", type=path_argument, nargs=2, metavar=("EST.tum", "GT.tum"),
        help="one drive in the frames of the map and of the truth",
    )  # fmt: skip
    place.add_argument(
        "--align", type=number_within(float, 1e-6, 1e9), metavar="M",
        help="search within M metres and 20 degrees of this pose by walls, as merge does, for example on a floor plan",
    )  # fmt: skip
    place.add_argument("--refine", action="store_true", help="refine this pose by the distances between walls")
    command.add_argument(
        "--min-evidence", type=number_within(float, 0.0, 0.999), default=0.0, metavar="F",
        help="cells of a map with less mass on free and occupied count as unknown (0: any evidence counts)",
    )  # fmt: skip
    _add_output(command)


def _add_output(command: argparse.ArgumentParser) -> None:
    output = command.add_argument_group("output")
    output.add_argument("--json", action="store_true", help="print JSON instead of text")
    output.add_argument("--picture", type=path_argument, metavar="PNG", help="draw the errors")
    output.add_argument("--debug", action="store_true", help="show a traceback when something fails")


def main(argv: list[str] | None = None, program: str = "evaluate") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    _check(grammar, args)
    return run_program(
        program, lambda: _run(args), debug=args.debug, out_of_memory="crop the maps or use coarser cells"
    )


def _run(args: argparse.Namespace) -> None:
    given = (
        (args.estimate, args.truth, args.relations, args.map)
        if args.command == "trajectory"
        else (args.map, args.truth, *(args.trajectories or ()))
    )
    check_exist(given)
    with loading():
        from tools.scores import evaluate_map, evaluate_trajectory

    scores = evaluate_trajectory if args.command == "trajectory" else evaluate_map
    _print_report(scores(args), as_json=args.json)


def _print_report(report: Mapping[str, object], *, as_json: bool) -> None:
    """Print figures as JSON or as text."""
    if as_json:
        print(json.dumps(report, indent=2))
        return
    for line in _lines(report, ""):
        print(line)


def _lines(values: Mapping[str, object], indent: str) -> list[str]:
    lines = []
    for name, value in values.items():
        if isinstance(value, Mapping) and all(isinstance(inner, float) for inner in value.values()):
            lines.append(f"{indent}{name}: " + ", ".join(f"{key} {number:.4f}" for key, number in value.items()))
        elif isinstance(value, Mapping):
            lines += [f"{indent}{name}:", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{name}: {value:.4f}" if isinstance(value, float) else f"{indent}{name}: {value}")
    return lines


def _check(grammar: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    if args.command == "map":
        if args.transform:
            _check_transform(grammar, args.transform)
        return
    if args.relations and (args.step_m or args.step_s):
        grammar.error("relations have steps of their own: drop --step-m and --step-s")
    if args.map and not args.picture:
        grammar.error("--map is the background of a picture: add --picture")


def _check_transform(grammar: argparse.ArgumentParser, numbers: list[float]) -> None:
    with loading():
        from tbmslam.sensing.laser_scan import FARTHEST_PLACE

    if not all(abs(number) <= FARTHEST_PLACE for number in numbers):
        grammar.error(f"--transform must be finite and within {FARTHEST_PLACE:.0e} m")


if __name__ == "__main__":
    sys.exit(main())
