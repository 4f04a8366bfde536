import base64
import io

import numpy as np
import pytest
from PIL import Image

from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.report.sheet import STEPS, Marks, Palette, Raster, Sheet, Switch, drive_tracks, levels_of

RAMP = Palette.ramp((255, 255, 255), (0, 0, 200), (40, 0, 0), alphas=(0,))


def test_a_ramp_runs_from_its_first_colour_over_the_middle_to_the_last():
    assert len(RAMP.colours) == STEPS + 1
    assert (RAMP.colours[0], RAMP.colours[STEPS // 2], RAMP.colours[-1]) == ((255, 255, 255), (0, 0, 200), (40, 0, 0))


def test_values_are_read_back_from_the_picture():
    values = np.linspace(0.0, 1.0, 63).reshape(7, 9)
    picture = Image.open(io.BytesIO(RAMP.png(levels_of(values))))
    assert (picture.mode, picture.size) == ("P", (9, 7))
    seen = np.asarray(picture.convert("RGBA"))
    levels = [[RAMP.colours.index(tuple(pixel[:3])) for pixel in row] for row in seen.tolist()]
    np.testing.assert_allclose(np.array(levels) / STEPS, values, atol=0.5 / STEPS)
    np.testing.assert_array_equal(seen[..., 3] == 0, np.array(levels) == 0)


def test_equal_colours_are_refused():
    with pytest.raises(ValueError, match="colours must be at most 256 and differ"):
        Palette(((1, 2, 3), (1, 2, 3)))


def test_the_same_levels_give_the_same_bytes():
    levels = np.arange(20, dtype=np.uint8).reshape(4, 5)
    assert RAMP.png(levels) == RAMP.png(levels.copy())


def drive(stamps, poses):
    return Drive("r", Trajectory(np.asarray(stamps, float), np.asarray(poses, float)), Keyframes.from_scans([], [], []))


def stop_and_go():
    """Ten seconds ahead at 1 m/s, ten at rest, a half turn in five, at 20 Hz."""
    stamps = 100.0 + 0.05 * np.arange(501)
    since = stamps - 100.0
    poses = np.column_stack((np.minimum(since, 10.0), np.zeros(501), np.clip((since - 20.0) / 5.0, 0.0, 1.0) * np.pi))
    return drive(stamps, poses)


def test_few_poses_tell_to_a_step_where_the_robot_was_at_every_time():
    one = stop_and_go()
    (track,) = drive_tracks([one], [(1, 2, 3)])
    assert len(track.times) < 300
    assert (track.times[0], track.times[-1]) == (0.0, pytest.approx(25.0))
    since = one.trajectory.stamps - 100.0
    for column, tolerance in ((0, 0.1), (2, 0.2)):
        told = np.interp(since, track.times, track.poses[:, column])
        np.testing.assert_allclose(told, one.trajectory.poses[:, column], atol=tolerance)


def test_long_drives_and_many_of_them_stay_small():
    stamps = np.arange(20_000.0)
    far = drive(stamps, np.column_stack((stamps, stamps, np.zeros_like(stamps))))
    (track,) = drive_tracks([far], [(0, 0, 0)])
    assert 1000 <= len(track.times) <= 2002
    many = drive_tracks([far] * 200, [(0, 0, 0)] * 200)
    assert max(len(one.times) for one in many) <= 102


def test_where_the_clock_stepped_back_scans_are_spread_evenly():
    poses = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))
    (track,) = drive_tracks([drive([10.0, 11.0, 9.0, 12.0, 13.0], poses)], [(0, 0, 0)])
    np.testing.assert_allclose(track.times, [0.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(track.poses[:, 0], np.arange(5.0))


def test_a_drive_of_no_time_has_no_slider():
    assert drive_tracks([drive([], np.zeros((0, 3))), drive([1.0, 1.0], np.zeros((2, 3)))], [(0, 0, 0)] * 2) == ()


def test_rows_are_tenths_of_a_second_centimetres_and_degrees():
    (track,) = drive_tracks([drive([5.0, 7.54], [[0.0, 0.0, 0.0], [1.234, -2.0, 1.5 * np.pi]])], [(1, 2, 3)])
    assert track.as_json() == {"label": "r", "colour": "rgb(1, 2, 3)", "rows": [[0, 0, 0, 0], [25, 123, -200, -90]]}


TWO = Palette(((255, 255, 255), (10, 20, 30)))


def test_a_picture_lies_in_metres_with_y_upwards():
    levels = np.zeros((2, 3), dtype=np.uint8)
    levels[0, 2] = 1  # the cell of the smallest y and the largest x
    said = Raster(Switch("Map", "walls"), GridGeometry(0.5, -1.0, 2.0, 2, 3), levels, TWO, unit=1.0).as_json()
    assert said["bounds"] == [[2.0, -1.0], [3.0, 0.5]]
    png = base64.b64decode(said["image"].removeprefix("data:image/png;base64,"))
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png))), [[0, 0, 0], [0, 0, 1]])
    assert said["colours"] == [[255, 255, 255], [10, 20, 30]]


def test_a_picture_has_the_colour_of_its_robot_in_a_row_of_switches():
    """A map without drives has no other layer with the colour."""
    geometry, levels = GridGeometry(0.5, -1.0, 2.0, 2, 3), np.zeros((2, 3), dtype=np.uint8)
    colours = [
        Raster(switch, geometry, levels, TWO).as_json()["colour"]
        for switch in (Switch("Robots", "plan", "map"), Switch("Map", "walls"))
    ]
    assert colours == ["rgb(10, 20, 30)", None]


def test_points_are_y_and_x_in_millimetres():
    said = Marks(Switch("Robots", "a", "drive"), "line", np.array([[1.23456, -2.0]]), (1, 2, 3)).as_json()
    assert said["points"] == [[-2.0, 1.235]]
    assert (said["kind"], said["label"], said["column"], said["colour"]) == ("line", "a", "drive", "rgb(1, 2, 3)")


def test_a_sheet_lists_its_layers_in_order():
    layers = [Marks(Switch("Robots", name), "dots", np.zeros((0, 2)), (0, 0, 0)) for name in "ab"]
    assert [layer["label"] for layer in Sheet("map", tuple(layers)).as_json()["layers"]] == ["a", "b"]
