"""The reports of both programs as people open them: from disk, in a real browser, without a network."""

import itertools
import re

import cv2
import numpy as np
import pytest

from tbmslam.io.map_folder import load_map
from tbmslam.report.map_layers import drive_layers, incident_layer, map_layers
from tbmslam.report.page import Page
from tbmslam.report.sheet import Marks, Sheet, Switch
from tests.browser import OpenPage, browser_window, running_browser
from tests.end_to_end.programs import build, merge_maps, simulate
from tests.reference import is_inside

pytestmark = pytest.mark.xdist_group("flat")


@pytest.fixture(scope="module")
def browser():
    """One for all tests of this file: it takes seconds to start."""
    with running_browser() as browser:
        yield browser


@pytest.fixture
def window(browser):
    with browser_window(browser) as page:
        yield page


def read_out(opened, number=0):
    """Move over the map and return what is read there, by name."""
    box = opened.page.locator("#map").bounding_box()
    x, y = box["x"] + box["width"] / 2 + number, box["y"] + box["height"] / 2 + number
    for attempt in range(50):  # pictures are decoded at the first move, and a busy machine takes its time
        opened.page.mouse.move(x, y + 0.01 * (attempt % 2))
        opened.page.wait_for_timeout(100)  # till then it tells of the place before
        text = opened.page.inner_text("#readout")
        if "unknown" in text:
            break
    assert "x " in text
    return {name: float(value) for name, value in re.findall(r"([a-z]+) (-?\d+(?:\.\d+)?)", text)}


def test_the_merge_report_shows_the_map_and_switches_its_layers(flat_merged, window):
    opened = OpenPage(window, flat_merged / "report.html")
    page = opened.page
    assert page.title() == "Merge of robot_0, robot_1"
    assert "2 of 2 maps were merged." in page.inner_text("header")
    assert opened.visible_rasters() == ["pignistic", "robot_0", "robot_1"]
    page.get_by_label("conflict").check()
    page.get_by_label("robot_1: map").uncheck()
    page.get_by_label("overlap").check()
    assert sorted(opened.visible_rasters()) == ["conflict", "overlap", "robot_0"]
    drawn = "() => [...document.querySelectorAll('#map canvas')].map((canvas) => canvas.toDataURL()).join()"
    with_drives = page.evaluate(drawn)
    page.get_by_label("robot_0: drive").uncheck()
    page.wait_for_timeout(200)
    assert page.evaluate(drawn) != with_drives
    for what in ("keyframes", "loops"):
        before = page.evaluate(drawn)
        page.get_by_label(re.compile(f"robot_1: {what[:3]}")).check()
        page.wait_for_timeout(200)
        assert page.evaluate(drawn) != before
    assert page.locator(".leaflet-control-scale-line").inner_text().endswith(" m")
    assert page.locator("article img").first.evaluate("(image) => image.decode().then(() => image.naturalWidth)") > 100
    assert opened.complaints == []
    assert opened.asked_elsewhere() == []


def test_the_map_is_panned_and_zoomed_and_read_in_metres(flat_merged, window):
    opened = OpenPage(window, flat_merged / "report.html")
    page, grid = opened.page, load_map(flat_merged).grid
    for number in (0, 40, -70):
        said = read_out(opened, number)
        row, col = grid.geometry.cell_at(said["x"], said["y"])
        # The position is told to the centimetre, so it may be the cell beside.
        near = [
            (r, c) for r in range(row - 1, row + 2) for c in range(col - 1, col + 2) if is_inside(grid.geometry, r, c)
        ]
        for name, subset in (("conflict", 0), ("free", 1), ("occupied", 2), ("unknown", 3)):
            assert any(abs(grid.masses[cell][subset] - said[name]) <= 0.026 for cell in near)
    start = read_out(opened)
    scale = page.inner_text(".leaflet-control-scale-line")
    page.mouse.wheel(0, -600)
    page.wait_for_timeout(600)
    assert page.inner_text(".leaflet-control-scale-line") != scale
    box = page.locator("#map").bounding_box()
    page.mouse.move(box["x"] + 500, box["y"] + 300)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 300, steps=5)
    page.mouse.up()
    page.wait_for_timeout(600)
    assert read_out(opened)["x"] > start["x"] + 0.2
    page.click("#whole")
    page.wait_for_timeout(200)
    assert read_out(opened)["x"] == pytest.approx(start["x"], abs=0.02)
    assert opened.complaints == []


def test_the_hint_is_for_a_mouse_where_there_is_one(flat_merged, window):
    opened = OpenPage(window, flat_merged / "report.html")
    page = opened.page
    hint = "Move over the map to read positions and values. Drag to move, scroll to zoom."
    assert page.inner_text("#readout") == hint
    read_out(opened)
    page.mouse.move(1, 1)
    assert page.inner_text("#readout") == hint


