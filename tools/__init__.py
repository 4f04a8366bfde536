"""Programs: command lines, reports and exit codes, without algorithms.

A program that is run as a file handles Ctrl-C from here on, before it loads anything large.
"""

import sys
from pathlib import Path

_program = Path(getattr(sys.modules["__main__"], "__file__", None) or "").resolve()
if _program.parent == Path(__file__).resolve().parent:
    from tools.command_line.interruption import handle_interruption

    handle_interruption(_program.stem)
