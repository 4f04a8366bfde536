"""One fault to try, and what came of it."""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Outcome:
    """What came of a fault.

    Parameters
    ----------
    happened
        What the program did, for people.
    lost
        What was lost, for people.
    survived
        Whether that is right: a right result, or one clear line.
    """

    happened: str
    lost: str
    survived: bool


@dataclass(frozen=True)
class FaultCase:
    """One fault to try.

    Parameters
    ----------
    name
        What goes wrong, for people.
    attempt
        Makes the fault in an empty folder, which is its own, and runs the programs on it.
    quick
        Whether it belongs to the short form.
    """

    name: str
    attempt: Callable[[Path], Outcome]
    quick: bool = False


def shortened(line: str) -> str:
    """Return a line, or as many of its first words as a table has room for."""
    return textwrap.shorten(line, 150, placeholder=" ...")
