import math
import tracemalloc

import cv2
import numpy as np
import pytest
import yaml

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tbmslam.io.ros_map import read_ros_map, ros_pixels, write_ros_map
from tbmslam.map.map_check import MapFileError
from tbmslam.map.map_image import MapImage, PixelRule, occupancy_of_image

GEOMETRY = GridGeometry(0.05, -1.0 / 3.0, 1e3 * math.pi, 3, 4)


def grid_of(cells):
    """Fill a grid with (free, occupied) masses from the top row down."""
    grid = TbmGrid.unknown(GEOMETRY._replace(rows=len(cells), cols=len(cells[0])))
    grid.masses[::-1, :, [FREE, OCCUPIED]] = cells
    grid.masses[..., UNKNOWN] = 1.0 - grid.masses[..., FREE] - grid.masses[..., OCCUPIED]
    return grid


def published(pixel, mode="trinary", negate=False, alpha=None, maximum=255, average=False):
    """One pixel as nav2_map_server turns it to occupancy: a plain twin written from map_io.cpp."""
    free, occupied = 0.196, 0.65
    colours = list(pixel) if isinstance(pixel, tuple) else [pixel] * 3
    if mode == "trinary" and alpha is not None and average:
        colours.append(alpha)
    shade = sum(colours) / len(colours) / maximum
    if mode == "raw":
        percent = math.floor(shade * 255 + 0.5)
        return percent if 0 <= percent <= 100 else -1
    p = shade if negate else 1.0 - shade
    if (mode == "scale" or not average) and alpha is not None and alpha != maximum:
        return -1
    if p > occupied + 1e-12:
        return 100
    if p < free - 1e-12:
        return 0
    return -1 if mode == "trinary" else round((p - free) / (occupied - free) * 100.0)


def read_by_rules(pixels, mode, negate, maximum=255, alpha="unknown"):
    return occupancy_of_image(MapImage(pixels, maximum), PixelRule(negate, mode=mode, alpha=alpha))


@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("maximum", [255, 100, 65535])
def test_every_grey_is_read_as_nav2_reads_it(mode, negate, maximum):
    pixels = np.unique(np.linspace(0, maximum, 256).astype(np.uint16)).reshape(1, -1, 1)
    expected = [published(int(value), mode, negate, maximum=maximum) for value in pixels.ravel()]
    assert read_by_rules(pixels, mode, negate, maximum)[0].tolist() == expected


@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("channels", [2, 3, 4])
@pytest.mark.parametrize("average", [False, True])
def test_colours_and_alpha_are_read_as_nav2_reads_them(mode, negate, channels, average):
    pixels = np.random.default_rng(channels).integers(0, 256, size=(20, 20, channels), dtype=np.uint8)
    pixels[:10, :, -1] = 255
    expected = []
    for row in pixels[::-1].tolist():
        for values in row:
            alpha = values[-1] if channels in {2, 4} else None
            colours = (values[0],) * 3 if channels == 2 else tuple(values[:3])
            expected.append(published(colours, mode, negate, alpha, average=average))
    # A grey with alpha is one colour and alpha in the file, and three for map_server.
    spread = pixels if channels != 2 else pixels[..., [0, 0, 0, 1]]
    found = read_by_rules(spread, mode, negate, alpha="average" if average else "unknown")
    assert found.ravel().tolist() == expected


def test_the_yaml_is_what_map_server_reads(tmp_path):
    write_ros_map(tmp_path / "map.yaml", grid_of([[(0.0, 0.0)]]))
    text = (tmp_path / "map.yaml").read_text()
    assert yaml.safe_load(text) == {
        "image": "map.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [-1.0 / 3.0, 1e3 * math.pi, 0.0],  # all digits
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    assert "origin: [" in text
    assert {path.name for path in tmp_path.iterdir()} == {"map.yaml", "map.pgm"}


def test_a_name_with_dots_may_be_given(tmp_path):
    grid = grid_of([[(0.0, 0.0)]])
    write_ros_map(tmp_path / "floor.2.yaml", grid)
    assert {path.name for path in tmp_path.iterdir()} == {"floor.2.yaml", "floor.2.pgm"}
    assert read_ros_map(tmp_path / "floor.2.yaml").geometry == grid.geometry


def test_free_occupied_and_unknown_are_painted_and_read_again(tmp_path):
    # The top row has the largest y; a hint of evidence, or as much for as against, is unknown.
    grid = grid_of(
        [[(0.9, 0.0), (0.0, 0.9), (0.0, 0.0), (0.05, 0.0)], [(0.12, 0.0), (0.0, 0.12), (0.4, 0.4), (0.0, 0.05)]]
    )
    write_ros_map(tmp_path / "map.yaml", grid)
    image = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED)
    assert image.tolist() == [[254, 0, 205, 205], [254, 0, 205, 205]]
    read = read_ros_map(tmp_path / "map.yaml")
    assert read.geometry == grid.geometry
    for cells in read.masses:
        np.testing.assert_allclose(cells[0], [0.0, 0.9, 0.0, 0.1], atol=1e-6)
        np.testing.assert_allclose(cells[1], [0.0, 0.0, 0.9, 0.1], atol=1e-6)
        np.testing.assert_array_equal(cells[2:], [[0.0, 0.0, 0.0, 1.0]] * 2)


