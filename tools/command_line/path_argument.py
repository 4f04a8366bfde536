"""Names of files and folders on a command line."""

import argparse
from pathlib import Path


def path_argument(text: str) -> Path:
    """Return the path that a word of the command line names, as the `type` of an argument.

    Raises
    ------
    argparse.ArgumentTypeError
        The word is empty, which `Path` takes for the folder that one is in.
    """
    if not text:
        raise argparse.ArgumentTypeError("an empty text names no file: is a variable of the shell unset?")
    return Path(text)
