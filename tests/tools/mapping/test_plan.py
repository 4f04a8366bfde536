from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.mapping.plan import robot_names, safe_name


@pytest.mark.parametrize(
    ("recordings", "names"),
    [
        (
            ("week/monday.bag", "week/tuesday.mcap", "drive.log.gz", "d/run.bag.active"),
            ("monday", "tuesday", "drive", "run"),
        ),
        (("ros2/2011-01-28", "x/metadata"), ("2011-01-28", "metadata")),
        (("north/run.bag", "south/run.bag", "c.bag"), ("north_run", "south_run", "c")),
        (("north/Run.bag", "south/run.bag"), ("north_Run", "south_run")),
        (("a/run.bag", "a/run.log", "a/run.clf"), ("a_run", "a_run-2", "a_run-3")),
        (("a b/ü & $HOME.bag", "...bag", "truth.json.bag", ".hidden.bag"), ("ü_HOME", "robot", "truth_json", "hidden")),
        (("CON.bag", "lpt1.bag", "com¹.bag", "console.bag"), ("robot_CON", "robot_lpt1", "robot_com¹", "console")),
        (("-x.bag",), ("robot_-x",)),
    ],
)
def test_robots_are_named_after_their_files(recordings, names):
    assert tuple(robot_names([Path(one) for one in recordings])) == names


@given(st.lists(st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1), max_size=6))
def test_names_are_safe_and_differ(texts):
    names = robot_names([Path("in", text) for text in texts])
    assert len({name.casefold() for name in names}) == len(texts)
    for name in names:
        assert name == safe_name(name) or name.rpartition("-")[2].isdigit()
        assert 0 < len(name.encode()) < 255
        assert not set(name) & set('./\\:*?"<>| ')
