"""Problems that users of other programs reported, tried on whole programs."""

import json
import math

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import building_of_world
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_folder import load_map
from tbmslam.io.ros_map import write_ros_map
from tbmslam.map.tbm_map import TbmMap
from tests.datasets.conftest import BagScript
from tools import build_maps
from tools import merge as merge_program
from tools.map_pairs.floors import pairs_of

ROUND_ROOM = np.full(180, 3.0)


def mapped_by_the_program(tmp_path, script):
    """Map 3 s of scans in a room, and what else is in the script; return the run's record."""
    for k in range(30):
        script.scan(99.0 + 0.1 * k, ROUND_ROOM, angle_min=-math.pi, step=2.0 * math.pi / 180)
    bag = script.in_time_order().write(tmp_path / "run.bag")
    assert build_maps.main([str(bag), "-o", str(tmp_path / "maps"), "--no-truth"]) == 0
    return json.loads((tmp_path / "maps" / "run" / "run.json").read_text())


def test_scans_before_the_first_transform_are_reported(tmp_path, capsys):
    script = BagScript().tf(98.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    run = mapped_by_the_program(tmp_path, script)
    assert run["counts"]["dropped"] == {"before_odometry": 10}
    assert run["counts"]["scans_used"] == 20
    assert "20 of 30 scans used, dropped: 10 before_odometry" in capsys.readouterr().out


def test_scans_after_the_last_transform_are_mapped_and_reported_with_the_time(tmp_path, capsys):
    run = mapped_by_the_program(
        tmp_path, BagScript().tf(98.0, "base_link", "laser", topic="/tf_static").drive(98.0, 101.0)
    )
    assert run["counts"]["scans_used"] == 30
    assert "8 scans had no odometry, so scan matching alone estimated the motion" in run["warnings"]
    # The wheels turn before a wall that comes no nearer, which is told as well.
    (incident,) = (
        one for one in run["incidents"] if one["what"] == "no odometry: scan matching alone estimates the motion"
    )
    assert incident["at_s"] == pytest.approx(2.2, abs=0.1)
    assert (
        "odd: 2 scans are beyond the odometry, at its end or at a long gap: it was extrapolated; 8 scans had no"
        in capsys.readouterr().out
    )


def test_without_any_transform_the_error_names_what_is_missing(tmp_path, caplog):
    run = mapped_by_the_program(tmp_path, BagScript())
    assert run["counts"]["scans_used"] == 30
    assert "run.bag: neither tf nor a topic holds usable odometry; continuing without it" in caplog.text
    mount = "tf does not hold the mount of the laser (frame 'laser'); the default is the robot's centre"
    assert f"{mount}: pass --sensor-pose, and --upside-down if it hangs upside down" in caplog.text


def test_large_maps_with_distant_frames_merge_correctly(tmp_path):
    pair = next(iter(pairs_of([building_of_world("apartment", 3)], 1, [0.75])))
    side, corners, origins = 2000, ((1400, 20), (30, 1400)), ((4000.0, -7000.0), (-900.0, 100.0))
    places = []
    for name, occupancy, (row, col), origin in zip("ab", (pair.occ_a, pair.occ_b), corners, origins, strict=True):
        seen = TbmMap.from_occupancy(occupancy, pair.resolution).grid
        large = TbmGrid.unknown(GridGeometry(pair.resolution, *origin, side, side))
        large.masses[row : row + seen.geometry.rows, col : col + seen.geometry.cols] = seen.masses
        write_ros_map(tmp_path / f"{name}.yaml", large)
        places.append(SE2(origin[0] + col * pair.resolution, origin[1] + row * pair.resolution, 0.0))
    assert (
        merge_program.main([str(tmp_path / name) for name in ("a.yaml", "b.yaml")] + ["-o", str(tmp_path / "m")]) == 0
    )
    poses = json.loads((tmp_path / "m" / "report.json").read_text())["maps"]
    middle = places[1].apply([10.0, 10.0])
    expected = places[0] @ pair.T_a_b @ places[1].inverse()
    assert math.dist(SE2(*poses["b"]["T_merged_map"]).apply(middle), expected.apply(middle)) < 0.1

    first, merged = (load_map(tmp_path / name).grid for name in ("a.yaml", "m/map.yaml"))
    walls = np.argwhere(first.masses[..., OCCUPIED] > first.masses[..., FREE])
    occupied = merged.masses[..., OCCUPIED] > merged.masses[..., FREE]
    cells = [merged.geometry.cell_at(*first.geometry.centre_of(*wall)) for wall in walls.tolist()]
    assert np.mean([occupied[row - 1 : row + 2, col - 1 : col + 2].any() for row, col in cells]) > 0.8
