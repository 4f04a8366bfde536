"""What both programs write, read by the tools that others use."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from datasets import RecordingOptions, open_recording
from tbmslam.io.map_folder import load_map
from tbmslam.io.trajectory_file import read_tum
from tests.end_to_end.programs import merge_maps
from tests.processes import python

pytestmark = pytest.mark.xdist_group("flat")

SCANS_BY_ROS = """
import json, sys, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    found = bag.get_type_and_topic_info().topics
    print(json.dumps({topic: [info.msg_type, info.message_count] for topic, info in found.items()}))
    for _, scan, _ in bag.read_messages("/base_scan"):
        print(json.dumps([scan.header.stamp.to_sec(), scan.angle_min, scan.angle_increment, sum(scan.ranges)]))
"""


@pytest.fixture(scope="module")
def merged(flat_maps, tmp_path_factory):
    folder = tmp_path_factory.mktemp("merged")
    merge_maps(folder, flat_maps / "robot_0", flat_maps / "robot_1", "--geotiff", "--occupancy-bag")
    return folder


RUNS_OF_EVO = """
import json, runpy, sys
program, *lines = sys.argv[1:]
for line in lines:
    sys.argv = [program, *json.loads(line)]
    try:
        runpy.run_path(program, run_name="__main__")
    except SystemExit as left:
        assert not left.code, left.code
"""


def run_evo(*lines, home):
    """Run evo as a program, once for each line: its licence and its settings stay outside. It takes seconds to load."""
    tool = Path(sys.executable).with_name("evo_traj")
    if not tool.exists():
        pytest.skip("evo is not installed")
    words = [json.dumps([*map(str, line)]) for line in lines]
    done = python("-c", RUNS_OF_EVO, tool, *words, HOME=str(home), MPLBACKEND="Agg")
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_evo_reads_the_trajectories_and_draws_them_on_the_map(merged, tmp_path):
    ways = [merged / f"trajectory_robot_{k}.tum" for k in range(2)]
    on_the_map = ("--full_check", "--ros_map_yaml", merged / "map.yaml")
    said = run_evo(
        ("tum", *ways, *on_the_map, "--plot_mode", "xy", "--save_plot", tmp_path / "plot.png"),
        ("tum", *ways, "--plot_mode", "xy", "--save_plot", tmp_path / "bare.png"),
        home=tmp_path,
    )
    trajectories = [read_tum(way) for way in ways]
    assert re.findall(r"nr\. of poses\t(\d+)", said) == [str(len(one)) for one in trajectories]
    lengths = [float(text) for text in re.findall(r"path length \(m\)\t([\d.]+)", said)]
    assert lengths == pytest.approx([one.length() for one in trajectories], rel=1e-6)
    for check in ("SE(3) conform\tyes", "timestamps\tok", "quaternions\tok"):
        assert said.count(check) == 2
    # The map's black walls are on the plot of the trajectories: without it there is hardly any black but for letters.
    dark, bare = (
        int((cv2.imread(str(tmp_path / f"{name}_trajectories.png"), cv2.IMREAD_GRAYSCALE) < 60).sum())
        for name in ("plot", "bare")
    )
    assert dark > bare + 500


@pytest.mark.skipif(shutil.which("rosbag") is None, reason="ROS 1's own rosbag is not installed")
def test_the_genuine_rosbag_reads_every_scan_of_a_simulated_bag(flat):
    command = ["/usr/bin/python3", "-c", SCANS_BY_ROS, str(flat / "robot_0.bag")]
    done = subprocess.run(command, capture_output=True, check=True, text=True, timeout=120, env={})  # noqa: S603 - ROS's
    lines = done.stdout.splitlines()
    topics, scans = json.loads(lines[0]), [json.loads(line) for line in lines[1:]]
    assert topics["/base_scan"] == ["sensor_msgs/LaserScan", len(scans)]
    assert topics["/tf"][0] == "tf/tfMessage"
    assert topics["/base_odometry/odom"][0] == "nav_msgs/Odometry"
    ours = [reading.scan for reading in open_recording([flat / "robot_0.bag"], RecordingOptions())]
    assert len(scans) == len(ours)
    assert [scan[0] for scan in scans] == pytest.approx([scan.stamp for scan in ours])
    for (_, angle_min, angle_increment, total), scan in zip(scans[:50], ours, strict=False):
        assert (angle_min, angle_increment) == pytest.approx((scan.angle_min, scan.angle_increment), abs=1e-6)
        if scan.is_hit().all():
            assert total == pytest.approx(scan.ranges.sum(), rel=1e-6)


def test_rasterio_finds_the_walls_where_the_map_has_them(merged):
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    grid = load_map(merged).grid
    rows, cols = np.nonzero(grid.masses[..., 2] > 0.5)
    some = slice(None, None, 97)
    places = [grid.geometry.centre_of(int(row), int(col)) for row, col in zip(rows[some], cols[some], strict=True)]
    with rasterio.open(merged / "map.tif") as tiff, rasterio.open(merged / "pignistic.png") as picture:
        occupied = tiff.descriptions.index("occupied")
        assert min(values[occupied] for values in tiff.sample(places)) > 0.5
        assert max(values[0] for values in picture.sample(places)) < 128


def test_files_of_an_earlier_run_are_written_again(merged, flat_maps, tmp_path):
    shutil.copytree(merged, tmp_path / "again")
    assert {"map.tif", "map.bag"} <= {path.name for path in (tmp_path / "again").iterdir()}
    merge_maps(tmp_path / "again", flat_maps / "robot_0", flat_maps / "robot_1", "--occupancy-bag", "mcap")
    names = {path.name for path in (tmp_path / "again").iterdir()}
    assert {"map.tif", "map.bag", "map.mcap"} <= names
