"""Errors of recordings."""

from tbmslam.errors import TbmSlamError


class DatasetError(TbmSlamError):
    """A recording cannot be read as requested. The message is one line with the file, the fact and the remedy."""