def test_a_touch_screen_has_its_own_hint_and_one_tap_reads_position_and_values(flat_merged, browser):
    with browser_window(browser, 390, 844, is_touched=True) as window:
        opened = OpenPage(window, flat_merged / "report.html")
        page = opened.page
        hint = "Tap the map to read positions and values. Drag to move, pinch to zoom."
        assert page.inner_text("#readout") == hint
        page.locator("#map").tap()
        page.locator("#readout", has_text="conflict").wait_for(timeout=5000)
        assert re.match(r"x -?\d+\.\d\d m   y -?\d+\.\d\d m ", page.inner_text("#readout"))
        page.locator("h1").tap()
        assert page.inner_text("#readout") == hint
        assert opened.complaints == []


def test_the_report_of_build_maps_has_a_sheet_for_every_robot(flat_maps, window):
    opened = OpenPage(window, flat_maps / "report.html")
    page = opened.page
    assert page.get_by_role("tab").all_inner_texts() == ["robot_0", "robot_1"]
    bounds = "() => document.querySelector('#map img').style.width"
    first = page.evaluate(bounds)
    page.get_by_role("tab", name="robot_1").click()
    assert page.get_by_role("tab", selected=True).inner_text() == "robot_1"
    assert page.evaluate(bounds) != first
    assert opened.visible_rasters() == ["pignistic"]
    page.get_by_label("unknown").check()
    assert opened.visible_rasters() == ["unknown"]
    for words in ("How it was made", "build_maps ", "Every parameter", "mapping", "numba"):
        assert words in page.inner_text("main")
    assert opened.complaints == []
    assert opened.asked_elsewhere() == []


def robots_seen(page):
    """Return where robots are in the window, to the pixel."""
    page.wait_for_timeout(100)
    boxes = [robot.bounding_box() for robot in page.locator(".robot").all()]
    return [(round(box["x"] + box["width"] / 2), round(box["y"] + box["height"] / 2)) for box in boxes]


def test_robots_run_along_their_drives_by_keys_and_by_themselves(flat_merged, window):
    opened = OpenPage(window, flat_merged / "report.html")
    page = opened.page
    assert robots_seen(page) == []
    page.locator("#when").focus()
    page.keyboard.press("End")
    at_the_end = robots_seen(page)
    assert len(at_the_end) == 2
    longest = page.inner_text("#at")
    assert re.fullmatch(r"(\d+\.\d) s of \1 s", longest)
    assert page.get_attribute("#when", "aria-valuetext") == longest
    page.keyboard.press("PageDown")
    page.keyboard.press("ArrowLeft")
    earlier = robots_seen(page)
    assert earlier != at_the_end
    page.get_by_label("robot_0: drive").uncheck()
    assert robots_seen(page) == earlier[1:]
    page.get_by_label("robot_0: drive").check()
    assert sorted(robots_seen(page)) == sorted(earlier)
    page.locator("#play").click()
    page.wait_for_timeout(300)
    page.locator("#play").click()
    stopped, text = robots_seen(page), page.inner_text("#at")
    assert stopped != earlier
    page.wait_for_timeout(200)
    assert (robots_seen(page), page.inner_text("#at")) == (stopped, text)
    assert opened.complaints == []
    assert opened.asked_elsewhere() == []


def test_a_robot_is_where_its_trajectory_says(flat_maps, window):
    opened = OpenPage(window, flat_maps / "report.html")
    page, drive = opened.page, load_map(flat_maps / "robot_0").drives[0]
    page.locator("#when").fill("10")
    ((x, y),) = robots_seen(page)
    page.mouse.move(x, y)
    page.wait_for_timeout(200)
    place = [float(one) for one in re.findall(r"[xy] (-?\d+\.\d\d) m", page.inner_text("#readout"))]
    stamps = drive.trajectory.stamps
    true = drive.trajectory.poses[abs(stamps - stamps[0] - float(page.input_value("#when"))).argmin()]
    assert place == pytest.approx(list(true[:2]), abs=0.15)  # half a scan's way, and two pixels
    page.get_by_role("tab", name="robot_1").click()
    assert robots_seen(page) == []


