"""Where bytes of strangers come in: for each border how they are read, and healthy bytes to begin with.

Whatever the bytes, a border answers with a good value or with a `TbmSlamError` of one line. `fuzz.py` looks for bytes
that make it do something else; what was ever found lies in corpus/ and is tried by every test run.
"""

import atexit
import json
import tempfile
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from datasets import open_recording
from merging.config import MergeConfig
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import preset
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import read_relations
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.tbm_dump import write_tbm_dump
from tbmslam.io.trajectory_file import read_tum
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan
from tests.fuzzing import bag_layers, seed_bags
from tests.merging_dump import write_merging_dump

ROOT = Path(__file__).resolve().parents[2]
CORPUS = Path(__file__).parent / "corpus"

CARMEN = """# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp
PARAM robot_frontlaser_offset 0.1 1.0 host 1.0
FLASER 4 1.0 2.0 2.5 81.91 0.0 0.0 0.0 0.0 0.0 0.0 1.0 host 1.0
ODOM 0.1 0.0 0.0 0.0 0.0 0.0 1.1 host 1.1
FLASER 4 1.0 2.0 2.5 3.0 0.1 0.0 0.0 0.1 0.0 0.0 1.2 host 1.2
"""


class Border(NamedTuple):
    """A reader: the name of its file, a function that reads it to the end, and one that makes healthy bytes."""

    file: str
    read: Callable[[Path], object]
    seeds: Callable[[], list[bytes]]


def cross(name: str, content: bytes) -> bool:
    """Read bytes by a border, and return whether they were accepted.

    Raises an AssertionError if the refusal is not one line that names the file, or if the result is not a map.
    """
    border = BORDERS[name]
    path = _folder(name) / border.file
    path.unlink(missing_ok=True)  # whoever still maps it into memory keeps the old bytes
    path.write_bytes(content)
    refusal = None
    try:
        border.read(path.with_name("map.yaml") if name == "picture" else path)
    except TbmSlamError as error:
        refusal = str(error)
    assert refusal is None or (len(refusal) < 1000 and len(refusal.splitlines()) == 1), refusal
    return refusal is None


def _map(path: Path) -> None:
    grid = load_map(path).grid
    assert grid.fault() is None


def _recording(path: Path) -> None:
    for reading in open_recording([path]):
        reading.check()


def _config(path: Path) -> None:
    try:
        values = tomllib.loads(path.read_bytes().decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError):
        return  # tomllib's own border; programs turn it into a line
    with suppress(ValueError):  # what programs print as a line
        changed(preset(str(values.get("preset", "default"))), values)
    with suppress(ValidationError):
        MergeConfig.model_validate(values)


_YAML = """image: {image}
resolution: 0.05
origin: [-1.0, 2.0, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def _drive() -> Drive:
    scan = LaserScan(1.0, -1.0, 0.5, 0.1, 30.0, np.array([1.0, 2.0, np.inf, np.nan]))
    keyframes = Keyframes.from_scans([scan, scan], [SE2.identity()] * 2, [SE2.identity()] * 2)
    return Drive("robot", Trajectory(np.array([1.0, 1.5]), np.zeros((2, 3))), keyframes, np.array([(0, 1)]))


def _saved(name: str) -> Callable[[], list[bytes]]:
    def seeds() -> list[bytes]:
        masses = np.random.default_rng(3).dirichlet(np.ones(4), size=(3, 4)).astype(np.float32)
        grid = TbmGrid(GridGeometry(0.1, -0.2, 0.3, 3, 4), masses)
        with tempfile.TemporaryDirectory() as folder:
            save_map(folder, TbmMap(grid, (_drive(),), {"seed": 1}))
            write_tbm_dump(Path(folder) / "slam.tbm_map", grid)
            write_merging_dump(Path(folder) / "merging.tbm_map", grid)
            return [path.read_bytes() for path in sorted(Path(folder).glob(name))]

    return seeds


@cache
def _folder(name: str) -> Path:
    """Return the folder in which a border's files are written, with what else they need; it goes with the process."""
    kept = tempfile.TemporaryDirectory(dir=_memory())
    atexit.register(kept.cleanup)
    folder = Path(kept.name)
    if name == "yaml":
        (folder / "map.pgm").write_bytes(b"P5\n2 1\n255\n\x00\xfe")
    if name == "picture":
        (folder / "map.yaml").write_text(_YAML.format(image=BORDERS[name].file))
    return folder


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108 - a disk would wear out


BORDERS: dict[str, Border] = {
    "npz": Border("map.npz", _map, _saved("map.npz")),
    "yaml": Border("map.yaml", _map, lambda: [_YAML.format(image="map.pgm").encode()]),
    "picture": Border("map.pgm", _map, lambda: [*_saved("*.pgm")(), *_saved("pignistic.png")()]),
    "tbm_map": Border("map.tbm_map", _map, _saved("*.tbm_map")),
    "beesoft": Border(
        "map.dat", _map, lambda: [b"robot_specifications->resolution 10\nglobal_map[0]: 1 2\n1.0 -1.0\n"]
    ),
    "bag": Border("drive.bag", _recording, seed_bags.ros1_seeds),
    "records": Border("drive.bag", bag_layers.read_ros1, seed_bags.ros1_seeds),
    "mcap": Border("drive.mcap", bag_layers.read_mcap, seed_bags.mcap_seeds),
    "database": Border("drive.db3", bag_layers.read_database, seed_bags.database_seeds),
    "message": Border("message", bag_layers.read_message, seed_bags.message_seeds),
    "carmen": Border("drive.log", _recording, lambda: [CARMEN.encode()]),
    "tum": Border(
        "drive.tum", read_tum, lambda: [b"# stamp x y z qx qy qz qw\n1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n"]
    ),
    "relations": Border("drive.relations", read_relations, lambda: [b"1.0 2.0 0.1 0.2 0 0 0 0.3\n"]),
    "config": Border(
        "config.toml",
        _config,
        lambda: [b"[tracker]\nkind = 'surfels'\n", json.dumps({"map": {"resolution": 0.1}}).encode()],
    ),
}
