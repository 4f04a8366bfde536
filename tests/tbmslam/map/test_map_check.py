import math

import pytest

from tbmslam.belief.grid import GridGeometry
from tbmslam.map import map_check
from tbmslam.map.map_check import MAX_CELLS, MapFileError, check_geometry, check_size

GOOD = GridGeometry(0.05, -1.0, 2.0, 20000, 20000)


def test_a_square_kilometre_in_cells_of_5_cm_is_believed(monkeypatch):
    monkeypatch.setattr("tbmslam.map.map_check.machine_memory", lambda: 16 << 30)
    check_geometry("map", GOOD)
    assert GOOD.rows * GOOD.cols == MAX_CELLS


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resolution": 0.0}, "the resolution must be positive, got 0"),
        ({"resolution": -0.05}, "the resolution must be positive, got -0.05"),
        ({"resolution": math.nan}, "the resolution must be positive, got nan"),
        ({"resolution": math.inf}, "the resolution must be positive, got inf"),
        ({"origin_x": math.nan}, "the origin must be finite, got nan"),
        ({"origin_y": -math.inf}, "the origin must be finite, got -1.0, -inf"),
        ({"resolution": 1e-12}, "cells of 1e-12 m are not within 0.001 to 100 m"),
        ({"resolution": 1e5}, "cells of 100000 m are not within 0.001 to 100 m"),
        ({"resolution": 100.0, "origin_x": 9.9e7}, "the map would reach to 1.01e.08 m, more than the 1e.08 m"),
        ({"origin_x": -1e9}, "the map would reach to 1e.09 m"),
        ({"rows": 0}, "0 x 20000 cells is empty"),
        ({"rows": -20000, "cols": -20000}, "cells is empty"),
        ({"rows": 20001}, "20001 x 20000 cells are more than the limit of 400000000"),
    ],
)
def test_others_are_not(change, message):
    with pytest.raises(MapFileError, match=f"^a.map: .*{message}.*: "):
        check_geometry("a.map", GOOD._replace(**change))


def test_a_product_that_would_overflow_is_refused():
    with pytest.raises(MapFileError, match="are more than"):
        check_size("a.map", 2**32, 2**32)


def test_a_map_too_large_for_the_machine_is_refused(monkeypatch):
    monkeypatch.setattr(map_check, "machine_memory", lambda: 1_900_000_000)
    check_size("m.yaml", 9000, 10000)
    with pytest.raises(
        MapFileError, match=r"^m\.yaml: 10000 x 10000 cells take 2\.0 GB of memory, and 1\.9 GB are available: "
    ):
        check_size("m.yaml", 10000, 10000)
