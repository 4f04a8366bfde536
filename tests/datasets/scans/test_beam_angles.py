import math

import pytest

from datasets.scans.beam_angles import angle_warning, are_degrees


@pytest.mark.parametrize(("beams", "fan_deg", "step"), [(180, 180.0, "1"), (360, 180.0, "0.5"), (360, 360.0, "1")])
def test_a_stretched_fan_is_said(beams, fan_deg, step):
    warning = angle_warning(beams, math.radians(fan_deg / (beams - 1)))
    assert warning is not None
    assert f"pass --angle-step-deg {step}" in warning


@pytest.mark.parametrize(
    ("beams", "step_deg"),
    [(180, 1.0), (181, 1.0), (361, 0.5), (1081, 0.25), (1040, 0.25), (361, 1.0), (682, 0.352), (1, 1)],
)
def test_true_fans_are_not(beams, step_deg):
    assert angle_warning(beams, math.radians(step_deg)) is None
    assert angle_warning(beams, -math.radians(step_deg)) is None


@pytest.mark.parametrize(("beams", "step"), [(181, 1.0), (361, -0.5), (720, 0.5), (1081, 0.25), (121, 0.25)])
def test_degrees_are_told_from_radians(beams, step):
    assert are_degrees(beams, step)
    assert not are_degrees(beams, math.radians(step))


def test_degrees_are_said():
    assert angle_warning(361, 0.5) == "361 beams 0.5 rad apart are stated, 29 turns: they are read as degrees"


def test_more_than_a_turn_is_said():
    warning = angle_warning(360, math.radians(1.03))
    assert warning is not None
    assert warning.endswith("more than a turn: if they span one turn, pass --angle-step-deg 1")
