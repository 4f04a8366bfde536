"""Merge maps with unknown relative poses into one map."""

import argparse
import logging
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if not __package__:  # run as a file of a clone, whose packages may not be installed under these names
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.command_line.extra_files import add_extra_files, check_extra_files, write_extra_files
from tools.command_line.options import add_configuration_options, number_within
from tools.command_line.paths import check_exist, holds_map, list_maps, path_argument, unique_names
from tools.command_line.program import DONE, ProgramParser, loading, run_program, typed_command

if TYPE_CHECKING:
    from merging.config import MergeConfig
    from merging.merger import Merge
    from tbmslam.map.tbm_map import TbmMap
    from tbmslam.report.page import RunInfo
    from tools.command_line.configuration import Configuration

logger = logging.getLogger("merge")

NOTHING_MERGED = 3

# Repeated here so that `--help` need not load the library; a test compares both.
METHODS = ("correlation", "features", "birk-carpin", "carpin", "li", "saeedi", "trehard", "dobrokhvalov-filatov")
RULES = (
    *("disjunctive", "conjunctive", "dempster", "dubois-prade", "yager"),
    *("average", "unanimous", "log-odds", "entropy-filter"),
)
COVERAGES = ("union", "overlap")
FARTHEST_POSE = 10_000.0
DESCRIPTORS = ("concatenated", "and", "or", "xor", "pignistic")

EXAMPLES = """examples:
  tbmslam merge out/robot_0 out/robot_1 -o merged
      merge the maps of two robots into merged/map.npz, map.yaml, pictures and a report
  tbmslam merge out/week -o merged --workers 8
      all maps in a folder that `tbmslam map` wrote, eight pairs at a time
  tbmslam merge hall.yaml lab.yaml merged/map.npz -o merged2 --rule conjunctive --coverage overlap
      maps of any program; keep only cells that all robots saw, and fuse them conjunctively
  tbmslam merge plan.yaml out/robot_0 out/robot_1 -o merged --pose robot_0 12.5 -3 90
      the pose of robot_0 in the plan's frame is about 12.5 m, -3 m and 90 degrees

exit codes: 0 merged, 1 error, described in one line, 2 wrong usage, 3 no two maps could be merged (see the
report), 130 interrupted, 143 terminated
"""


def main(arguments: Sequence[str] | None = None, program: str = "merge") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    options = grammar.parse_args(arguments)
    try:
        given, options.maps = options.maps, list_maps(options.maps)
        if not options.print_config:
            _check(grammar, options, given)
    except (OSError, RuntimeError) as error:  # unreadable folders, circular links
        grammar.error(f"the maps cannot be listed: {error}")
    if options.verbose:
        logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    else:  # warnings about maps are printed without the name of a module
        logging.basicConfig(level=logging.WARNING, format="%(message)s")
    return run_program(
        program,
        lambda: _run(grammar, options, arguments, program),
        debug=options.debug,
        interrupted="run the same again",
        out_of_memory="merge fewer maps, or with a coarser --resolution",
    )


def _run(
    grammar: argparse.ArgumentParser, options: argparse.Namespace, arguments: Sequence[str] | None, program: str
) -> int:
    check_exist(options.maps, "does not exist: give a map's folder or file")
    check_exist([options.config])
    with loading():
        from tools.command_line.configuration import whole_text

    config = _configuration(grammar, options)
    if options.print_config:
        print(whole_text(config), end="")
        return DONE
    return _merge(options, config.merging, typed_command(program, arguments))


def _check(grammar: argparse.ArgumentParser, options: argparse.Namespace, given: Sequence[Path]) -> None:
    if options.out is None:
        grammar.error(
            "the following arguments are required: -o/--out: give a folder for the merged map, such as -o merged"
        )
    if len(options.maps) < 2:
        grammar.error(_too_few(given, options.maps))
    if options.scheduler and options.workers > 1:
        grammar.error("a --scheduler has its own workers: drop --workers")
    if any(_lies_in(path, options.out) for path in (*options.maps, *given)):
        grammar.error(f"{options.out} holds one of the maps: choose another folder with -o")


