import numpy as np

from merging.report.provenance import incidents_of, warnings_of
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import Drive, TbmMap

JUMPED = [{"stamp": 1.0, "what": "the odometry jumps"}]
LOST = [{"stamp": 2.0, "what": "lost"}]
ONE = {"warnings": ["a gap"], "incidents": JUMPED}
OTHER = {"warnings": [], "incidents": LOST}


def map_of(drives: int, provenance: dict[str, object]) -> TbmMap:
    way = Trajectory(np.array([0.0]), np.zeros((1, 3)))
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 2, 2))
    return TbmMap(grid, (Drive("robot", way, Keyframes.from_scans([], [], [])),) * drives, provenance)


def part(drives: int, provenance: dict[str, object]) -> dict[str, object]:
    return {"pose": [0.0, 0.0, 0.0], "drives": drives, "provenance": provenance}


def test_each_drive_of_a_merge_keeps_its_trouble():
    two = {"merged_from": {"a": part(1, ONE), "plan": part(0, {"read_from": "plan.yaml"}), "b": part(1, OTHER)}}
    assert incidents_of(map_of(2, two)) == [JUMPED, LOST]
    again = {"merged_from": {"c": part(1, OTHER), "ab": part(2, two)}}
    assert incidents_of(map_of(3, again)) == [LOST, JUMPED, LOST]
    assert warnings_of(again) == ["ab: a: a gap"]


def test_what_befell_several_of_a_merge_is_told_once():
    merged = {"merged_from": {"a": part(1, ONE), "b": part(1, OTHER), "c": part(1, ONE)}}
    assert warnings_of(merged) == ["a, c: a gap"]
    assert warnings_of({"merged_from": {"x": part(3, merged), "y": part(3, merged)}}) == ["x, y: a, c: a gap"]


def test_a_single_drive_has_its_own():
    assert incidents_of(map_of(1, ONE)) == [JUMPED]
    assert incidents_of(map_of(0, ONE)) == []
    assert warnings_of(ONE) == ["a gap"]


def test_where_nobody_wrote_whose_it_was_nothing_is_told():
    before = {name: {"pose": [0.0, 0.0, 0.0], "provenance": ONE} for name in "ab"}
    assert incidents_of(map_of(2, {"merged_from": before})) == [None, None]
    assert incidents_of(map_of(2, {"merged_from": {"a": 3, "b": {"provenance": []}}})) == [None, None]
    assert incidents_of(map_of(2, {"merged_from": {"a": part(-1, ONE), "b": part(3, ONE)}})) == [None, None]
