"""The sources of readings: bags, logs and simulated worlds.

Each name below is loaded when it is first used, so that the list of recordings is read without compiled code.
"""

from typing import TYPE_CHECKING

from tbmslam.lazy_names import lazy_names

if TYPE_CHECKING:
    from datasets.counts import ReadingCounts
    from datasets.errors import DatasetError
    from datasets.opening import open_recording
    from datasets.options import RecordingOptions
    from datasets.recording import Recording

__all__ = ["DatasetError", "ReadingCounts", "Recording", "RecordingOptions", "open_recording"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "DatasetError": ".errors",
        "ReadingCounts": ".counts",
        "Recording": ".recording",
        "RecordingOptions": ".options",
        "open_recording": ".opening",
    },
)
