"""Download public recordings by name.

An interrupted download is continued. A complete file is checked, and not downloaded again.
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Never

from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program

if TYPE_CHECKING:
    from datasets.downloading import KnownRecording

EXAMPLES = """examples:
  tbmslam download --list
      every recording known by name, with size and licence
  tbmslam download ccny/demo
      recordings/ccny/demo.bag, a real recording of 1 MB
  tbmslam download stata/2011-01-24-06-18-27 freiburg/intel -o recordings
      recordings/stata/2011-01-24-06-18-27.bag and recordings/freiburg/intel.clf with its true relations
"""


def parser(program: str = "download") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    what = grammar.add_argument_group("recordings")
    what.add_argument("names", nargs="*", metavar="NAME", help="recordings, as --list names them")
    what.add_argument("--list", action="store_true", help="list the recordings")
    where = grammar.add_argument_group("output")
    where.add_argument(
        "-o", "--out", type=path_argument, default=Path("recordings"), metavar="FOLDER", help="folder (recordings)"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def main(argv: list[str] | None = None, program: str = "download") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    if not args.names and not args.list:
        grammar.error("give the name of a recording, or --list")
    return run_program(program, lambda: _run(args), debug=args.debug, interrupted="run it again to go on")


def _run(args: argparse.Namespace) -> None:
    from datasets.downloading import known_recording

    if args.list:
        _list()
    if recordings := [known_recording(name) for name in args.names]:
        from tools.command_line.output_folder import output_folder

        with output_folder(args.out):  # two writers would corrupt the file
            for recording in recordings:
                _download(recording, args.out)


def _list() -> None:
    from datasets.downloading import known_recordings

    shown = ""
    for recording in known_recordings().values():
        if recording.page != shown:
            print(f"{recording.page}\n  licence: {recording.license}\n  cite: {recording.citation}")
            if recording.truth:
                print(f"  truth: {recording.truth}")
        shown = recording.page
        size = f"{recording.megabytes:g} MB" if recording.megabytes else "size unknown"
        print(f"  {recording.name:27} {size:>13}  {recording.about}{'' if recording.reached else ' *'}")
    if not all(recording.reached for recording in known_recordings().values()):
        print("Addresses marked with * were never tested.")


def _download(recording: "KnownRecording", out: Path) -> None:
    from tqdm import tqdm

    from datasets.downloading import DownloadError, download

    paths = []
    for address in recording.addresses:
        path = out / recording.name.partition("/")[0] / address.rpartition("/")[2]
        with tqdm(desc=path.name, unit="B", unit_scale=True, disable=None, leave=False) as bar:

            def progress(have: int, whole: int | None, bar: "tqdm[Never]" = bar) -> None:
                bar.total = whole
                bar.update(have - bar.n)

            try:
                fetched = download(address, path, recording.sha256.get(path.name), progress)
            except DownloadError as error:
                raise DownloadError(f"{error} ({recording.page})") from None
        print(f"{path}: {'arrived' if fetched else 'is there already'}, SHA-256 in {path.name}.sha256")
        paths.append(path)
    print(f"  licence: {recording.license}; cite: {recording.citation}; see {recording.page}")
    command = f"tbmslam map {shlex.quote(str(paths[0]))} {recording.options}".rstrip()
    print(f"  next: {command} -o out/{paths[0].stem}")


if __name__ == "__main__":
    sys.exit(main())