def _too_few(given: Sequence[Path], maps: Sequence[Path]) -> str:
    """Return the reason why there are not two maps, and the remedy."""
    remedy = "give their folders, such as out/robot_0 out/robot_1"
    in_yaml = _yaml_maps(given)
    if len(given) != 1:
        return f"two maps or more are needed, got {len(maps)}: {remedy}"
    if not given[0].exists():
        return f"{given[0]}: does not exist: {remedy}, or a folder of maps that `tbmslam map` wrote"
    if given[0].is_dir() and not holds_map(maps[0]):
        return f"{given[0]}: holds no map: name a folder that `tbmslam map` wrote with -o{in_yaml}"
    return f"two maps or more are needed, {given[0]} is or holds only one: {remedy}{in_yaml}"


def _yaml_maps(given: Sequence[Path]) -> str:
    """Return the remedy for maps of other programs, which a folder holds under names of their own."""
    files = sorted(given[0].glob("*.y*ml")) if given and given[0].is_dir() else []
    others = [file for file in files if file.name not in ("map.yaml", "keepout.yaml")]  # those of our own folders
    return f", or give the .yaml files, such as {' '.join(map(str, files[:2]))}" if others else ""


def _lies_in(path: Path, folder: Path) -> bool:
    """Return whether saving into a folder would overwrite a map."""
    if path.is_dir():
        return path.resolve() == folder.resolve()
    file = Path(os.path.realpath(path))  # a circular link is not an error here
    return file.parent == folder.resolve() and file.stem == "map"


def parser(program: str = "merge") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument(
        "maps",
        nargs="*",
        type=path_argument,
        metavar="MAP",
        help="a map folder, a folder of map folders (from `tbmslam map`), or a file: .npz, .yaml, .yml, "
        ".tbm_map, .tbm_map.xz, .dat or .dat.gz",
    )
    grammar.add_argument("-o", "--out", type=path_argument, metavar="FOLDER", help="folder of the merged map")
    _add_finding(grammar.add_argument_group("method that aligns two maps"))
    features = grammar.add_argument_group("method features (the paper's)")
    features.add_argument("--keypoints", type=int, metavar="N", help="keypoints in each map, default: 1000")
    features.add_argument("--ratio", type=float, metavar="R", help="Lowe's ratio, default: 0.7")
    features.add_argument("--descriptor", choices=DESCRIPTORS, help="default: concatenated")
    features.add_argument(
        "--min-inliers", type=int, metavar="N", help="fewest inliers of an accepted alignment, default: 5"
    )
    _add_fusing(grammar.add_argument_group("fusion of cells"))
    add_configuration_options(grammar, "merging.verification.min_confidence=0.9")
    add_extra_files(grammar)
    grammar.add_argument("-v", "--verbose", action="store_true", help="log every step")
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _add_finding(finding: argparse._ArgumentGroup) -> None:
    finding.add_argument(
        "--method",
        choices=METHODS,
        help="correlation (default) tries every rotation and shift; features matches keypoints, as the paper does; the "
        "others are methods of related work for comparison, each with its own acceptance rule",
    )
    finding.add_argument(
        "--pose", nargs=4, action="append", default=[], metavar=("NAME", "X", "Y", "DEG"),
        help="pose of a map, by its name in the report, in the first map's frame, known to a metre and ten degrees; "
        "the map is placed there and refined locally; may be repeated",
    )  # fmt: skip
    finding.add_argument(
        "--compare-at", type=float, metavar="M",
        help="cell size for comparing, default: the larger one of each pair",
    )  # fmt: skip
    finding.add_argument(
        "--workers", type=number_within(int, 1), default=1, metavar="N", help="processes that align pairs, default: 1"
    )
    finding.add_argument(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler that aligns the pairs, e.g. tcp://10.0.0.1:8786"
    )
    finding.add_argument(
        "--rigid", action="store_true", help="deform no map of the result, and optimise no drives of it jointly"
    )


