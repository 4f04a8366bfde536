"""Items of a recording some at a time, as many scans at once are cleaned in far less time."""

from collections.abc import Iterable, Iterator
from typing import TypeVar

from datasets.errors import DatasetError

Item = TypeVar("Item")
_BLOCK = 256


def in_blocks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Yield items some at a time, those before a DatasetError, too."""
    block: list[Item] = []
    try:
        for item in items:
            block.append(item)
            if len(block) == _BLOCK:
                yield block
                block = []
    except DatasetError:
        yield block
        raise
    yield block
