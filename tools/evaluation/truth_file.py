"""`truth.json` beside the maps of build_maps: their true poses, the reference, and its quality."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.special_file import why_unreadable

NAME = "truth.json"
OWN_MAP = "tbmslam's own map of the whole recording, not ground truth"
GIVEN = "trajectories given as true"


class TruthFileError(TbmSlamError):
    """A truth.json that does not say where maps lie: one line with the file, the fact and the remedy."""


@dataclass(frozen=True)
class TruthFile:
    """Where robots' maps lie.

    Parameters
    ----------
    poses
        T_reference_map of each robot.
    source
        Kind of the reference; empty in older files.
    warnings
        What went wrong as the reference was made, by time: `at_s` since the recording began [s], `what` and more.
    """

    poses: Mapping[str, SE2]
    source: str = ""
    warnings: tuple[Mapping[str, object], ...] = ()

    def doubt(self) -> str | None:
        """Return in one line why the reference itself may be wrong; None if nothing is known against it."""
        if not self.warnings:
            return None
        first, number = self.warnings[0], len(self.warnings)
        at = "" if first.get("all_along") is True else f"at {first.get('at_s')} s: "
        others = f", and {number - 1} more" if number > 1 else ""
        return (
            f"is {self.source or 'of unknown source'}, and may be wrong itself, as making it gave warnings: "
            f"{at}{first.get('what')}{others}"
        )


def read_truth_file(path: Path) -> TruthFile:
    """Read where the maps of a folder lie.

    Raises
    ------
    TruthFileError
        If the file cannot be read or is another, such as the truth of a simulated world.
    """
    try:
        if why := why_unreadable(path):
            raise TruthFileError(f"{path} {why}: make it with build_maps")
        said = json.loads(path.read_text(encoding="utf-8"))
        source = str(said.get("source", ""))
        if source not in {"", OWN_MAP, GIVEN}:
            raise TruthFileError(f"{path} is {source!r} and no place of maps: name the folder that build_maps wrote")
        poses = {name: SE2.from_array(entry["T_reference_map"]) for name, entry in said["robots"].items()}
        warnings = tuple(dict(warning) for warning in said.get("warnings", ()))
        return TruthFile(poses, source, warnings)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise TruthFileError(
            f"{path} does not say where the maps lie ({error!r}): make them with build_maps and --reference or --robots"
        ) from None
