"""What only the end of a drive tells."""

from typing import NamedTuple


class EndWarning(NamedTuple):
    """A warning that the end of a drive tells.

    Parameters
    ----------
    subject
        What it is about, in a word.
    what
        What is wrong, and what mends it.
    stamp, seconds
        When it began and how long it lasted [s].
    all_along
        Whether it holds for the whole drive.
    """

    subject: str
    what: str
    stamp: float = 0.0
    seconds: float = 0.0
    all_along: bool = True
