"""What programs print."""

import io
import sys


def print_anything() -> None:
    """Let names of files be printed that are no text, with their bytes written out; Python would fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def one_line(error: Exception) -> str:
    """Return what an error says in one line; the system's errors, such as a name that is too long, with the name."""
    if isinstance(error, OSError):
        what = error.strerror or error
        named = f"{error.filename}: {what}: check that name, or choose another"
        said = f"{what}: check what is read and printed" if error.filename is None else named
    else:
        said = str(error)
    return " ".join(said.splitlines())  # names of files may hold line ends