def _add_fusing(fusing: argparse._ArgumentGroup) -> None:
    fusing.add_argument(
        "--rule",
        choices=RULES,
        help="fusion rule; default: render all scans again where drives were optimised together, else disjunctive",
    )
    fusing.add_argument(
        "--coverage", choices=COVERAGES, help="keep the cells that any robot saw (union, default) or all saw (overlap)"
    )
    fusing.add_argument(
        "--reliability", type=_reliability, action="append", default=[], metavar="NAME=R",
        help="reliability of a map, by its name in the report, between 0 and 1; may be repeated",
    )  # fmt: skip
    fusing.add_argument(
        "--resolution", type=float, metavar="M",
        help="cell size of the merged map, default: that of the first merged map",
    )  # fmt: skip


def _reliability(text: str) -> tuple[str, float]:
    name, _, number = text.rpartition("=")
    try:
        return name, float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must look like NAME=0.5, got {text!r}") from None


def _configuration(parser: argparse.ArgumentParser, options: argparse.Namespace) -> "Configuration":
    """Return the configuration by file, settings and options, in increasing priority."""
    from tbmslam.configuration.parameters import ConfigError, changed
    from tools.command_line.configuration import read_configuration

    config = read_configuration(options.preset, options.config).with_settings(options.set)
    chosen = {
        "method": options.method,
        "rule": options.rule,
        "coverage": options.coverage,
        "reliability": dict(options.reliability) or None,
        "known_poses": _known_poses(parser, options.pose) or None,
        "joint": {"enabled": False} if options.rigid else None,
        "nonrigid": {"enabled": False} if options.rigid else None,
        "resolution": options.compare_at,
        "merged_resolution": options.resolution,
        "features": _given(keypoints=options.keypoints, ratio=options.ratio, descriptor=options.descriptor),
        "consensus": _given(min_inliers=options.min_inliers),
    }
    try:
        return changed(config, {"merging": _given(**chosen)}, "options")
    except ConfigError as error:
        parser.error(str(error))


def _known_poses(parser: argparse.ArgumentParser, poses: Sequence[Sequence[str]]) -> dict[str, list[float]]:
    """Return poses by the names of maps [m, m, rad]."""
    known: dict[str, list[float]] = {}
    for name, *numbers in poses:
        given = f"got {' '.join((name, *numbers))}"
        try:
            x, y, degrees = (float(number) for number in numbers)
        except ValueError:
            parser.error(f"--pose must look like NAME X Y DEG, as robot_1 12.5 -3 90, {given}")
        if not (max(abs(x), abs(y)) <= FARTHEST_POSE and math.isfinite(degrees)):
            parser.error(f"--pose must be within {FARTHEST_POSE:.0f} m of the first map, at any angle, {given}")
        if name in known:
            parser.error(f"--pose gives two poses of {name}, {given}: give one")
        known[name] = [x, y, math.radians(math.remainder(degrees, 360.0))]
    return known


def _given(**values: object) -> dict[str, object]:
    return {name: value for name, value in values.items() if value is not None}