def test_the_view_is_saved_and_the_files_beside_the_page_are_led_to(flat_merged, flat_maps, window, tmp_path):
    opened = OpenPage(window, flat_merged / "report.html")
    page = opened.page
    page.locator("#when").fill("5")
    with page.expect_download() as saved:
        page.locator("#picture").click()
    saved.value.save_as(tmp_path / "view.png")
    picture, box = cv2.imread(str(tmp_path / "view.png")), page.locator("#map").bounding_box()
    assert picture.shape[:2] == (round(box["height"]), round(box["width"]))
    seen = cv2.imdecode(np.frombuffer(page.locator("#map").screenshot(), np.uint8), cv2.IMREAD_COLOR)
    apart = np.abs(picture.astype(int) - seen[: picture.shape[0], : picture.shape[1]]).max(axis=2) > 60
    assert apart.mean() < 0.03  # buttons, and edges of cells
    assert opened.complaints == []
    for folder, least in ((flat_merged, 6), (flat_maps, 10)):
        OpenPage(page, folder / "report.html")
        paths = page.locator(".files a").evaluate_all("(all) => all.map((one) => decodeURI(one.getAttribute('href')))")
        assert len(paths) >= least
        assert all((folder / path).is_file() for path in paths)


def test_pages_are_of_a_reasonable_size(flat_merged, flat_maps):
    for folder in (flat_merged, flat_maps):
        assert 200_000 < (folder / "report.html").stat().st_size < 1_000_000


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_is_cut_off_and_the_map_is_first(flat_merged, window, scheme):
    window.set_viewport_size({"width": 390, "height": 844})
    window.emulate_media(color_scheme=scheme)
    opened = OpenPage(window, flat_merged / "report.html")
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    tables = page.locator(".scroll").evaluate_all("(all) => all.map((one) => one.scrollWidth - one.clientWidth)")
    assert tables
    assert max(tables) <= 0
    order = [page.locator(name).bounding_box()["y"] for name in ("#map", "#time", "#layers")]
    assert order == sorted(order)
    luminance = (
        "(one) => getComputedStyle(one).backgroundColor.match(/[0-9]+/g).slice(0, 3).reduce((a, b) => a + Number(b), 0)"
    )
    ground = page.locator("body").evaluate(luminance)
    assert (ground < 150) is (scheme == "dark")


@pytest.mark.parametrize("width", [820, 1440])
def test_no_table_is_wider_than_the_page(flat_maps, flat_merged, window, width):
    window.set_viewport_size({"width": width, "height": 900})
    for folder in (flat_maps, flat_merged):
        page = OpenPage(window, folder / "report.html").page
        beyond = page.locator(".scroll").evaluate_all("(all) => all.map((one) => one.scrollWidth - one.clientWidth)")
        assert beyond
        assert max(beyond) <= 0


def test_the_end_of_a_long_name_is_shown_because_robots_differ_there(flat_merged, window):
    page = OpenPage(window, flat_merged / "report.html").page
    name = page.locator("#layers td").first
    name.evaluate("(cell) => cell.append('-of-a-recording-with_a_long_name_2026-11-26_0')")
    assert name.evaluate("(cell) => cell.scrollWidth <= cell.clientWidth")
    assert name.bounding_box()["height"] > 2 * page.locator("#layers tbody tr").nth(1).bounding_box()["height"]


def test_the_heads_of_five_columns_of_switches_do_not_touch(flat_merged, window, tmp_path):
    tbm_map = load_map(flat_merged)
    columns = list[Marks]()
    for drive in tbm_map.drives:
        walls = Marks(Switch("Robots", drive.name, "map"), "dots", drive.keyframes.poses[:, :2], (0, 0, 0))
        incidents = [{"stamp": drive.trajectory.stamps[0], "what": "a gap"}]
        lines = drive_layers([drive], [(0, 0, 200)], "Robots", 0.05)
        columns += [walls, *lines, *incident_layer(drive, incidents, "Robots")]
    page = Page("Merge", "merged", sheets=[Sheet("Merged map", (*map_layers(tbm_map.grid), *columns))])
    (tmp_path / "report.html").write_text(page.to_html(), encoding="utf-8")
    opened = OpenPage(window, tmp_path / "report.html")
    extents = opened.page.locator("#layers th[scope=col]").evaluate_all(
        """(heads) => heads.map((head) => {
          const range = document.createRange();
          range.selectNodeContents(head);
          const { left, right } = range.getBoundingClientRect();
          return [left, right];
        })"""
    )
    assert len(extents) == 5
    gaps = [after[0] - before[1] for before, after in itertools.pairwise(extents)]
    assert min(gaps) >= 4
    panel = opened.page.locator("#layers").bounding_box()
    assert extents[-1][1] <= panel["x"] + panel["width"] - 10
    assert opened.page.locator("#layers table").evaluate("(table) => table.scrollWidth <= table.clientWidth")


