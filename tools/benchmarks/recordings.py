"""Recordings of benchmarks: bags, or simulated drives as ``office:1:good``, and errors against their truth."""

import argparse
import contextlib
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import Relations, matching_stamps, read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import BoolArray, FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import read_tum
from tools import make_world
from tools.command_line.options import add_recording_options, options_from

if TYPE_CHECKING:
    from datasets.options import RecordingOptions


@dataclass(frozen=True)
class RecordingSpec:
    """A recording to open."""

    text: str
    """The argument that it was parsed from."""
    path: Path
    options: "RecordingOptions"

    @property
    def name(self) -> str:
        """Return its name in tables."""
        return self.path.name.removesuffix(".bag")


class _RaisingParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def parse_recording_spec(text: str) -> RecordingSpec:
    """Read ``PATH[,option=value]...``; options are those of build_maps about recordings, `-` written `_` or not."""
    path, *settings = text.split(",")
    parser = _RaisingParser(prog=path, add_help=False, allow_abbrev=False)
    add_recording_options(parser)
    try:
        return RecordingSpec(text, Path(path), options_from(parser.parse_args(as_words(settings))))
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


@dataclass(frozen=True)
class SimulatedRecording:
    """A simulated drive."""

    kind: str
    seed: int
    """Seed of the building, the drive and all noise."""
    odometry: str
    """Kind of odometry noise as in make_world, or IGNORED."""
    settings: tuple[str, ...] = ()
    """Options of make_world, each ``name=value``."""

    @classmethod
    def parse(cls, text: str) -> "SimulatedRecording":
        """Read ``KIND:SEED:ODOMETRY[,option=value]...``."""
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
        """Write the bag and its truth into a folder."""
        wheels = "good" if self.odometry == IGNORED else self.odometry
        words = ["--world", self.kind, "--seed", str(self.seed), "--odometry", wheels, "--out", str(folder)]
        with contextlib.redirect_stdout(sys.stderr):
            code = make_world.main([*words, *as_words(list(self.settings))])
        if code:
            raise TbmSlamError(f"{self} could not be simulated: see the message above")
        option = ",odometry=none" if self.odometry == IGNORED else ""
        return parse_recording_spec(f"{folder / 'robot_0.bag'}{option}")


_SAME_SCAN_S = 1e-3
_SAME_POSE_S = 0.01


@dataclass(frozen=True)
class DriveErrors:
    """Errors of each relation, or of each true pose."""

    kind: Literal["relations", "poses"]
    """Whether the N errors are of relations or of poses."""
    metres: FloatArray
    degrees: FloatArray
    """Errors (N,), nan for those that cannot be scored; degrees are nan for poses."""
    has_scans: BoolArray
    """Whether each (N,) has scans at its stamps."""

    def scored(self) -> BoolArray:
        """Return which errors (N,) were scored."""
        return np.isfinite(self.metres)

    def error_m(self, chosen: BoolArray) -> float | None:
        """Return the mean error of some relations, or the RMS error of some poses (ATE) [m]; None if there are none."""
        metres = self.metres[chosen]
        if not len(metres):
            return None
        return float(metres.mean() if self.kind == "relations" else np.sqrt(np.mean(metres**2)))

    def error_deg(self, chosen: BoolArray) -> float | None:
        """Return the mean rotation error of some relations [deg]; None for poses, or if there are none."""
        degrees = self.degrees[chosen]
        return float(degrees.mean()) if len(degrees) and self.kind == "relations" else None


def truth_beside(recording: Path) -> Path:
    """Return the file of relations, or else of true poses, beside a recording."""
    for suffix in (".relations", ".truth.tum"):
        if (path := beside(recording, suffix)) is not None:
            return path
    raise TbmSlamError(f"{recording}: has no .relations and no .truth.tum beside it, so it cannot be scored: add one")


def drive_errors(truth: Path, estimate: Trajectory, scans: FloatArray) -> DriveErrors:
    """Compare the trajectory of a drive with the file of `truth_beside`.

    `scans` (S,) are the stamps of the scans that were given to be mapped [s].
    """
    if truth.name.endswith(".relations"):
        return _relation_errors(read_relations(truth), estimate, scans)
    return _pose_errors(read_tum(truth), estimate, scans)


def _relation_errors(relations: Relations, estimate: Trajectory, scans: FloatArray) -> DriveErrors:
    """Score the relations both of whose moments have an estimated pose."""
    metres, degrees = np.full((2, len(relations.stamps)), np.nan)
    errors = relation_errors(relations, estimate, _SAME_SCAN_S)
    metres[errors.checked], degrees[errors.checked] = errors.translations_m, errors.rotations_deg
    ends = [_has_any(scans, relations.stamps[:, end], _SAME_SCAN_S) for end in (0, 1)]
    return DriveErrors("relations", metres, degrees, ends[0] & ends[1])


def _pose_errors(truth: Trajectory, estimate: Trajectory, scans: FloatArray) -> DriveErrors:
    """Score the true poses with an estimated pose, after a rigid alignment."""
    metres = np.full(len(truth), np.nan)
    found, true = matching_stamps(estimate.stamps, truth.stamps, _SAME_POSE_S)
    if len(found) >= 2:
        target, source = truth.poses[true, :2], estimate.poses[found, :2]
        T_truth_map, _ = fit_rigid(target, source)
        metres[true] = np.hypot(*(T_truth_map.apply(source) - target).T)
    return DriveErrors("poses", metres, np.full(len(truth), np.nan), _has_any(scans, truth.stamps, _SAME_POSE_S))


def _has_any(scans: FloatArray, stamps: FloatArray, tolerance: float) -> BoolArray:
    """Return which stamps (N,) have a scan."""
    has = np.zeros(len(stamps), dtype=np.bool_)
    has[matching_stamps(scans, stamps, tolerance)[1]] = True
    return has
