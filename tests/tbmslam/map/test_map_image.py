import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest

from tbmslam.map.map_check import MapFileError
from tbmslam.map.map_image import encode_pgm, read_image

PIXELS = np.arange(6, dtype=np.uint8).reshape(2, 3)


def image_of(tmp_path, content, name="map.pgm"):
    (tmp_path / name).write_bytes(content)
    return read_image(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "maximum"),
    [
        (b"P5\n3 2\n255\n\0\1\2\3\4\5", 255),
        (b"P5 3 2 255 \0\1\2\3\4\5", 255),
        (b"P5\n# CREATOR: map_saver 0.050 m/pix\n3 2\n255\n\0\1\2\3\4\5", 255),
        (b"P5\n3 # wide\n# high\n2\n# white\n100\n\0\1\2\3\4\5trailing", 100),
        (b"P5\r\n3 2\r100\n\0\1\2\3\4\5", 100),
        (b"P5 3 2 1000\n\0\0\0\1\0\2\0\3\0\4\0\5", 1000),
        (b"P2\n3 2\n255\n0 1 2\n3 4 5\n", 255),
        (b"P2 # text\n3 2 15\n0 1 2 # first row\n3 4\n5", 15),
    ],
)
def test_every_kind_of_pgm(tmp_path, content, maximum):
    image = image_of(tmp_path, content)
    assert image.maximum == maximum
    assert image.alpha is None
    np.testing.assert_array_equal(image.pixels[..., 0], PIXELS)


def test_pixels_with_the_codes_of_spaces_or_comments_are_pixels(tmp_path):
    pixels = np.array([[ord("\n"), ord("#")], [ord(" "), ord("1")]], dtype=np.uint8)
    np.testing.assert_array_equal(image_of(tmp_path, encode_pgm(pixels)).pixels[..., 0], pixels)


def test_opencv_reads_what_is_written(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, size=(17, 23), dtype=np.uint8)
    (tmp_path / "map.pgm").write_bytes(encode_pgm(pixels))
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED), pixels)


@pytest.mark.parametrize(
    ("channels", "dtype"), [(1, "uint8"), (3, "uint8"), (4, "uint8"), (1, "uint16"), (4, "uint16")]
)
def test_every_kind_of_png(tmp_path, channels, dtype):
    maximum = int(np.iinfo(dtype).max)
    pixels = np.random.default_rng(0).integers(0, maximum + 1, size=(5, 7, channels), dtype=dtype)
    image = image_of(tmp_path, cv2.imencode(".png", pixels)[1].tobytes(), "map.png")
    np.testing.assert_array_equal(image.pixels, pixels)
    assert image.maximum == maximum
    assert (image.alpha is None) == (channels != 4)
    sums, white = image.channel_sum(with_alpha=False)
    np.testing.assert_array_equal(sums, pixels[..., :3].astype(int).sum(axis=-1))
    assert white == maximum * min(channels, 3)
    np.testing.assert_array_equal(image.channel_sum(with_alpha=True)[0], pixels.astype(int).sum(axis=-1))


PNG = cv2.imencode(".png", PIXELS)[1].tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the map.s image is empty: name a picture"),
        (b"no picture", "cannot be decoded"),
        (b"P5\n3 2\n", "has no PGM header"),
        (b"P5\n3 x\n255\n", "has no PGM header"),
        (b"P5\n3 2\n0\n\0\0\0\0\0\0", "maximum must be 1 to 65535, got 0"),
        (b"P5\n3 2\n65536\n\0\0\0\0\0\0", "maximum must be 1 to 65535, got 65536"),
        (b"P5\n3 2\n255\n\0\1\2\3\4", "ends after 5 of 6 pixels"),
        (b"P5\n3 2\n256\n\0\1\2\3\4\5", "ends after 3 of 6 pixels"),
        (b"P2\n3 2\n255\n0 1 2 3 4", "ends after 5 of 6 pixels"),
        (b"P2\n3 2\n255\n0 1 2 3 4 five", "holds text that is no number"),
        (b"P2\n3 2\n255\n0 1 2 3 4 -5", "holds text that is no number"),
        (b"P5\n0 2\n255\n", "2 x 0 cells is empty"),
        (b"P5\n60000 60000\n255\n\0", "60000 x 60000 cells are more than"),
        (PNG[:45] + b"x" + PNG[46:], "is damaged or cut off"),
        (PNG[:-7], "is damaged or cut off"),
        (PNG[:40], "is damaged or cut off"),
        (PNG[:16] + (60000).to_bytes(4, "big") * 2 + PNG[24:], "60000 x 60000 cells are more than"),
        (
            cv2.imencode(".tiff", PIXELS.astype(np.float32))[1].tobytes(),
            "has float32 pixels: save it with 8 or 16 bits",
        ),
    ],
)
def test_an_invalid_picture_is_reported_in_one_line(tmp_path, content, message, capfd):
    with pytest.raises(MapFileError, match=message) as caught:
        image_of(tmp_path, content)
    assert str(caught.value).startswith(f"{tmp_path / 'map.pgm'}: ")
    assert "\n" not in str(caught.value)
    assert not capfd.readouterr().err


def test_a_missing_picture_is_named(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.pgm: the map's image cannot be read: No such file"):
        read_image(tmp_path / "none.pgm")


def test_a_device_in_the_place_of_a_picture_is_not_read(tmp_path):
    for name, target in (("endless.pgm", Path("/dev/zero")), ("folder.pgm", tmp_path)):
        (tmp_path / name).symlink_to(target)
        with pytest.raises(
            MapFileError, match=r"the map's image is (no file but a folder|a device or a pipe): name a picture"
        ):
            read_image(tmp_path / name)


def test_the_size_is_looked_at_before_a_huge_file_is_read(tmp_path):
    with (tmp_path / "map.pgm").open("wb") as file:
        file.write(b"P5\n60000 60000\n255\n")
        file.truncate(3_600_000_019)  # a hole
    tracemalloc.start()
    with pytest.raises(MapFileError, match="60000 x 60000 cells are more than"):
        read_image(tmp_path / "map.pgm")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_a_file_that_does_not_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tbmslam.map.map_image._MOST_BYTES", 1000)
    (tmp_path / "map.bmp").write_bytes(bytes(70_000))
    with pytest.raises(MapFileError, match=r"map\.bmp: the map's image is larger than 1 GB: crop it"):
        read_image(tmp_path / "map.bmp")
