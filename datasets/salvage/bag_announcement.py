"""What the description of a ROS 2 bag says is in it, for where some of it is not."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from datasets.salvage.salvaged_bag import Loss
from tbmslam.io.special_file import why_unreadable

_LARGEST = 10_000_000  # of a description [bytes]


@dataclass(frozen=True)
class BagAnnouncement:
    """Files and messages that a description names.

    Parameters
    ----------
    files
        Names of the storage files.
    messages
        How many messages each topic has.
    start, seconds
        When the recording begins and how long it lasts [s].
    """

    files: tuple[str, ...] = ()
    messages: dict[str, int] = field(default_factory=dict)
    start: float = 0.0
    seconds: float = 0.0

    def missing_files(self, folder: Path) -> list[str]:
        """Return the names of files that are not there."""
        return [name for name in self.files if not (folder / name).is_file()]

    def loss(self, topic: str, found: int) -> Loss | None:
        """Return what is missing of a topic of which so many messages are found or known to be lost otherwise."""
        announced = self.messages.get(topic, 0)
        if announced <= found:
            return None
        missing = announced - found
        return Loss(self.start, self.seconds * missing / announced, missing)


def announced_by(folder: Path) -> BagAnnouncement:
    """Read the description of a ROS 2 bag; where it cannot be read, nothing is announced."""
    path = folder / "metadata.yaml"
    try:
        if why_unreadable(path) or path.stat().st_size > _LARGEST:
            return BagAnnouncement()
        said = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        files = tuple(Path(str(name)).name for name in said["relative_file_paths"])
        messages: dict[str, int] = {}
        for topic in said["topics_with_message_count"]:
            name = str(topic["topic_metadata"]["name"])
            messages[name] = messages.get(name, 0) + int(topic["message_count"])
        start, seconds = (1e-9 * int(value) for value in (_start(said), said["duration"]["nanoseconds"]))
    except Exception:  # noqa: BLE001 - a damaged description may hold anything
        return BagAnnouncement()
    return BagAnnouncement(files, messages, start, seconds)


def _start(said: Any) -> int:
    return int(said["starting_time"]["nanoseconds_since_epoch"])
