"""Options that several programs have: about recordings, parameters, the viewer and plots."""

import argparse
import dataclasses
import importlib.util
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from tbmslam.errors import TbmSlamError
from tools.command_line.paths import path_argument

if TYPE_CHECKING:
    from datasets.options import RecordingOptions

_T = TypeVar("_T")
_N = TypeVar("_N", int, float)


def number_within(kind: Callable[[str], _N], least: float, most: float = math.inf) -> Callable[[str], _N]:
    """Return a `type` of arguments that are whole numbers (`int`) or numbers (`float`) within limits."""

    def parse(text: str) -> _N:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:
            limits = f"of at least {least:g}" if most == math.inf else f"within {least:g} and {most:g}"
            name = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"must be a {name} {limits}, got {text[:40]!r}")
        return value

    return parse


def comma_separated(parse: Callable[[str], _T]) -> Callable[[str], list[_T]]:
    """Return a `type` of arguments that are values with commas between, as in 2,3,5."""
    return lambda text: [parse(word) for word in text.split(",")]


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add the options about recordings, in groups of their own."""
    scans = parser.add_argument_group("scans")
    scans.add_argument("--profile", choices=("auto", "stata"), help="known kind of recording (auto)")
    scans.add_argument(
        "--scan-topic", action="append", metavar="[RECORDING=]TOPIC",
        help="topic of the scans, or the kind of line of a log (FLASER); monday=/scan sets it for one recording",
    )  # fmt: skip
    scans.add_argument("--laser-frame", metavar="FRAME", help="frame of the laser (the laser with most usable scans)")
    scans.add_argument(
        "--cloud-heights", type=float, nargs=2, metavar=("LOW", "HIGH"),
        help="heights above the robot's frame between which point clouds become scans [m] (around the sensor)",
    )  # fmt: skip
    scans.add_argument("--angle-step-deg", type=float, metavar="DEG", help="angle between beams (as stated)")
    scans.add_argument("--range-min", type=float, metavar="M", help="least valid range (as stated)")
    scans.add_argument("--range-max", type=float, metavar="M", help="least range that means no return (as stated)")
    scans.add_argument("--range-offset", type=float, metavar="M", help="offset added to every measured range (0)")
    scans.add_argument(
        "--no-return", choices=("free", "drop"),
        help="whether beams without return clear space (as in the preset; in the default preset they do not)",
    )  # fmt: skip
    scans.add_argument(
        "--no-return-code", dest="no_return_codes", type=float, action="append", metavar="M",
        help="range that means no return; may be repeated",
    )  # fmt: skip
    scans.add_argument("--gap", dest="gap_s", type=float, metavar="S", help="longer pauses are counted as gaps (2)")
    _add_odometry_options(parser)


def _add_odometry_options(parser: argparse.ArgumentParser) -> None:
    """Add the options about odometry, frames and clocks."""
    odometry = parser.add_argument_group("odometry and frames")
    odometry.add_argument("--odometry", choices=("auto", "tf", "topic", "none"), help="source of the odometry (auto)")
    odometry.add_argument("--odometry-topic", metavar="TOPIC", help="topic of Odometry messages")
    odometry.add_argument(
        "--odometry-scale", type=float, metavar="F", help="factor of the odometry's lengths; 0.001: millimetres (1)"
    )
    odometry.add_argument(
        "--tf-topic", dest="tf_topics", action="append", metavar="TOPIC", help="topic of transforms; may be repeated"
    )
    odometry.add_argument("--odom-frame", metavar="FRAME", help="frame of the odometry")
    odometry.add_argument("--robot-frame", metavar="FRAME", help="frame of the robot")
    odometry.add_argument(
        "--sensor-pose", type=float, nargs=3, metavar=("X", "Y", "DEG"),
        help="pose of the laser on the robot [m, m, degrees] instead of the recorded pose; its height and tilt stay",
    )  # fmt: skip
    odometry.add_argument(
        "--upside-down", action=argparse.BooleanOptionalAction, default=None,
        help="the laser is mounted upside down, or is not, regardless of tf",
    )  # fmt: skip
    odometry.add_argument(
        "--clock-offset", type=float, metavar="S", help="offset from stamps of scans to those of odometry (detected)"
    )
    odometry.add_argument(
        "--max-odometry-gap", dest="max_odometry_gap_s", type=float, metavar="S",
        help="longest gap over which odometry is interpolated (5)",
    )  # fmt: skip


def options_from(args: argparse.Namespace) -> "RecordingOptions":
    """Return the options of `add_recording_options` from parsed arguments, with the library's defaults for others."""
    # Loaded here because --help must be quick.
    from datasets.options import RecordingOptions

    return RecordingOptions(**given_options(args))


def scan_topics(args: argparse.Namespace) -> dict[str, str]:
    """Return the topics of scans by the given name of the recording; "" stands for all recordings."""
    parted = (text.rpartition("=") for text in args.scan_topic or ())
    return {name: topic for name, _, topic in parted}


def given_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the given options about recordings by their names in `RecordingOptions`."""
    from datasets.options import RecordingOptions
    from tbmslam.geometry.se2 import SE2

    given = {field.name: getattr(args, field.name) for field in dataclasses.fields(RecordingOptions)}
    given["scan_topic"] = scan_topics(args).get("")
    if args.sensor_pose:
        x, y, degrees = args.sensor_pose
        given["sensor_pose"] = SE2(x, y, math.radians(degrees))
    lists_as_tuples = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    return {name: value for name, value in lists_as_tuples.items() if value is not None}


def add_configuration_options(parser: argparse.ArgumentParser, example: str, *, printing: bool = True) -> None:
    """Add the options about parameters, in a group of their own."""
    group = parser.add_argument_group("parameters")
    group.add_argument(
        "--preset", help="preset of the SLAM: default, viny, viny-hc, tiny, credibilist or odometry; or "
        "paper: viny for mapping, and merging exactly as in the paper",
    )  # fmt: skip
    group.add_argument(
        "--config", type=path_argument, metavar="TOML", help="changed parameters: a file, or the folder of a result"
    )
    group.add_argument(
        "--set", action="append", default=[], metavar="A.B=C", help=f"one parameter, e.g. {example}; may be repeated"
    )
    if printing:
        group.add_argument("--print-config", action="store_true", help="only print the parameters as TOML")


LIVE = "live"


def add_viewer_option(grammar: argparse.ArgumentParser) -> None:
    """Add `--viewer`; its value is None, `LIVE`, or the name of a .rrd file."""
    grammar.add_argument(
        "--viewer", nargs="?", const=LIVE, type=_place, metavar="FILE.rrd",
        help="show scans, map, drive and loops in Rerun, live or in a file for `rerun FILE.rrd` (needs the extra "
        "tbmslam[viewer]); give it after the recordings",
    )  # fmt: skip


def _place(text: str) -> str:
    if text != LIVE and not text.endswith(".rrd"):
        raise argparse.ArgumentTypeError(f"must end with .rrd, or be the last word for live viewing, got {text!r}")
    return text


def add_plot_option(grammar: argparse.ArgumentParser, what: str) -> None:
    """Add `--plot`; its value is None or the path of a picture."""
    grammar.add_argument(
        "--plot", type=path_argument, metavar="FILE", help=f"write a picture of {what} here (needs the extra "
        "tbmslam[paper])",
    )  # fmt: skip


def check_plot(plot: Path | None) -> None:
    """Refuse `--plot` without matplotlib, before the work that it would draw."""
    if plot is not None and importlib.util.find_spec("matplotlib") is None:
        raise TbmSlamError("--plot needs matplotlib: pip install 'tbmslam[paper]'")
