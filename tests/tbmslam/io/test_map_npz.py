import math

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.belief.tiled_masses import TiledMasses
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_npz import ArrayZip, read_map_file, write_map_file, write_npz
from tbmslam.map.drive import Drive, DriveLinks, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan


def scan(beams):
    ranges = np.linspace(0.5, 8.0, beams)
    ranges[:2] = np.inf, np.nan
    return LaserScan(1.5, -1.0, 0.01, 0.1, math.inf, ranges)


def drive(name, scans=2):
    trajectory = Trajectory(1.3e9 + np.arange(5) / 20, np.random.default_rng(1).normal(size=(5, 3)))
    poses = [SE2(0.1 * index, 0.0, 0.2) for index in range(scans)]
    return Drive(
        name,
        trajectory,
        Keyframes.from_scans(
            [scan(7 + index) for index in range(scans)], poses, [SE2(0.3, 0, 1)] * scans, range(1, 1 + scans)
        ),
        np.array([(0, scans - 1)] if scans else [], dtype=np.int64).reshape(-1, 2),
        DriveMotions(np.full((scans - 1, 3), 0.1), np.tile(np.diag([1e4, 2e4, 1e6]), (scans - 1, 1, 1)))
        if scans
        else None,
        DriveMotions(np.array([[0.1, -0.3, 0.2]]), np.diag([3e4, 1e4, 2e6])[None]) if scans else None,
    )


@pytest.fixture
def tbm_map():
    masses = np.random.default_rng(0).dirichlet(np.ones(4), size=(6, 9)).astype(np.float32)
    grid = TbmGrid(GridGeometry(0.05, -1.0 / 3.0, 1e3 * math.pi, 6, 9), masses)
    return TbmMap(grid, (drive("robot_0"), drive("röbot/1", scans=0)), {"recording": "a.bag", "robots": [1, 2.5, None]})


def arrays_of(tbm_map, path):
    write_map_file(path, tbm_map)
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def test_what_is_written_is_read(tbm_map, tmp_path):
    write_map_file(tmp_path / "map.npz", tbm_map)
    read = read_map_file(tmp_path / "map.npz")
    assert read.grid.geometry == tbm_map.grid.geometry
    assert read.grid.masses.dtype == np.float32
    np.testing.assert_array_equal(read.grid.masses, tbm_map.grid.masses)
    assert read.provenance == tbm_map.provenance
    assert [one.name for one in read.drives] == ["robot_0", "röbot/1"]
    for found, wanted in zip(read.drives, tbm_map.drives, strict=True):
        for part in ("trajectory", "keyframes"):
            for name, values in vars(getattr(wanted, part)).items():
                np.testing.assert_array_equal(getattr(getattr(found, part), name), values, err_msg=name)
        np.testing.assert_array_equal(found.closures, wanted.closures)
    for kind in ("motions", "closure_motions"):
        measured, none = (getattr(found, kind) for found in read.drives)
        assert none is None
        assert measured is not None
        np.testing.assert_array_equal(measured.steps, getattr(tbm_map.drives[0], kind).steps)
        np.testing.assert_array_equal(measured.informations, getattr(tbm_map.drives[0], kind).informations)


def test_loops_between_drives_come_back(tmp_path, tbm_map):
    drives = (drive("a"), drive("b", scans=3))
    links = DriveLinks(
        np.array([[0, 1, 1, 2]]), DriveMotions(np.array([[0.1, 0.2, 0.3]]), np.diag([1e4, 2e4, 1e6])[None])
    )
    write_map_file(tmp_path / "map.npz", TbmMap(tbm_map.grid, drives, links=links))
    read = read_map_file(tmp_path / "map.npz").links
    np.testing.assert_array_equal(read.ends, links.ends)
    np.testing.assert_array_equal(read.motions.steps, links.motions.steps)
    np.testing.assert_array_equal(read.motions.informations, links.motions.informations)
    with np.load(tmp_path / "map.npz") as archive:
        arrays = dict(archive)
    for column, wrong, message in ((2, 2, "between the 2 drives"), (1, -1, "keyframes of the drives")):
        broken = links.ends.copy()
        broken[0, column] = wrong
        write_npz(tmp_path / "bad.npz", {**arrays, "links_ends": broken})
        with pytest.raises(MapFileError, match=message):
            read_map_file(tmp_path / "bad.npz")


def test_a_map_without_drives_is_one_too(tbm_map, tmp_path):
    write_map_file(tmp_path / "map.npz", TbmMap(tbm_map.grid))
    read = read_map_file(tmp_path / "map.npz")
    assert read.drives == ()
    assert read.links is None
    assert read.provenance == {}


