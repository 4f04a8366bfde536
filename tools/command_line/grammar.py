"""A command line's grammar whose help, where it cannot be printed, ends in one line."""

import argparse
import re
import sys
from typing import IO, Any

from tools.command_line.console import one_line
from tools.command_line.ending import FAILED, forget_unprinted, say


class Grammar(argparse.ArgumentParser):
    """Python's, which would lose the help and end as if all were well, and takes -1e-5 for an option."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$", re.IGNORECASE)

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