def _merge(options: argparse.Namespace, config: "MergeConfig", command: str) -> int:
    with loading():
        from merging.merger import merge
        from merging.report.provenance import duplicate_drives
        from tbmslam.configuration.parameters import ConfigError
        from tbmslam.io.map_folder import load_map
        from tbmslam.report.page import RunInfo
        from tools.command_line.other_results import refuse_other_results
        from tools.command_line.output_folder import output_folder
        from tools.command_line.progress import ProgressBars

    check_extra_files(options)
    progress = ProgressBars()
    named = dict(zip(unique_names(options.maps), options.maps, strict=True))
    if strangers := [name for name in config.reliability if name not in named]:
        raise ConfigError(f"--reliability: {strangers[0]!r} is not one of the maps, which are {', '.join(named)}")
    _check_known_poses(config, list(named))
    _check_files(options.maps, options.out)
    refuse_other_results(options.out, of_merge=True)
    with output_folder(options.out):
        maps = {name: load_map(path) for name, path in progress.each(named.items(), "loading", len(named), "maps")}
        for first, second, shared, of in duplicate_drives(maps):
            counts = "one drive would count as two robots that agree: omit one of them"
            logger.warning("%s and %s hold the same scans, %d of %d keyframes: %s", first, second, shared, of, counts)
        result = merge(maps, config, options.workers, progress, options.scheduler)
        _save(options, result, maps, config, RunInfo(command, progress.seconds))
    _tell(result, config, next(iter(maps)), options.out)
    return DONE if result.merged is not None else NOTHING_MERGED


def _check_known_poses(config: "MergeConfig", names: Sequence[str]) -> None:
    from tbmslam.configuration.parameters import ConfigError

    for name in config.known_poses:
        if name == names[0]:
            others = ", ".join(names[1:])
            raise ConfigError(f"--pose: poses are in the frame of {name}, the first map: give those of {others}")
        if name not in names:
            raise ConfigError(f"--pose: {name!r} is not one of the maps, which are {', '.join(names)}")


def _check_files(paths: Sequence[Path], out: Path) -> None:
    """Refuse to overwrite the picture of a yaml map, and warn of maps that are given twice."""
    from tbmslam.io.map_folder import FIXED_NAMES, files_of_map
    from tools.command_line.output_folder import OutputError

    ours, seen = {*FIXED_NAMES, "overlay.png", "contradictions.png"}, set()
    for path in paths:
        file, *pictures = (Path(os.path.realpath(each)) for each in files_of_map(path))
        if file in seen:
            logger.warning("%s: is given twice and counts as two robots", path)
        seen.add(file)
        for picture in pictures:
            if picture.name in ours and picture.parent == out.resolve():
                raise OutputError(
                    f"{picture}: belongs to {path} and would be overwritten: choose another folder with -o"
                )


def _save(
    options: argparse.Namespace, result: "Merge", maps: Mapping[str, "TbmMap"], config: "MergeConfig", info: "RunInfo"
) -> None:
    from merging.report.json_report import write_report
    from tbmslam.io.atomic_file import write_text
    from tbmslam.io.map_folder import remove_map, save_map
    from tools.command_line.checksums import NAME as CHECKSUMS
    from tools.command_line.checksums import write_checksums
    from tools.command_line.configuration import merging_text

    (options.out / CHECKSUMS).unlink(missing_ok=True)
    if result.merged is not None:
        save_map(options.out, result.merged)
    else:
        remove_map(options.out)  # of an older merge, which contradicts the new report
    write_text(options.out / "config.toml", merging_text(config))
    write_extra_files(options.out, result.merged, options)
    write_report(options.out, result, maps, config, info)
    write_checksums(options.out)


def _tell(result: "Merge", config: "MergeConfig", first: str, out: Path) -> None:
    for (target, source), found in result.alignments.items():
        print(f"{source} in {target}: {'accepted' if found.accepted else 'refused'}: {found.reason}")
    for name, reason in result.left_out.items():
        print(f"left out: {name}: {reason}")
    placed = {first, *config.known_poses} if config.known_poses else set()
    if result.left_out.keys() - placed:
        print("if the pose of a map is known, pass --pose NAME X Y DEG, in the first map's frame")
    if result.merged is None:
        print(f"nothing merged; the reasons are in {out / 'report.html'}")
        return
    print(f"report -> {out / 'report.html'}")
    print(f"merged {', '.join(result.poses)} into {out}")


if __name__ == "__main__":
    sys.exit(main())
