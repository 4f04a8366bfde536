import io
from collections import Counter

import numpy as np
import pytest
from PIL import Image

from merging.config.registration import StructureConfig
from merging.config.verification import VerificationConfig
from merging.report.pair_pictures import draw_alone, draw_pair
from merging.verification.evidence import examine
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

GREY, BLUE, ORANGE, GREEN, RED = (232, 236, 241), (28, 94, 170), (222, 130, 20), (16, 138, 76), (206, 22, 28)


def pixels(png):
    return Counter(map(tuple, np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3).tolist()))


@pytest.fixture
def structure(rooms):
    return lambda seed: WallMap.from_grid(rooms(seed), StructureConfig())


def test_a_map_on_itself_is_green(structure):
    seen = pixels(draw_pair(structure(1), structure(1), SE2.identity(), VerificationConfig()))
    assert seen[GREEN] > 500
    assert seen[RED] + seen[BLUE] + seen[ORANGE] == 0


def test_walls_on_free_space_are_red_by_the_share_that_the_evidence_tells(structure):
    target, source, shift = structure(1), structure(1), SE2(1.0, 0.6, 0.0)
    config = VerificationConfig()
    seen, evidence = pixels(draw_pair(target, source, shift, config)), examine(target, source, shift, config)
    assert evidence.conflict > 0.2
    shown = seen[RED] / (seen[RED] + seen[GREEN])
    told = evidence.conflict / (evidence.conflict + evidence.agreement)
    assert shown == pytest.approx(told, abs=0.1)
    assert seen[BLUE] > 0
    assert seen[ORANGE] > 0


def test_maps_that_do_not_overlap_keep_their_colours(structure):
    seen = pixels(draw_pair(structure(1), structure(2), SE2(40.0, 0.0, 0.5), VerificationConfig()))
    assert seen[GREEN] + seen[RED] == 0
    assert seen[BLUE] > 200
    assert seen[ORANGE] > 200


def test_a_map_alone_and_one_without_walls(structure):
    assert pixels(draw_alone(structure(1)))[BLUE] > 500
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))
    grid.masses[5:9, 5:9] = (0.0, 1.0, 0.0, 0.0)
    bare = WallMap.from_grid(grid, StructureConfig())
    assert pixels(draw_alone(bare))[GREY] > 0
    assert pixels(draw_pair(bare, structure(1), SE2.identity(), VerificationConfig()))[RED] == 0
