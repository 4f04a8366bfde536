"""What a shell sets that compiled libraries crash on, checked before they are loaded."""

import os

from tbmslam.errors import TbmSlamError

_LEAST_MB = 2000
"""With two cores two small maps take 1260 MB of address space to be merged, a small drive 1020; with more cores more.
With less the libraries end with a segmentation fault, or wait for ever."""


class UnfitEnvironmentError(TbmSlamError):
    """The program cannot work under what the shell sets."""


def check_environment() -> None:
    """Refuse a limit on memory, or a number of threads, under which compiled code does not work.

    Raises
    ------
    UnfitEnvironmentError
        With the setting and what to set instead.
    """
    limit = _memory_limit()
    if limit is not None and limit < _LEAST_MB * 10**6:
        raise UnfitEnvironmentError(
            f"memory is limited to {limit // 10**6} MB (ulimit -v), and compiled code takes up to {_LEAST_MB} MB: "
            "raise the limit to 2000000 kB or more"
        )
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and not (threads.isascii() and threads.isdigit() and int(threads) > 0):
        raise UnfitEnvironmentError(
            f"NUMBA_NUM_THREADS is {threads!r}, not a number of threads: set it to 1 or more, or leave it unset"
        )


def _memory_limit() -> int | None:
    """Return how much address space the program may take [bytes]; None where there is no limit, or none known."""
    try:
        import resource
    except ImportError:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit
