"""The sources of readings: bags, logs and simulated worlds."""

from datasets.counts import ReadingCounts
from datasets.errors import DatasetError
from datasets.opening import open_recording
from datasets.options import RecordingOptions
from datasets.recording import Recording

__all__ = ["DatasetError", "ReadingCounts", "Recording", "RecordingOptions", "open_recording"]
