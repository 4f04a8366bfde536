"""A recording and how to read it in one word of a command line: ``intel.bag,angle_step_deg=1.0,scan_topic=/scan``."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tools.command_line.recording_options import add_recording_options, options_from

if TYPE_CHECKING:
    from datasets.options import RecordingOptions


@dataclass(frozen=True)
class RecordingSpec:
    """One recording to open.

    Parameters
    ----------
    path
        The bag or log.
    options
        How to read it.
    """

    path: Path
    options: "RecordingOptions"


class _RaisingParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def parse_recording_spec(text: str) -> RecordingSpec:
    """Read ``PATH[,option=value]...``; options are those of build_maps about recordings, `-` written `_` or not.

    Raises
    ------
    ValueError
        When an option is unknown or its value cannot be meant.
    """
    path, *settings = text.split(",")
    parser = _RaisingParser(prog=path, add_help=False, allow_abbrev=False)
    add_recording_options(parser)
    try:
        return RecordingSpec(Path(path), options_from(parser.parse_args(as_words(settings))))
    except ValueError as error:
        raise ValueError(f"{text}: {error}") from None


def as_words(settings: list[str]) -> list[str]:
    """Return settings ``name=value`` as the words of a command line; several values are separated by spaces."""
    words = []
    for setting in settings:
        name, _, value = setting.partition("=")
        words += [f"--{name.replace('_', '-')}", *value.split()]
    return words


def beside(recording: Path, suffix: str) -> Path | None:
    """Return the file beside a recording that has its name without endings and a suffix of its own, if there is one."""
    stem = recording.name
    while True:
        candidate = recording.parent / f"{stem}{suffix}"
        if candidate.is_file():
            return candidate
        shorter = Path(stem).stem
        if shorter == stem:
            return None
        stem = shorter