def test_the_bounds_are_pignistic():
    masses = np.random.default_rng(0).dirichlet(np.ones(4), size=(40, 40)).astype(np.float32)
    grid = TbmGrid(GEOMETRY._replace(rows=40, cols=40), masses)
    pignistic = grid.pignistic()
    clear = np.minimum(abs(pignistic - 0.45), abs(pignistic - 0.55)) > 1e-6
    expected = np.where(pignistic > 0.55, 0, np.where(pignistic < 0.45, 254, 205))
    np.testing.assert_array_equal(ros_pixels(grid)[::-1][clear], expected[clear])


def test_conflict_alone_is_unknown():
    grid = grid_of([[(0.0, 0.0)]])
    grid.masses[0, 0] = np.eye(4)[CONFLICT]
    assert ros_pixels(grid).tolist() == [[205]]


def test_a_hundred_passages_in_vinyslam_are_free():
    assert ros_pixels(grid_of([[(0.23, 0.006)]])).tolist() == [[254]]


def test_what_is_read_and_written_again_stays_the_same(tmp_path):
    rng = np.random.default_rng(0)
    grid = grid_of(rng.choice([0.0, 0.4], size=(20, 30, 2)))
    write_ros_map(tmp_path / "a.yaml", grid)
    write_ros_map(tmp_path / "b.yaml", read_ros_map(tmp_path / "a.yaml"))
    assert (tmp_path / "a.pgm").read_bytes() == (tmp_path / "b.pgm").read_bytes()
    assert (tmp_path / "a.yaml").read_text().replace("a.pgm", "b.pgm") == (tmp_path / "b.yaml").read_text()


