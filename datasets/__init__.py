"""The sources of readings: bags, logs and simulated worlds.

Each name below is loaded when it is first used, so that the list of recordings is read without compiled code.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets.counts import ReadingCounts
    from datasets.errors import DatasetError
    from datasets.opening import open_recording
    from datasets.options import RecordingOptions
    from datasets.recording import Recording

__all__ = ["DatasetError", "ReadingCounts", "Recording", "RecordingOptions", "open_recording"]

_HOMES = {
    "DatasetError": "errors",
    "ReadingCounts": "counts",
    "Recording": "recording",
    "RecordingOptions": "options",
    "open_recording": "opening",
}


def __getattr__(name: str) -> object:
    """Load a name at its first use."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names for completion."""
    return sorted({*globals(), *__all__})
