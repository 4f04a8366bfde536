"""Locates cached kernels by the text that they were compiled from, independent of the place of installation."""

from collections.abc import Callable
from pathlib import Path

from tbmslam.kernels.cache_folders import folder_of


class ContentLocator:
    """Tells numba the cache folder of a file of kernels.

    The locators of numba depend on the path and the time stamp of the source. With them, a second installation or a new
    container compiles again. Source: numba's reference, "NUMBA_CACHE_LOCATOR_CLASSES".
    """

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., object], source: str) -> "ContentLocator | None":
        """Return the locator of a function in a file; None if no folder is writable."""
        folder = folder_of(source)
        return None if folder is None else cls(folder, function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """Make the folder, which another process may have removed."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return a constant: the name of the folder identifies the source already."""
        return "by content"

    def get_disambiguator(self) -> str:
        """Return text that distinguishes functions of the same name in a file."""
        return str(self._line)