def turned(tmp_path, yaw):
    """Write a picture of a wall with a mark, turned about the lower left corner, which lies at (2, -1)."""
    image = np.full((10, 20), 254, dtype=np.uint8)
    image[-1, :] = 0  # the lower row, from the corner along the picture's x axis
    image[0, 0] = 205  # the upper left pixel
    cv2.imwrite(str(tmp_path / "map.png"), image)
    (tmp_path / "map.yaml").write_text(
        f"image: map.png\nresolution: 0.1\norigin: [2.0, -1.0, {yaw}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return read_ros_map(tmp_path / "map.yaml")


def test_a_quarter_turn_moves_cells_to_cells(tmp_path):
    grid = turned(tmp_path, math.pi / 2)
    assert (grid.geometry.rows, grid.geometry.cols) == (20, 10)
    assert grid.geometry.bounds() == pytest.approx((1.0, -1.0, 2.0, 1.0))
    # The wall goes up at the right edge, the mark lies at the lower left.
    np.testing.assert_allclose(grid.masses[:, -1, OCCUPIED], 0.9, atol=1e-6)
    assert grid.masses[0, 0, UNKNOWN] == 1.0
    assert (grid.masses[..., FREE] > 0.5).sum() == 179


@pytest.mark.parametrize("yaw", [0.3, -2.0, 4.0, math.pi])
def test_a_turned_map_lies_where_its_yaw_says(tmp_path, yaw):
    grid = turned(tmp_path, yaw)
    T_map_image = SE2(2.0, -1.0, yaw)
    for col in range(20):
        x, y = T_map_image.apply([0.1 * (col + 0.5), 0.05])
        row, column = grid.geometry.cell_at(x, y)
        near = grid.masses[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2, OCCUPIED]
        assert near.max() == pytest.approx(0.9)
    known = np.sum(1.0 - grid.masses[..., UNKNOWN]) / 0.9
    assert known == pytest.approx(199, rel=0.05)


@pytest.mark.parametrize("mode", ["scale", "trinary"])
def test_alpha_hides_cells(tmp_path, mode, caplog):
    image = np.zeros((1, 3, 4), dtype=np.uint8)
    image[..., 3] = [255, 254, 0]
    cv2.imwrite(str(tmp_path / "map.png"), image)
    (tmp_path / "map.yaml").write_text(
        "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: {mode}\n"
    )
    masses = read_ros_map(tmp_path / "map.yaml").masses
    assert "map.yaml: 67 % of the picture is not opaque: read as unknown" in caplog.text
    np.testing.assert_allclose(masses[0, :, OCCUPIED], [0.9, 0.0, 0.0], atol=1e-6)
    np.testing.assert_array_equal(masses[0, 1:, UNKNOWN], [1.0, 1.0])


def test_alpha_is_averaged_where_that_is_asked_for(tmp_path, caplog):
    image = np.zeros((1, 2, 4), dtype=np.uint8)
    image[..., 3] = [255, 0]
    cv2.imwrite(str(tmp_path / "map.png"), image)
    (tmp_path / "map.yaml").write_text(
        "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\nalpha: average\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    np.testing.assert_allclose(read_ros_map(tmp_path / "map.yaml").masses[0, :, OCCUPIED], [0.9, 0.9], atol=1e-6)
    assert "50 % of the picture is not opaque: alpha is averaged with the colours" in caplog.text


@pytest.mark.parametrize(("alpha", "told"), [((0, 255), True), ((255, 0), False), ((255, 255), False)])
def test_transparent_walls_are_named(tmp_path, caplog, alpha, told):
    """One cell of wall, and one that is free."""
    image = np.zeros((1, 2, 4), dtype=np.uint8)
    image[0, 1, :3] = 254
    image[0, :, 3] = alpha
    cv2.imwrite(str(tmp_path / "map.png"), image)
    (tmp_path / "map.yaml").write_text(
        "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    read_ros_map(tmp_path / "map.yaml")
    assert ("map.yaml: holds no wall, because all of its walls are transparent" in caplog.text) is told


def test_a_missing_image_is_named(tmp_path):
    write_ros_map(tmp_path / "map.yaml", grid_of([[(0.0, 0.0)]]))
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(MapFileError, match=r"map\.yaml: names the image 'map\.pgm', but .*map\.pgm does not exist: "):
        read_ros_map(tmp_path / "map.yaml")


def test_a_coordinate_beyond_numbers_is_refused(tmp_path):
    turned(tmp_path, 0.3)
    text = (tmp_path / "map.yaml").read_text().replace("resolution: 0.1", "resolution: 1e308")
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapFileError, match=r"map\.yaml: cells of 1e\+308 m are too large for walls"):
        read_ros_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("pixels", "change", "kept"),
    [
        ([[254, 205, 0]], "free_thresh: 0.25", True),
        ([[254, 205, 0]], "free_thresh: 0.196", False),  # nothing to mend
        ([[254, 205, 100]], "free_thresh: 0.25", False),  # no map saver's: greys mean what the thresholds say
        ([[255, 205, 0]], "free_thresh: 0.25", True),  # painted white by hand
        ([[205] * 99 + [20]], "free_thresh: 0.25", True),  # the edge of a brush
        ([[205] * 98 + [20, 20]], "free_thresh: 0.25", False),
        ([[254, 254, 0]], "free_thresh: 0.25", False),
        ([[254, 205, 0]], "free_thresh: 0.25, negate: 1", False),
        ([[254, 205, 0]], "free_thresh: 0.25, mode: scale", False),
    ],
)
def test_only_a_map_saver_s_unknown_outweighs_the_threshold(tmp_path, caplog, pixels, change, kept):
    cv2.imwrite(str(tmp_path / "map.png"), np.array(pixels, dtype=np.uint8))
    words = {"negate": "0", "mode": "trinary"} | dict(word.split(": ") for word in change.split(", "))
    lines = [f"{key}: {value}" for key, value in words.items()]
    (tmp_path / "map.yaml").write_text(
        "\n".join(["image: map.png", "resolution: 0.05", "origin: [0, 0, 0]", "occupied_thresh: 0.65", *lines])
    )
    read_ros_map(tmp_path / "map.yaml")
    assert ("read as unknown" in caplog.text) is kept


def test_a_coloured_picture_of_a_map_saver_keeps_its_unknown(tmp_path):
    grey = np.array([[254, 205, 0]], dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "map.png"), np.repeat(grey[..., None], 3, axis=2))
    (tmp_path / "map.yaml").write_text(
        "image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    assert read_ros_map(tmp_path / "map.yaml").is_known().tolist() == [[True, False, True]]


@pytest.mark.parametrize(
    ("pixels", "mode", "warned"),
    [([254, 205, 0], "trinary", False), ([254, 254, 0], "trinary", True), ([254, 205, 0], "scale", True)],
)
def test_a_map_without_unknown_cells_causes_a_warning(tmp_path, caplog, pixels, mode, warned):
    cv2.imwrite(str(tmp_path / "map.pgm"), np.array([pixels], dtype=np.uint8))
    rules = f"negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\nmode: {mode}\n"
    (tmp_path / "map.yaml").write_text(f"image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n{rules}")
    read_ros_map(tmp_path / "map.yaml")
    assert ("none of its cells is unknown" in caplog.text) is warned


def test_painting_a_large_map_takes_hardly_more_than_its_picture(generator):
    """And gives what painting it at once gives."""
    masses = generator.dirichlet([1.0, 1.0, 1.0, 1.0], size=(2000, 1500)).astype(np.float32)
    grid = TbmGrid(GridGeometry(0.05, 0.0, 0.0, 2000, 1500), masses)
    tracemalloc.start()
    pixels = ros_pixels(grid)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 * pixels.size
    balance, needed = masses[..., OCCUPIED] - masses[..., FREE], np.float32(0.1) * (1.0 - masses[..., 0])
    expected = np.where(balance > needed, 0, np.where(-balance > needed, 254, 205))
    np.testing.assert_array_equal(pixels, expected[::-1])
