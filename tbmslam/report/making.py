"""How a result was made: what was typed, with which versions, and how long it took."""

import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field

_NAMED = ("tbmslam", "numpy", "numba", "opencv-python-headless", "gtsam", "rosbags")


@dataclass(frozen=True)
class Making:
    """What a report says of the run that it reports.

    Parameters
    ----------
    command
        What was typed.
    seconds
        How long each step took [s].
    """

    command: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)


def versions() -> dict[str, str]:
    """Return the versions of Python and of what results depend on, as far as it is installed."""
    found = {"python": platform.python_version()}
    for name in _NAMED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
