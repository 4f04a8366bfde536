"""The option to watch what a program does in Rerun."""

import argparse

LIVE = "live"


def add_viewer_option(grammar: argparse.ArgumentParser) -> None:
    """Add `--viewer`; its value is None, `LIVE`, or the name of a .rrd file."""
    grammar.add_argument(
        "--viewer",
        nargs="?",
        const=LIVE,
        type=_place,
        metavar="FILE.rrd",
        help="watch scans, map, drive and loops in Rerun, live or into a file to be opened later with `rerun FILE.rrd` "
        "(needs the extra tbmslam[viewer]); give it after the recordings",
    )


def _place(text: str) -> str:
    if text != LIVE and not text.endswith(".rrd"):
        raise argparse.ArgumentTypeError(f"must end with .rrd, or be the last word for live viewing, got {text!r}")
    return text
