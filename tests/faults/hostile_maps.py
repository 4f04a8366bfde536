"""Maps that nobody should believe, given to merge together with a good one: one line must say which and why."""

import io
import os
import pickle
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tests.faults.child_run import run_child
from tests.faults.fault_case import FaultCase, Outcome, shortened
from tools import merge

_MEMORY = 3_000_000_000
"""What the program may take [B], much of it only reserved by libraries; a bomb wants more."""


def _refused(folder: Path, spoil: Callable[[Path], None], fact: str) -> Outcome:
    """Merge two good maps and a spoilt one."""
    for name in ("good", "better", "bad"):
        save_map(folder / name, TbmMap(_room()))
    spoil(folder / "bad")
    maps = (folder / "good", folder / "bad", folder / "better")
    done = run_child(merge, *maps, "-o", folder / "merged", memory=_MEMORY)
    said = done.stderr.replace(f"{folder}/", "").strip()
    right = done.code == 1 and done.stderr.count("\n") == 1 and fact in said and said.startswith("merge: bad")
    right = right and not (folder / "merged").exists()
    happened = f"refused in one line: {shortened(said)}" if right else f"exit {done.code}: {said[-100:]}"
    return Outcome(happened, "nothing" if right else "everything", survived=right)


def _room() -> TbmGrid:
    masses = np.zeros((60, 80, 4), dtype=np.float32)
    masses[..., 1] = 1.0
    masses[[0, -1]] = masses[:, [0, -1]] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.1, 0.0, 0.0, 60, 80), masses)


def _rewritten(folder: Path, name: str, content: bytes) -> None:
    """Write a map.npz again with other bytes for one of its arrays."""
    path = folder / "map.npz"
    with zipfile.ZipFile(path) as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()} | {f"{name}.npy": content}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in entries.items():
            archive.writestr(entry, data)


def _header(shape: tuple[int, ...], dtype: str) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def _zip_bomb(folder: Path) -> None:
    """Let a file of a few megabytes unpack to five gigabytes of honest zeros: the stamps of a drive."""
    length = 625_000_000
    path = folder / "map.npz"
    with zipfile.ZipFile(path) as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()}
    drives = io.BytesIO()
    np.lib.format.write_array(drives, np.array(["drive"]), allow_pickle=False)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for entry, data in (entries | {"drives.npy": drives.getvalue()}).items():
            archive.writestr(entry, data)
        with archive.open("drive_0_stamps.npy", "w", force_zip64=True) as stream:
            stream.write(_header((length,), "<f8"))
            for _ in range(length // 1_250_000):
                stream.write(bytes(10_000_000))


def _too_many_cells(folder: Path) -> None:
    _rewritten(folder, "masses", _header((60_000, 60_000, 4), "<f4") + bytes(1000))


def _huge_picture(folder: Path) -> None:
    """Let a yaml name a picture of 3.6 GB, nearly all of it a hole in the file."""
    (folder / "map.npz").unlink()
    with (folder / "map.pgm").open("wb") as file:
        file.write(b"P5\n60000 60000\n255\n")
        file.truncate(3_600_000_019)


def _pickled(folder: Path) -> None:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "|O", "fortran_order": False, "shape": (60, 80, 4)})
    _rewritten(folder, "masses", stream.getvalue() + pickle.dumps(_Trap(str(folder / "sprung"))))


class _Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (self._path,)


def _pointing_at(folder: Path, image: str) -> None:
    """Let a yaml name a picture."""
    (folder / "map.npz").unlink()
    text = (folder / "map.yaml").read_text(encoding="utf-8")
    (folder / "map.yaml").write_text(text.replace("map.pgm", image), encoding="utf-8")


def _linked_to_a_device(folder: Path) -> None:
    (folder / "map.npz").unlink()
    (folder / "map.pgm").unlink()
    (folder / "map.pgm").symlink_to("/dev/zero")


def _pipe(folder: Path) -> None:
    (folder / "map.npz").unlink()
    (folder / "map.pgm").unlink()
    os.mkfifo(folder / "map.pgm")


def _cut_off(folder: Path) -> None:
    os.truncate(folder / "map.npz", (folder / "map.npz").stat().st_size // 2)


def _not_permitted(folder: Path) -> None:
    (folder / "map.npz").chmod(0o000)


def _not_finite(folder: Path) -> None:
    (folder / "map.npz").unlink()
    text = (folder / "map.yaml").read_text(encoding="utf-8")
    (folder / "map.yaml").write_text(text.replace("resolution: 0.1", "resolution: .nan"), encoding="utf-8")


def _case(name: str, spoil: Callable[[Path], None], fact: str, *, quick: bool = False) -> FaultCase:
    return FaultCase(name, partial(_refused, spoil=spoil, fact=fact), quick)


CASES = (
    _case("map.npz is a zip bomb of 5 GB", _zip_bomb, "drive_0_stamps"),
    _case("map.npz states 60000 x 60000 cells", _too_many_cells, "60000", quick=True),
    _case("picture of 60000 x 60000 cells", _huge_picture, "60000 x 60000 cells", quick=True),
    _case("map.npz holds a pickle", _pickled, "object", quick=True),
    _case("yaml names ../../etc/passwd", partial(_pointing_at, image="../../etc/passwd"), "outside the yaml's folder"),
    _case("yaml names /dev/zero", partial(_pointing_at, image="/dev/zero"), "outside the yaml's folder"),
    _case("the picture is a link to a device", _linked_to_a_device, "a device"),
    _case("the picture is a pipe nobody writes into", _pipe, "a device"),
    _case("yaml with a resolution of nan", _not_finite, "resolution"),
    _case("one of three maps is cut off", _cut_off, "damaged"),
    _case("one of three maps may not be read", _not_permitted, "Permission denied"),
)