def test_the_same_map_gives_the_same_bytes(tbm_map, tmp_path):
    write_map_file(tmp_path / "a.npz", tbm_map)
    write_map_file(tmp_path / "b.npz", read_map_file(tmp_path / "a.npz"))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_map_without_motions_is_read(tbm_map, tmp_path):
    arrays = {k: v for k, v in arrays_of(tbm_map, tmp_path / "map.npz").items() if "_motions_" not in k}
    write_npz(tmp_path / "old.npz", arrays)
    drives = read_map_file(tmp_path / "old.npz").drives
    assert [(drive.motions, drive.closure_motions) for drive in drives] == [(None, None), (None, None)]
    assert len(drives[0].closures) == 1


@pytest.mark.parametrize("kind", ["motions", "closure_motions"])
def test_motions_that_are_none_are_refused(tbm_map, tmp_path, kind):
    arrays = arrays_of(tbm_map, tmp_path / "map.npz")
    arrays[f"drive_0_{kind}_informations"] = -arrays[f"drive_0_{kind}_informations"]
    write_npz(tmp_path / "bad.npz", arrays)
    with pytest.raises(MapFileError, match="informations must be symmetric and positive definite"):
        read_map_file(tmp_path / "bad.npz")


def test_masses_are_written_and_read_in_bands(tmp_path):
    masses = np.zeros((700, 50, 4), dtype=np.float32)
    masses[..., UNKNOWN] = 1.0
    masses[250:260, 20:30] = masses[699, 49] = (0.0, 0.25, 0.5, 0.25)
    grid = TbmGrid(GridGeometry(0.05, 0.0, 0.0, 700, 50), masses)
    for name, written in (("dense", grid), ("tiled", TbmGrid(grid.geometry, TiledMasses.of(masses)))):
        write_map_file(tmp_path / f"{name}.npz", TbmMap(written))
    assert (tmp_path / "dense.npz").read_bytes() == (tmp_path / "tiled.npz").read_bytes()
    arrays = dict(np.load(tmp_path / "dense.npz"))
    np.testing.assert_array_equal(arrays["masses"], masses)
    assert read_map_file(tmp_path / "dense.npz").grid.masses.tobytes() == masses.tobytes()
    write_npz(tmp_path / "plain.npz", arrays)  # as numpy writes an array
    assert (tmp_path / "plain.npz").read_bytes() == (tmp_path / "dense.npz").read_bytes()
    write_npz(tmp_path / "columns.npz", {**arrays, "masses": np.asfortranarray(masses)})
    assert read_map_file(tmp_path / "columns.npz").grid.masses.tobytes() == masses.tobytes()


def test_numpy_alone_can_use_it(tbm_map, tmp_path):
    arrays = arrays_of(tbm_map, tmp_path / "map.npz")
    assert arrays["format_version"] == 1
    assert arrays["masses"].shape == (6, 9, 4)
    assert arrays["drives"].tolist() == ["robot_0", "röbot/1"]


def test_what_is_no_belief_is_not_written(tbm_map, tmp_path):
    tbm_map.grid.masses[2, 2] = 0.5
    with pytest.raises(ValueError, match="tbm_map must hold beliefs: the masses of a cell miss the sum of 1 by 1"):
        write_map_file(tmp_path / "map.npz", tbm_map)
    with pytest.raises(ValueError, match="provenance must be JSON: Object of type set"):
        write_map_file(tmp_path / "map.npz", TbmMap(TbmGrid.unknown(tbm_map.grid.geometry), (), {"a": set()}))
    assert not (tmp_path / "map.npz").exists()


