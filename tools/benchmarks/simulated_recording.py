"""Recordings and simulated drives as arguments of a benchmark, as ``office:1:good,beams=361``."""

import argparse
import contextlib
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tbmslam.errors import TbmSlamError
from tools import make_world
from tools.command_line.options import add_recording_options, options_from

if TYPE_CHECKING:
    from datasets.options import RecordingOptions


@dataclass(frozen=True)
class RecordingSpec:
    """A recording to open.

    Parameters
    ----------
    path
        The bag or log.
    options
        The options of reading.
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
        If an option is unknown or its value is impossible.
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
    """Return the file beside a recording with its name and another suffix, or None."""
    stem = recording.name
    while True:
        candidate = recording.parent / f"{stem}{suffix}"
        if candidate.is_file():
            return candidate
        shorter = Path(stem).stem
        if shorter == stem:
            return None
        stem = shorter


IGNORED = "ignored"
"""The kind of odometry that the bag holds but the SLAM ignores."""


class SimulationError(TbmSlamError):
    """A world could not be simulated."""


@dataclass(frozen=True)
class SimulatedRecording:
    """A simulated drive.

    Parameters
    ----------
    kind
        Kind of building.
    seed
        Seed of the building, the drive and all noise.
    odometry
        Kind of odometry noise as in make_world, or IGNORED.
    settings
        Options of make_world, each ``name=value``.
    """

    kind: str
    seed: int
    odometry: str
    settings: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> "SimulatedRecording":
        """Read ``KIND:SEED:ODOMETRY[,option=value]...``.

        Raises
        ------
        ValueError
            When it is not of that form.
        """
        description, *settings = text.split(",")
        parts = description.split(":")
        if len(parts) != 3 or not parts[1].isdecimal():
            raise ValueError(f"--world must look like office:1:good, got {text!r}")
        return cls(parts[0], int(parts[1]), parts[2], tuple(settings))

    def __str__(self) -> str:
        """Return the argument that it was parsed from."""
        return ",".join((f"{self.kind}:{self.seed}:{self.odometry}", *self.settings))

    def family(self) -> str:
        """Return the argument without the seed."""
        return ",".join((f"{self.kind}:*:{self.odometry}", *self.settings))

    def seeds(self, count: int) -> list["SimulatedRecording"]:
        """Return drives with this seed and the following ones."""
        return [replace(self, seed=self.seed + more) for more in range(count)]

    def write(self, folder: Path) -> RecordingSpec:
        """Write the bag and its truth into a folder.

        Raises
        ------
        SimulationError
            When it cannot be simulated; make_world has said why.
        """
        wheels = "good" if self.odometry == IGNORED else self.odometry
        words = ["--world", self.kind, "--seed", str(self.seed), "--odometry", wheels, "--out", str(folder)]
        with contextlib.redirect_stdout(sys.stderr):
            code = make_world.main([*words, *as_words(list(self.settings))])
        if code:
            raise SimulationError(f"{self} could not be simulated: see the message above")
        option = ",odometry=none" if self.odometry == IGNORED else ""
        return parse_recording_spec(f"{folder / 'robot_0.bag'}{option}")
