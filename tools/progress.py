"""Progress on the terminal: how far, how fast, and how long it will take."""

from collections.abc import Iterable
from typing import TypeVar

from tqdm import tqdm

from tbmslam.watch import Watch

T = TypeVar("T")


class ProgressBars(Watch):
    """Shows a bar with rate and time left for every step of many items; nothing where the output is no terminal."""

    def shown(self, items: Iterable[T], label: str, total: int | None, unit: str) -> Iterable[T]:
        """Return items that draw their bar while they are used."""
        return tqdm(items, desc=label, total=total, unit=f" {unit}", disable=None, leave=False)
