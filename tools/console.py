"""What programs print."""

import io
import sys


def print_anything() -> None:
    """Let names of files be printed that are no text, with their bytes written out; Python would fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
