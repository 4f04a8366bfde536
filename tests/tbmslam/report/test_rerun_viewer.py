import sys

import numpy as np
import pytest

from tbmslam.report.rerun_viewer import RerunViewer, ViewerError
from tbmslam.slam import Slam


def needs_rerun():
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    return pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read its files")


@pytest.fixture(scope="module")
def watched(drive_in, tmp_path_factory):
    """A drive that was watched into a file, and its map."""
    needs_rerun()
    path = tmp_path_factory.mktemp("watched") / "deep" / "drive.rrd"
    slam, readings = Slam(name="robot_0"), drive_in("apartment", 60.0).readings
    with RerunViewer(path) as viewer:
        for reading in readings:
            viewer.saw("robot_0", reading, slam.process(reading))
        tbm_map = slam.finish()
        viewer.finished("robot_0", tbm_map)
    return path, readings, tbm_map


def columns(path, entity, name):
    """Return the values of one component of an entity, in the order of the recording."""
    found = []
    for chunk in needs_rerun().RrdReader(str(path)).stream():
        if chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            found += [
                (time, value)
                for column in batch.schema.names
                if column == name
                for time, value in zip(
                    batch.column("recording").to_numpy(zero_copy_only=False),
                    batch.column(column).to_pylist(),
                    strict=True,
                )
            ]
    return sorted(found, key=lambda one: one[0])


def test_the_file_holds_scans_map_drive_and_loops(watched):
    path, readings, tbm_map = watched
    rows = {}
    for chunk in needs_rerun().RrdReader(str(path)).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    shown = len({round(reading.scan.stamp, 6) for reading in readings})
    assert rows["/robot_0/robot"] == shown  # five a second, all of them
    assert rows["/robot_0/robot/scan"] == shown + 1  # cleared at the end
    assert rows["/robot_0/map"] == shown // 25 + 1
    assert rows["/robot_0/grid"] == rows["/robot_0/keyframes"] == rows["/robot_0/closures"] == 1
    assert len(tbm_map.drives[0].closures) > 0


def test_positions_can_be_read_back(watched):
    path, _, tbm_map = watched
    drive = tbm_map.drives[0]
    ((_, keyframes),) = columns(path, "/robot_0/keyframes", "Points3D:positions")
    np.testing.assert_allclose(np.array(keyframes)[:, :2], drive.keyframes.poses[:, :2], atol=1e-5)
    _, way = columns(path, "/robot_0/drive", "LineStrips3D:strips")[-1]
    np.testing.assert_allclose(np.array(way[0])[:, :2], drive.trajectory.poses[:, :2], atol=1e-5)
    ((_, corners),) = columns(path, "/robot_0/grid", "Mesh3D:vertex_positions")
    left, bottom, right, top = tbm_map.grid.geometry.bounds()
    np.testing.assert_allclose(np.min(corners, axis=0)[:2], (left, bottom), atol=1e-5)
    np.testing.assert_allclose(np.max(corners, axis=0)[:2], (right, top), atol=1e-5)


def test_the_error_without_rerun_names_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ViewerError, match=r"needs rerun-sdk, which is not installed: pip install 'tbmslam\[viewer\]'"):
        RerunViewer(tmp_path / "a.rrd")


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    needs_rerun()
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ViewerError, match=r"a\.rrd: cannot be written \(.*\): give another file, --viewer FILE\.rrd"):
        RerunViewer(tmp_path / "taken" / "a.rrd")


def test_a_live_viewer_is_started_or_an_error_is_raised(monkeypatch):
    needs_rerun()
    import rerun

    monkeypatch.setenv("DISPLAY", ":0")

    started = []

    def start(stream):
        started.append(stream)

    monkeypatch.setattr(rerun.RecordingStream, "spawn", start)
    with RerunViewer():
        assert len(started) == 1

    def refuse(stream):
        raise RuntimeError("no such program.\nLong advice")

    monkeypatch.setattr(rerun.RecordingStream, "spawn", refuse)
    with pytest.raises(ViewerError, match=r"a viewer cannot be started \(no such program\): give another file"):
        RerunViewer()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is a screen")
def test_without_a_screen_there_is_no_live_viewing(monkeypatch):
    needs_rerun()
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ViewerError, match=r"\(there is no screen here\): give a file, --viewer FILE\.rrd"):
        RerunViewer()


@pytest.mark.parametrize(
    ("said", "told"), [("connection severed\nUnknown error", "connection severed"), ("", "RuntimeError")]
)
def test_a_viewer_that_was_closed_costs_no_map_but_a_file_must_be_whole(monkeypatch, tmp_path, caplog, said, told):
    needs_rerun()
    import rerun

    def severed(stream, timeout_sec):
        raise RuntimeError(said)

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(rerun.RecordingStream, "spawn", lambda _: None)
    monkeypatch.setattr(rerun.RecordingStream, "flush", severed)
    with RerunViewer():
        pass
    assert f"the viewer was closed before the end ({told})" in caplog.text
    viewer = RerunViewer(tmp_path / "a.rrd")
    with pytest.raises(ViewerError, match=rf"a\.rrd: is not complete \({told}\)"), viewer:
        pass
