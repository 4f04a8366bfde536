"""Where numba finds compiled kernels: by what they were compiled from, wherever the program is installed."""

from collections.abc import Callable
from pathlib import Path

from tbmslam.kernels.cache_folders import folder_of


class ContentLocator:
    """Tells numba the folder of a kernel's file, which is named by all text that is compiled into it.

    Numba's own locators put a folder in between that is named by the path of the source, and believe what is cached as
    long as the source's time stamp stays: a second installation, or the same in a new container, compiles anew.
    Source: numba's reference, "NUMBA_CACHE_LOCATOR_CLASSES".
    """

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., object], source: str) -> "ContentLocator | None":
        """Return the locator of a function in a file; None where nothing can be cached."""
        folder = folder_of(source)
        return None if folder is None else cls(folder, function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """Make the folder where another process has pruned it."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what must be the same for cached code to be used: the folder's name has told that already."""
        return "by content"

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name and file apart."""
        return str(self._line)
