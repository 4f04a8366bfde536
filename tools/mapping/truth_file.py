"""truth.json: the poses of robots' maps in the frame of a reference. `tbmslam map` writes it."""

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
    """A truth.json without poses of the maps. The message states the file, the problem and the remedy."""


@dataclass(frozen=True)
class TruthFile:
    """The poses of robots' maps."""

    poses: Mapping[str, SE2]
    """T_reference_map of each robot."""
    source: str
    warnings: tuple[Mapping[str, object], ...] = ()
    """Incidents of the reference by time: `at_s` since the begin of the recording [s], `what` and more."""

    def doubt(self) -> str | None:
        """Return the reason to doubt the reference, in one line; None if there is none."""
        if not self.warnings:
            return None
        first, number = self.warnings[0], len(self.warnings)
        at = "" if first.get("all_along") is True else f"at {first.get('at_s')} s: "
        warnings = f"{number} warnings, first" if number > 1 else "a warning"
        return f"is {self.source}, and may be wrong itself: its mapping gave {warnings}: {at}{first.get('what')}"


def read_truth_file(path: Path) -> TruthFile:
    """Read the poses of the maps of a folder."""
    try:
        if why := why_unreadable(path):
            raise TruthFileError(f"{path} {why}: make it with `tbmslam map`")
        record = json.loads(path.read_text(encoding="utf-8"))
        source = str(record["source"])
        if source not in {OWN_MAP, GIVEN}:
            raise TruthFileError(f"{path} is {source!r} and no place of maps: name the folder that `tbmslam map` wrote")
        poses = {name: SE2.from_array(entry["T_reference_map"]) for name, entry in record["robots"].items()}
        warnings = tuple(dict(warning) for warning in record["warnings"])
        return TruthFile(poses, source, warnings)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise TruthFileError(
            f"{path} does not state the poses of maps ({error!r}): make them with `tbmslam map` and --reference or "
            "--robots"
        ) from None
