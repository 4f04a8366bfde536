"""A program that waits at a moment within the writing of a file, however fast or slow the machine is.

python -m tests.faults.waiting_child tools.build_maps run.bag -o out      with a `Moment` in the environment

Processes that the program starts import this module as their main one, and wait there, too.
"""

import json
import os
import re
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Literal, NamedTuple

State = Literal["empty", "half", "whole", "named"]
_VARIABLE = "TBMSLAM_MOMENT"


class Moment(NamedTuple):
    """The moment at which a program waits.

    It is defined by the file that is written, and by its part on the disk under its temporary name: nothing, half or
    all of it; "named": the file has its name. In the folder `signs` the file `here` shows that the program waits, and
    `go` lets it continue.
    """

    path: str
    state: State
    signs: str

    def environment(self) -> dict[str, str]:
        """Return the environment in which `waiting_child` waits at this moment."""
        return os.environ | {_VARIABLE: json.dumps(self)}

    def has_come(self) -> bool:
        """Tell whether the program waits, or has waited."""
        return Path(self.signs, "here").exists()

    def pass_by(self) -> None:
        """Let the program go on."""
        Path(self.signs, "go").touch()


def wait_at(moment: Moment) -> None:
    """Wait at a moment of this process as soon as it comes; Python tells of each file that it opens or renames."""
    folder, name = os.path.split(moment.path)
    temporary = re.compile(rf"{re.escape(folder)}/\.[0-9a-f]{{8}}\.{re.escape(name)}")
    renamed = False

    def watch(event: str, args: tuple[object, ...]) -> None:
        nonlocal renamed
        if event == "os.rename" and temporary.fullmatch(str(args[0])) and not moment.has_come():
            renamed = True
            if moment.state != "named":
                file = Path(str(args[0]))
                size = file.stat().st_size
                content = file.read_bytes()
                # A writer that is stopped earlier leaves the beginning.
                os.truncate(file, {"empty": 0, "half": size // 2, "whole": size}[moment.state])
                _wait(moment)
                file.write_bytes(content)  # who is let go on has written all
        elif event == "open" and renamed and str(args[0]) == folder and not moment.has_come():
            _wait(moment)

    sys.addaudithook(watch)


def _wait(moment: Moment) -> None:
    Path(moment.signs, "here").touch()
    while not Path(moment.signs, "go").exists():
        time.sleep(0.01)


if _VARIABLE in os.environ:
    wait_at(Moment(*json.loads(os.environ[_VARIABLE])))

if __name__ == "__main__":
    sys.exit(import_module(sys.argv[1]).main(sys.argv[2:]))
