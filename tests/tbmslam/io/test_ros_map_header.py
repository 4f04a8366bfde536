import math

import pytest

from tbmslam.io.map_folder import files_of_map
from tbmslam.io.ros_map import read_ros_map, read_ros_map_header
from tbmslam.map.map_check import MapFileError

GOOD = {
    "image": "map.pgm",
    "resolution": "0.050000",
    "origin": "[-10.0, -12.5, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


def header_of(tmp_path, **changes):
    values = {key: value for key, value in {**GOOD, **changes}.items() if value is not None}
    (tmp_path / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    return read_ros_map_header(tmp_path / "map.yaml")


def test_what_map_saver_writes(tmp_path):
    header = header_of(tmp_path)
    assert header.image == tmp_path / "map.pgm"
    assert header.resolution == 0.05
    assert header.T_map_image == (-10.0, -12.5, 0.0)
    assert (header.pixels.negate, header.pixels.free_threshold, header.pixels.occupied_threshold) == (
        False,
        0.196,
        0.65,
    )
    assert header.pixels.mode == "trinary"


def test_what_people_write(tmp_path):
    header = header_of(
        tmp_path, negate="true", mode="scale", resolution="5e-2", origin="\n- 1\n- 2\n- 7", image="a/../b/m.png"
    )
    assert header.pixels.negate
    assert header.pixels.mode == "scale"
    assert header.resolution == 0.05
    assert header.T_map_image == pytest.approx((1.0, 2.0, 7.0 - 2.0 * math.pi))
    assert header.image == tmp_path / "b" / "m.png"


def test_an_absolute_path_into_the_folder_is_taken(tmp_path):
    assert header_of(tmp_path, image=str(tmp_path / "m.pgm")).image == tmp_path / "m.pgm"


def test_a_relative_path_to_the_yaml_is_kept(tmp_path, monkeypatch):
    header_of(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert str(read_ros_map_header((tmp_path / "map.yaml").relative_to(tmp_path)).image) == "map.pgm"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *(({key: None}, f"lacks {key}: add it") for key in GOOD),
        ({"resolution": "0"}, "the resolution must be positive, got 0.0"),
        ({"resolution": "-1"}, "the resolution must be positive, got -1.0"),
        (
            {"resolution": "5"},
            "cells of 5 m are too large for walls: the resolution is in metres, 0.05 for 5 cm: correct it",
        ),
        ({"resolution": ".nan"}, "resolution must hold finite numbers, got nan"),
        ({"resolution": "fine"}, "resolution must hold finite numbers, got 'fine'"),
        ({"resolution": "true"}, "resolution must hold finite numbers, got True"),
        ({"origin": "[0, 0]"}, r"origin must be \[x, y, yaw\], it is \[0, 0\]"),
        ({"origin": "0"}, r"origin must be \[x, y, yaw\], it is 0"),
        ({"origin": "[0, 0, 1e300]"}, r"the yaw of 1e\+300 rad in origin is too large: correct it"),
        ({"origin": "[0, 0, .nan]"}, "origin must hold finite numbers, got nan"),
        ({"origin": "[0, .inf, 0]"}, "origin must hold finite numbers, got inf"),
        ({"negate": "2"}, "negate must be 0 or 1, it is 2"),
        ({"negate": "[]"}, r"negate must be 0 or 1, it is \[\]"),
        ({"mode": "fancy"}, "mode must be trinary, scale or raw, it is 'fancy'"),
        ({"mode": "{}"}, "mode must be trinary, scale or raw"),
        ({"alpha": "0.5"}, "alpha must be unknown or average, it is 0.5: correct it"),
        ({"free_thresh": "0.7"}, "thresholds must be 0 <= free_thresh < occupied_thresh <= 1, they are 0.7 and 0.65"),
        ({"occupied_thresh": "65"}, "thresholds must be"),
        ({"image": "''"}, "image must name a file, it is ''"),
        ({"image": "[a]"}, r"image must name a file, it is \['a'\]"),
        ({"image": "../other/map.pgm"}, "the image '../other/map.pgm' lies outside the yaml's folder: copy it"),
        ({"image": "a/../../map.pgm"}, "lies outside the yaml's folder"),
        ({"image": "/etc/passwd"}, "lies outside the yaml's folder"),
        ({"image": "{"}, "is no yaml file"),
        ({"image": "!!python/object/apply:os.system [ls]"}, r"is no yaml file \(could not determine a constructor"),
        ({"image": "[" * 500}, "is no yaml file"),
        ({"more": "x" * 70_000}, "is no yaml file of a ROS map"),
    ],
)
def test_an_invalid_header_is_reported_in_one_line(tmp_path, changes, message):
    with pytest.raises(MapFileError, match=message) as caught:
        header_of(tmp_path, **changes)
    assert str(caught.value).startswith(f"{tmp_path / 'map.yaml'}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"- 1\n", b"\xff\xfe\x00", b"just text"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "map.yaml").write_bytes(content)
    with pytest.raises(MapFileError, match="is no yaml file"):
        read_ros_map_header(tmp_path / "map.yaml")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.yaml: cannot be read: No such file"):
        read_ros_map_header(tmp_path / "none.yaml")


@pytest.mark.parametrize("name", ["/home/robot/maps/hall.pgm", "../elsewhere/hall.pgm", "C:\\maps\\hall.pgm"])
def test_a_picture_of_another_machine_is_the_one_beside(tmp_path, caplog, name):
    folder = tmp_path / "maps"
    folder.mkdir()
    text = f"image: {name}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    (folder / "hall.yaml").write_text(text)
    with pytest.raises(MapFileError, match="lies outside the yaml's folder: copy it beside it"):
        read_ros_map_header(folder / "hall.yaml")
    (folder / "hall.pgm").write_bytes(b"P5 1 1 255 0")
    assert read_ros_map_header(folder / "hall.yaml").image == folder / "hall.pgm"
    assert files_of_map(folder / "hall.yaml") == [folder / "hall.yaml", folder / "hall.pgm"]
    assert not caplog.messages
    read_ros_map(folder / "hall.yaml")
    assert caplog.messages[:1] == [
        f"{folder / 'hall.yaml'}: the image {name!r} lies outside its folder: hall.pgm beside it is read"
    ]


@pytest.mark.parametrize("name", ["hall.pgm", "a\\hall.pgm", ".\\a\\hall.pgm", "odd\\name.pgm"])
def test_a_relative_path_of_windows_is_read(tmp_path, caplog, name):
    (tmp_path / "a").mkdir()
    file = tmp_path / {"hall.pgm": name, "odd\\name.pgm": name}.get(name, "a/hall.pgm")
    file.write_bytes(b"P5 1 1 255 0")
    header = header_of(tmp_path, image=name)
    assert header.image == file
    read_ros_map(tmp_path / "map.yaml")
    assert "lies outside" not in caplog.text