def with_cell(arrays, **masses):
    cell = np.zeros(4, dtype=np.float32)
    for name, value in masses.items():
        cell[{"conflict": CONFLICT, "free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN}[name]] = value
    arrays["masses"][3, 4] = cell


def set_value(name, value):
    return lambda arrays: arrays.update({name: np.asarray(value)})


def moved(name, column, value):
    def damage(arrays):
        arrays[name][-1, column] = value

    return damage


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda arrays: with_cell(arrays, free=1.5, unknown=-0.5), "a mass is -0.5, not zero or more"),
        (lambda arrays: with_cell(arrays, free=math.nan), "a mass is nan"),
        (lambda arrays: with_cell(arrays, free=math.inf), "miss the sum of 1 by inf"),
        (lambda arrays: with_cell(arrays, free=0.5), "miss the sum of 1 by 0.5"),
        (lambda arrays: arrays.pop("masses"), "it has no masses"),
        (lambda arrays: arrays.pop("drive_1_keyframes_beams"), "it has no drive_1_keyframes_beams"),
        (lambda arrays: arrays.update(masses=arrays["masses"].astype(float)), "masses is of type float64, not float32"),
        (set_value("geometry", [0.0, 0.0, 0.0]), "resolution must be positive"),
        (set_value("geometry", [0.05, np.nan, 0.0]), "origin must be finite"),
        (set_value("geometry", [0.05, 0.0]), r"geometry has shape \(2,\), not 3"),
        (set_value("format_version", 2), "is a map of format 2, and this program reads format 1: update"),
        (set_value("format_version", "new"), "format_version is of type <U3, not int64"),
        (set_value("drive_0_stamps", np.full(5, np.nan)), "stamps and poses must be finite"),
        (set_value("drive_0_poses", np.zeros((4, 3))), r"drive_0_poses has shape \(4, 3\), not 5 x 3"),
        (set_value("drive_0_keyframes_offsets", np.array([0, 9, 7])), "offsets must rise"),
        (set_value("drive_0_keyframes_indices", np.array([1, 5])), "among the 5 poses of the trajectory, got index 5"),
        (set_value("drive_0_keyframes_indices", np.array([1, 1])), "indices into the trajectory must rise"),
        (set_value("drive_0_keyframes_indices", np.array([1.0, 2.0])), "indices is of type float64, not int64"),
        (moved("drive_0_poses", 0, 1e9), "a pose lies at 1e[+]09, .* m, more than 10000 m from the map"),
        (moved("drive_0_keyframes_poses", 1, -2e4), "a keyframe lies at .*, -2e[+]04 m, more than 10000 m from the"),
        (moved("drive_0_keyframes_poses", 2, 1e17), "an angle is 1e[+]17 rad, more than 1000"),
        (
            moved("drive_0_keyframes_sensor_poses", 0, 1e9),
            "a laser of the robot lies at 1e[+]09, 0 m, more than 1000 m",
        ),
        (moved("drive_0_keyframes_beam_steps", 1, 1e9), "a beam of the robot lies at 0, 1e[+]09 m, more than 1000 m"),
        (moved("drive_0_motions_steps", 1, 1e9), "a step of the robot is .*, 1e[+]09 m, more than 10000 m"),
        (moved("drive_0_motions_steps", 2, 1e9), "an angle is 1e[+]09 rad, more than 1000"),
        (moved("drive_0_closure_motions_steps", 0, 2e4), "a step of the robot is 2e[+]04, .* m, more than 10000 m"),
        (set_value("drive_0_closures", np.zeros((0, 2), np.int64)), "one motion for each of the 0 closures, got 1"),
        (moved("drive_0_keyframes_beams", 1, -1e6), "an angle is 1e[+]06 rad"),
        (
            lambda arrays: arrays["drive_0_keyframes_ranges"].put(3, 3e38),
            "a beam is 3e[+]38 m long, more than 10000 m",
        ),
        (lambda arrays: arrays["drive_0_keyframes_ranges"].put(3, -np.inf), "ranges must not be negative"),
        (set_value("provenance", "{"), "Expecting property name"),
        (set_value("provenance", "[1]"), "provenance is no JSON object"),
        (set_value("provenance", "[" * 200_000), "recursion"),
        (set_value("masses", np.zeros((0, 9, 4), np.float32)), "0 x 9 cells is empty"),
    ],
)
def test_an_invalid_map_is_reported_in_one_line(tbm_map, tmp_path, damage, message):
    path = tmp_path / "map.npz"
    arrays = arrays_of(tbm_map, path)
    damage(arrays)
    write_npz(path, arrays)
    with pytest.raises(MapFileError, match=message) as caught:
        read_map_file(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_size_beyond_belief_is_refused_before_memory_is_taken(tbm_map, tmp_path, monkeypatch):
    write_map_file(tmp_path / "map.npz", tbm_map)
    monkeypatch.setattr(ArrayZip, "shape", lambda *_: (40_000, 40_000, 4))
    with pytest.raises(MapFileError, match="40000 x 40000 cells are more than"):
        read_map_file(tmp_path / "map.npz")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "map.npz").write_bytes(b"nothing of the kind")
    with pytest.raises(MapFileError, match=r"map\.npz: is not a map of tbmslam, or is damaged: it is no zip file"):
        read_map_file(tmp_path / "map.npz")
    with pytest.raises(MapFileError, match=r"none\.npz: .*cannot be read \(No such file"):
        read_map_file(tmp_path / "none.npz")
