"""Command line options about parameters, shared by the programs that have any."""

import argparse

from tools.command_line.paths import path_argument


def add_configuration_options(parser: argparse.ArgumentParser, example: str, *, printing: bool = True) -> None:
    """Add the options about parameters, in a group of their own.

    Parameters
    ----------
    parser
        Parser of the program.
    example
        A setting that makes sense there.
    printing
        Whether the program may print them instead of doing its work.
    """
    group = parser.add_argument_group("parameters")
    group.add_argument(
        "--preset",
        help="of the SLAM, for mapping: default, viny, viny-hc, tiny, credibilist, particles or odometry; or paper: "
        "viny, and merging exactly as in the paper",
    )
    group.add_argument(
        "--config",
        type=path_argument,
        metavar="TOML",
        help="parameters that differ; also a folder with the config.toml of an earlier result",
    )
    group.add_argument(
        "--set", action="append", default=[], metavar="A.B=C", help=f"one parameter, e.g. {example}; may be repeated"
    )
    if printing:
        group.add_argument(
            "--print-config",
            action="store_true",
            help="print the parameters with meaning, unit and value as TOML, and do nothing else",
        )
