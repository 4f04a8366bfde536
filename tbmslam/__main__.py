"""`python -m tbmslam` is the command `tbmslam`."""

import sys

from tbmslam.commands import run

if __name__ == "__main__":
    sys.exit(run())