def test_distances_are_measured_poses_copied_and_parameters_found(flat_maps, window, tmp_path):
    setting = "merging.verification.min_confidence=0.8"
    merge_maps(tmp_path, flat_maps / "robot_0", flat_maps / "robot_1", "--set", setting)
    opened = OpenPage(window, tmp_path / "report.html")
    page = opened.page
    page.locator("#ruler").click()
    box = page.locator("#map").bounding_box()
    for x in (300, 400):
        page.mouse.click(box["x"] + x, box["y"] + 200)
    said = float(page.locator(".leaflet-tooltip").inner_text().removesuffix(" m"))
    bar = page.locator(".leaflet-control-scale-line")
    per_pixel = float(bar.inner_text().removesuffix(" m")) / bar.bounding_box()["width"]
    assert said == pytest.approx(100.0 * per_pixel, rel=0.05)
    page.locator("#ruler").click()
    page.wait_for_timeout(500)  # it fades
    assert page.locator(".leaflet-tooltip").count() == 0
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.locator(".copy").first.click()
    page.wait_for_timeout(200)
    x, y, degrees = map(float, page.locator(".copy").first.get_attribute("data-copy").split())
    assert f"{x:.3f} m" in page.inner_text("article")
    assert page.locator(".copy").first.inner_text() in ("copied", f"{x:.4f} {y:.4f} {degrees:.3f}")
    summary = page.locator("summary")
    assert summary.inner_text().endswith(", 1 changed)")
    summary.click()
    assert page.locator("#config tr").first.inner_text().split() == [
        "verification.min_confidence",
        "0.8",
        "usually",
        "0.85",
    ]
    page.locator("#search").fill("MIN_conf")
    assert page.locator("#config tr:visible").all_inner_texts()[0].startswith("verification.min_confidence")
    assert page.locator("#config tr:visible").count() < 5
    assert opened.complaints == []


def test_a_grid_lies_at_round_metres_and_follows_the_zoom(flat_merged, window):
    opened = OpenPage(window, flat_merged / "report.html")
    page, drawn = opened.page, "() => [...document.querySelectorAll('#map canvas')].map((c) => c.toDataURL()).join()"
    without = page.evaluate(drawn)
    page.locator("#grid").click()
    steps = []
    for _ in range(3):
        page.wait_for_timeout(600)
        steps.append(float(page.locator(".grid-step").inner_text().removeprefix("grid ").removesuffix(" m")))
        bar = page.locator(".leaflet-control-scale-line")
        pixels = steps[-1] * bar.bounding_box()["width"] / float(bar.inner_text().removesuffix(" m"))
        assert 48 <= pixels <= 130  # 1, 2 and 5 are up to a factor of 2.5 apart
        page.mouse.move(*(page.locator("#map").bounding_box()[side] + 200 for side in "xy"))
        page.mouse.wheel(0, -400)
    assert steps[0] > steps[1] > steps[2]
    assert page.evaluate(drawn) != without
    page.locator("#grid").click()
    assert page.locator(".grid-step").count() == 0
    assert page.locator("#grid").get_attribute("aria-pressed") == "false"
    assert opened.complaints == []


def test_a_warning_leads_to_where_it_happened(tmp_path, window):
    bags = simulate(
        tmp_path / "bags", "--world", "apartment", "--beams", 181, "--rate", 5, "--duration", 16,
        "--fault", "odometry_jump@10",
    )  # fmt: skip
    maps = build(tmp_path / "maps", bags / "robot_0.bag")
    opened = OpenPage(window, maps / "report.html")
    page = opened.page
    before = page.inner_text(".warnings")
    jump = page.locator(".warnings .jump").first
    at = jump.inner_text()
    assert f"robot_0: at {at} s" in before
    assert page.locator(".leaflet-tooltip").count() == 0
    jump.click()
    page.wait_for_timeout(500)
    assert page.locator(".leaflet-tooltip").inner_text().startswith(f"{at} s: ")
    box, dot = page.locator("#map").bounding_box(), page.locator(".leaflet-tooltip").bounding_box()
    assert abs(dot["y"] + dot["height"] / 2 - box["y"] - box["height"] / 2) < 20
    assert opened.complaints == []


def test_a_list_of_warnings_that_goes_on_below_its_edge_shows_it_and_is_printed_whole(flat_maps, window):
    window.set_viewport_size({"width": 390, "height": 844})
    page = OpenPage(window, flat_maps / "report.html").page
    warned = page.locator(".warnings ul")
    warned.evaluate("(list) => (list.innerHTML = '<li>the odometry jumps</li>'.repeat(40))")

    def darkest_at_the_edge():
        shot = cv2.imdecode(np.frombuffer(warned.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        return shot[-6:-2, -60:-20].min()

    before = darkest_at_the_edge()
    warned.evaluate("(list) => list.scrollTo(0, list.scrollHeight)")
    page.wait_for_timeout(200)
    assert darkest_at_the_edge() > before + 5
    window.emulate_media(media="print")
    assert warned.evaluate("(list) => list.scrollHeight <= list.clientHeight")
