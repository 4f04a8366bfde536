"""What somebody typed to run a program."""

import shlex
import sys
from collections.abc import Sequence


def typed_command(program: str, arguments: Sequence[str] | None) -> str:
    """Return the command line as a shell takes it.

    Parameters
    ----------
    program
        Name of the program, where it was called from Python with its arguments.
    arguments
        These; None where it was started from a shell.
    """
    return shlex.join(sys.orig_argv if arguments is None else [program, *arguments])
