"""Two robots' maps that are written over those of an earlier run: what there was, and what there is to be."""

import shutil
import tempfile
from functools import cache
from pathlib import Path

from tbmslam.io.map_folder import load_map
from tests.faults.fault_case import ProgramRun, run_program
from tools import build_maps, make_world

_OLD, _NEW = ("--set", "map.resolution=0.1"), ("--set", "map.resolution=0.05")
_TELLS_TIME = "report.html"


class WrittenMaps:
    """Bags of two robots in a flat in a new folder, and `out` with coarse maps that finer maps are to replace."""

    def __init__(self, folder: Path) -> None:
        prepared = Path(_prepared().name)
        shutil.copytree(prepared, folder)
        self.folder, self.out = folder, folder / "out"
        self.old, self.new = contents(folder / "out"), contents(folder / "new")

    def arguments(self, *more: object) -> tuple[object, ...]:
        """Return the words that have the finer maps made."""
        return (*_bags(self.folder), "--separate", *_NEW, *more, "-o", self.out)

    def are_whole(self) -> bool:
        """Tell whether every file is the old one or the new one, and each map can be read."""
        whole = all(content in {self.old.get(name), self.new.get(name)} for name, content in self.named().items())
        return whole and all(load_map(self.out / f"robot_{k}").grid.fault() is None for k in range(2))

    def named(self) -> dict[str, bytes]:
        """Return the files there are, without hidden ones that a killed writer leaves until it writes again."""
        return {name: content for name, content in contents(self.out).items() if not Path(name).name.startswith(".")}

    def run_again(self) -> bool:
        """Make the finer maps, undisturbed, and tell whether all is as if nothing had happened."""
        return run_program(build_maps.main, *self.arguments()).code == 0 and contents(self.out) == self.new


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder, but for the page that tells how long it took."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != _TELLS_TIME)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@cache
def _prepared() -> "tempfile.TemporaryDirectory[str]":
    """Simulate and map once for all faults; the folder goes when the process ends."""
    kept = tempfile.TemporaryDirectory(prefix="faults.")
    folder = Path(kept.name)
    drive = ("--world", "apartment", "--seed", 3, "--robots", 2, "--beams", 361, "--rate", 5, "--length", 25)
    done = [run_program(make_world.main, *drive, "--overlap", 0.7, "-o", folder)]
    for name, setting in (("out", _OLD), ("new", _NEW)):
        done.append(run_program(build_maps.main, *_bags(folder), "--separate", *setting, "-o", folder / name))
    _require(done)
    return kept


def _bags(folder: Path) -> list[Path]:
    return [folder / f"robot_{k}.bag" for k in range(2)]


def _require(done: list[ProgramRun]) -> None:
    failed = [one.stderr for one in done if one.code]
    if failed:
        raise RuntimeError(f"the maps to disturb could not be made: {failed[0]}")
