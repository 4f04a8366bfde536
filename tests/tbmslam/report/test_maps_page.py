import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.maps_page import MappedRobot, joined_warnings, maps_page
from tbmslam.report.page import RunInfo
from tests.warnings_page import is_explained


def robot(run=None):
    poses = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    drive = Drive("robot_0", Trajectory(np.array([10.0, 12.0]), poses), Keyframes.from_scans([], [], []))
    grid = TbmGrid.unknown(GridGeometry(0.5, 0.0, 0.0, 4, 4))
    grid.masses[0, 0] = (0.0, 1.0, 0.0, 0.0)
    return MappedRobot(TbmMap(grid, (drive,)), run or {})


RUN = {
    "recording": {"name": "monday"},
    "counts": {"scans_read": 7},
    "warnings": ["5 of 7 scans were dropped: empty"],
    "versions": {"python": "3.11"},
    "config": {"map": {"resolution": 0.5}},
    "result": {"correction_m": 2.5},
}


def test_every_robot_has_a_sheet_a_row_and_its_warnings():
    page = maps_page({"a": robot(RUN), "b": robot()}, RunInfo("build_maps x", {"mapping": 1.0}))
    assert [sheet.title for sheet in page.sheets] == ["a", "b"]
    assert page.tables[0].rows[0] == ["a", "monday", "2", "7", "0", "5.0", "2.0", "0", "2.500", "0.2", "0.5"]
    assert page.tables[0].rows[1][:4] == ["b", "–", "2", "–"]
    assert page.warnings == [
        "a: 5 of 7 scans were dropped: empty",
        "a: closing loops moved the drive by up to 2.5 m, because it had drifted",
        "a, b: no loop was closed in 5 m, so the drift of the drive is unknown",
    ]
    assert page.verdict == "2 maps were made, each in its own frame"
    assert (page.command, page.versions, page.config) == ("build_maps x", RUN["versions"], RUN["config"])
    assert page.figures["driven"] == "10 m"
    assert [[track.label for track in sheet.tracks] for sheet in page.sheets] == [["robot_0"], ["robot_0"]]


def test_files_are_offered_of_the_robots_that_are_shown():
    files = {f"robot_{k}": [f"robot_{k}/map.yaml"] for k in range(40)}
    page = maps_page({"robot_0": robot()}, RunInfo(), files=files)
    assert list(page.downloads) == list(files)[:30]
    assert '<a href="robot_7/map.yaml" download>map.yaml</a>' in page.to_html()


def test_equal_warnings_of_many_robots_are_joined():
    page = maps_page({f"robot_{k}": robot({"warnings": ["odd", "odd"] if k else ["odd"]}) for k in range(7)}, RunInfo())
    named = "robot_0, robot_1, robot_2, robot_3, robot_4 and 2 more"
    no_loop = "no loop was closed in 5 m, so the drift of the drive is unknown"
    assert page.warnings == [f"{named}: odd", f"{named}: {no_loop}"]


def test_coarser_cells_cause_a_warning():
    said, other = robot({"config": {"map": {"resolution": 0.25}}}).warnings()
    assert said == "the map is so large that its cells are 0.5 m and not 0.25 m"
    assert is_explained(said)
    assert is_explained(other)


def test_all_maps_are_listed_and_the_first_are_shown():
    page = maps_page({f"robot_{k}": robot() for k in range(40)}, RunInfo())
    assert len(page.sheets) == 30
    assert len(page.tables[0].rows) == 40
    assert "Only the first 30 of 40 maps are shown above." in page.tables[0].note


def test_unexpected_entries_of_a_run_are_ignored():
    odd = robot({"warnings": 3, "counts": "many", "result": None, "versions": [], "config": 1})
    assert "1 map was made" in maps_page({"a": odd}, RunInfo()).to_html()


def test_equal_warnings_are_joined_with_the_names():
    told = {"a": ["at 1.0 s: jumps", "odd"], "b": ["at 2.0 s: jumps"], "c": ["odd", "odd"]}
    assert joined_warnings(told) == ["a: at 1.0 s: jumps", "a, c: odd", "b: at 2.0 s: jumps"]
    assert joined_warnings({"a": []}) == []


def test_of_many_the_first_are_named():
    assert joined_warnings({name: ["odd"] for name in "abcdefg"}) == ["a, b, c, d, e and 2 more: odd"]
    assert joined_warnings({name: ["odd"] for name in "abcde"}) == ["a, b, c, d, e: odd"]


def test_what_happened_again_and_again_is_one_line_with_its_times():
    jumps = [f"at {at:.1f} s: the odometry jumps, for {0.1 * at:.1f} s: beware" for at in range(1, 9)]
    said = joined_warnings({"a": [*jumps, "at 3.0 s: no scans", "odd"], "b": jumps[:2]})
    assert said == [
        "a: at 1.0, 2.0, 3.0, 4.0, 5.0 s and 3 more times: the odometry jumps: beware",
        "a: at 3.0 s: no scans",
        "a: odd",
        "b: at 1.0, 2.0 s: the odometry jumps: beware",
    ]


def test_areas_of_maps_that_may_overlap_are_not_added_up():
    one, two = maps_page({"a": robot()}, RunInfo()).figures, maps_page({"a": robot(), "b": robot()}, RunInfo()).figures
    assert two["known area of a map"] == one["known area"]
