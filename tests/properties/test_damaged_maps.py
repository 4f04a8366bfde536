"""Whatever happens to a map's file, reading it gives a map of valid beliefs or one clear line."""

import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.tbm_dump import write_tbm_dump
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan
from tests.merging_dump import write_merging_dump

BEESOFT = """robot_specifications->resolution 10
global_map[0]: 2 3
1.0 0.0 -1.0
0.5 0.9 0.1
"""
PLAIN_PGM = "P2\n# by hand\n4 3\n100\n" + "0 50 100 77\n" * 3
FILES = ("map.npz", "map.yaml", "map.pgm", "pignistic.png", "plain.pgm", "slam.tbm_map", "merging.tbm_map", "hall.dat")


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """A folder with a small map in every format."""
    folder = tmp_path_factory.mktemp("healthy")
    masses = np.random.default_rng(3).dirichlet(np.ones(4), size=(3, 4)).astype(np.float32)
    grid = TbmGrid(GridGeometry(0.1, -0.2, 0.3, 3, 4), masses)
    scan = LaserScan(1.0, 0.0, 0.1, 0.1, 10.0, np.array([1.0, np.inf]))
    pose = SE2(0.0, 0.0, 0.5)
    drive = Drive(
        "robot_0", Trajectory(np.array([1.0]), np.array([pose])), Keyframes.from_scans([scan], [pose], [pose])
    )
    save_map(folder, TbmMap(grid, (drive,), {"seed": 1}))
    write_tbm_dump(folder / "slam.tbm_map", grid)
    write_merging_dump(folder / "merging.tbm_map", grid)
    (folder / "hall.dat").write_text(BEESOFT)
    (folder / "plain.pgm").write_text(PLAIN_PGM)
    yaml = (folder / "map.yaml").read_text()
    (folder / "pignistic.yaml").write_text(yaml.replace("map.pgm", "pignistic.png").replace("trinary", "scale"))
    (folder / "plain.yaml").write_text(yaml.replace("map.pgm", "plain.pgm").replace("0.0]", "0.7]"))
    return folder


def map_of(folder, file):
    """Return the path to load so that `file` is read: a picture's yaml, else the file itself."""
    path = folder / file
    return path.with_suffix(".yaml") if path.suffix in {".pgm", ".png"} else path


@pytest.mark.parametrize("file", FILES)
def test_the_healthy_files_are_read(healthy, file):
    assert load_map(map_of(healthy, file)).grid.fault() is None


@st.composite
def damages(draw):
    """Cut at some share of the length, then change, insert or drop some bytes at shares of the length."""
    kept = draw(st.floats(0.0, 1.0) | st.just(1.0))
    changes = st.tuples(
        st.floats(0.0, 1.0), st.sampled_from(("set", "insert", "drop")), st.binary(min_size=1, max_size=4)
    )
    return kept, draw(st.lists(changes, max_size=4))


def damaged(content, damage):
    kept, changes = damage
    content = bytearray(content[: round(kept * len(content))])
    for share, how, replacement in changes:
        start = int(share * len(content))
        stop = start if how == "insert" else start + len(replacement)
        content[start:stop] = b"" if how == "drop" else replacement
    return bytes(content)


@pytest.mark.parametrize("file", FILES)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=damages())
@example(damage=(0.0, []))
def test_damage_gives_valid_beliefs_or_one_line(healthy, tmp_path, file, damage):
    folder = shutil.copytree(healthy, tmp_path / "map") if not (tmp_path / "map").exists() else tmp_path / "map"
    (folder / file).write_bytes(damaged((healthy / file).read_bytes(), damage))
    try:
        read = load_map(map_of(folder, file))
    except MapFileError as error:
        assert "\n" not in str(error)  # noqa: PT017  what it says is the point, and there need be none
        assert str(folder) in str(error)  # noqa: PT017
    else:
        assert read.grid.fault() is None
