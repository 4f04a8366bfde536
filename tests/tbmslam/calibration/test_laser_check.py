import math
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.calibration.laser_check import LaserCheckConfig, LaserErrors, laser_warnings
from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan

CONFIG = LaserCheckConfig()


def keyframes(beams, step_deg, count=3):
    scan = LaserScan(0.0, -1.0, math.radians(step_deg), 0.1, 30.0, np.ones(beams))
    return Keyframes.from_scans([scan] * count, [SE2.identity()] * count, [SE2.identity()] * count)


def said(beams, step_deg, scale, deviation=0.0005, offset=0.0):
    return laser_warnings(LaserErrors(scale, deviation, offset, 0.003), keyframes(beams, step_deg), CONFIG)


@pytest.mark.parametrize(
    ("beams", "stated", "scale", "fit", "mended"),
    [
        (180, 180.0 / 179.0, -0.0061, "0.9995", "1"),
        (361, 0.515, -0.029, "0.5001", "0.5"),
        (270, 1.03, -0.0291, "1", "1"),
        (682, 0.36, -0.0237, "0.3515", "0.351562"),
        (680, 0.36, 0.0145, "0.3652", "0.3652"),
        (680, 0.3644, 0.011, "0.3684", "0.3684"),
        (180, 180.0 / 179.0, -0.0107, "0.9948", "1"),
        (180, 1.003, -0.0051, "0.9979", "1"),
        (180, 180.0 / 179.0, 0.005, "1.011", "1.011"),
        (270, 270.0 / 269.0 * 1.3, -0.0037, "1.3", "1.3"),
        (90, 4.1, -0.0236, "4.003", "4"),
        (36, 360.0 / 35.0, -0.028, "9.998", "10"),
    ],
)
def test_angles_between_beams_and_what_mends_them(beams, stated, scale, fit, mended):
    assert said(beams, stated, scale) == {
        "angles": f"walls fit best where beams are {fit} degrees apart, not {stated:.5g}: try --angle-step-deg {mended}"
    }


def test_beams_that_turn_clockwise():
    assert said(180, -1.03, -0.029)["angles"].endswith("try --angle-step-deg 1, or -1 where it is stated negative")


@pytest.mark.parametrize(
    ("beams", "stated", "scale", "deviation"),
    [
        (180, 1.0, 0.003, 0.0001),
        (180, 1.0, 0.02, 0.006),
        (180, 1.0, -0.0044, 0.0001),
        (180, 1.0, -0.0056, 0.0001),
        (270, 0.9999, 0.0115, 0.0001),
        (200, 1.8, 0.0045, 0.0001),
        (1081, 0.2498, -0.01, 0.0001),
        (360, 1.0, 0.02, 0.0005),
        (361, 1.0, -0.01, 0.0005),
    ],
)
def test_angles_that_hardly_differ_are_uncertain_real_or_go_once_round_are_right(beams, stated, scale, deviation):
    assert said(beams, stated, scale, deviation) == {}


def test_angles_that_change_from_scan_to_scan():
    mixed = keyframes(180, 1.0)
    mixed = replace(mixed, beams=mixed.beams * [[1.0, 1.0, 1.0, 1.0], [1.0, 1.01, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])
    assert laser_warnings(LaserErrors(-0.012, 0.0005, 0.0, 0.003), mixed, CONFIG) == {
        "angles": "walls fit best where angles between beams are 1.2% smaller: check the driver of the laser"
    }


@pytest.mark.parametrize(("offset", "words"), [(0.102, "0.10 m longer"), (-0.08, "0.08 m shorter")])
def test_ranges_and_what_mends_them(offset, words):
    assert said(180, 1.0, 0.0, offset=offset) == {
        "ranges": f"walls fit best where ranges are {words} than measured: try --range-offset {offset:.2f}"
    }


@pytest.mark.parametrize(
    ("added", "more", "words"),
    [
        (-0.05, -0.15, "0.20 m shorter than measured, not 0.05 m shorter than measured: try --range-offset -0.20"),
        (0.05, -0.15, "0.10 m shorter than measured, not 0.05 m longer than measured: try --range-offset -0.10"),
        (0.1, -0.098, "as measured, not 0.10 m longer than measured: try without --range-offset"),
        (-0.1, 0.098, "as measured, not 0.10 m shorter than measured: try without --range-offset"),
    ],
)
def test_what_is_to_be_added_counts_from_what_was_measured(added, more, words):
    errors = LaserErrors(0.0, 0.0005, more, 0.003)
    told = laser_warnings(errors, keyframes(180, 1.0), CONFIG, added)
    assert told == {"ranges": f"walls fit best where ranges are {words}"}


def test_small_or_uncertain_offsets_are_none():
    assert said(180, 1.0, 0.0, offset=0.05) == {}
    assert laser_warnings(LaserErrors(0.0, 0.001, 0.1, 0.03), keyframes(180, 1.0), CONFIG) == {}
