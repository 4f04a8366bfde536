"""A command line's grammar whose help, where it cannot be printed, ends in one line."""

import argparse
import sys
from typing import IO

from tools.console import one_line
from tools.ending import FAILED, forget_unprinted, say


class Grammar(argparse.ArgumentParser):
    """Python's, which would lose the help and end as if all were well."""

    def print_help(self, file: IO[str] | None = None) -> None:  # type: ignore[override]  # typeshed wants less of a file
        """Print the help on stdout or into a file; where stdout takes none, end the program with one line."""
        if file is not None or sys.stdout is None:
            super().print_help(file)
            return
        try:
            sys.stdout.write(self.format_help())
            sys.stdout.flush()
        except OSError as error:
            say(f"{self.prog.split()[0]}: {one_line(error)}")
            forget_unprinted()
            sys.exit(FAILED)
