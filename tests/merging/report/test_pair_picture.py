"""The picture of an alignment in a notebook."""

import base64
import io
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from merging import MergeConfig, align, merge
from merging.alignment import Alignment
from merging.fusion import warp
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

CONFIG = MergeConfig(method="features")
GREEN, RED, BLUE, ORANGE = (16, 138, 76), (206, 22, 28), (28, 94, 170), (222, 130, 20)
NO_POSE = Alignment("correlation", accepted=False, reason="the source map is empty")


@pytest.fixture
def there(rooms):
    return TbmMap(warp(rooms(1), SE2(1.0, 2.0, 0.5), rooms(1).geometry))


def colours(html):
    """Return how many pixels of a shown picture have each colour."""
    png = base64.b64decode(re.search(r"data:image/png;base64,([^\"]+)", html)[1])
    return Counter(map(tuple, np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3).tolist()))


def test_an_accepted_alignment_shows_both_maps_on_each_other(rooms, there):
    found = align(TbmMap(rooms(1)), there, CONFIG)
    html = found._repr_html_()
    assert html.startswith(f"<p><b>Accepted, confidence {found.confidence:.3f}".replace("1.000", "&gt; 0.999"))
    assert "Walls of the target are blue, of the source orange." in html
    assert colours(html)[GREEN] > 10 * colours(html)[RED]


def test_the_picture_follows_the_pose_and_its_inverse(rooms, there):
    found = align(TbmMap(rooms(1)), there, CONFIG)
    back = colours(found.reversed()._repr_html_())
    assert back[GREEN] > 10 * back[RED]
    moved = replace(found, T_target_source=SE2(1.0, 0.6, 0.0) @ found.T_target_source)
    assert colours(moved._repr_html_())[RED] > 100


def test_a_refused_alignment_says_why_and_shows_the_refused_pose(rooms):
    found = align(TbmMap(rooms(1)), TbmMap(rooms(2)))
    html = found._repr_html_()
    assert html.startswith(f"<p><b>Refused, confidence {found.confidence:.3f}.</b>")
    assert found.reason[1:].replace("<", "&lt;") in html
    assert colours(html)[BLUE] > 0
    assert colours(html)[ORANGE] > 0


def test_where_no_pose_was_found_there_are_only_words(rooms):
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 10, 10)))
    html = align(TbmMap(rooms(1)), empty, CONFIG)._repr_html_()
    assert html == ("<p><b>Refused, confidence 0.000.</b></p><p>The source map is empty: no cell of it is known.</p>")


def test_the_alignments_of_a_merge_have_pictures_of_the_compared_grids(rooms, there):
    maps = {"here": TbmMap(rooms(1)), "there": there}
    found = merge(maps, CONFIG).alignments["here", "there"]
    assert colours(found._repr_html_()) == colours(align(*maps.values(), CONFIG)._repr_html_())
    assert "compared" not in found.as_json()
    assert found == replace(found, compared=None)


def test_a_merge_of_nothing_shows_its_most_confident_pair(rooms):
    maps = {"one": TbmMap(rooms(1)), "<two>": TbmMap(rooms(2))}
    result = merge(maps)
    assert result.merged is None
    html = result._repr_html_()
    found = result.alignments["one", "<two>"]
    assert "Walls of one are blue, of &lt;two&gt; orange." in html
    assert colours(html) == colours(found._repr_html_())
    surer = replace(found, T_target_source=SE2(1.0, 0.6, 0.0) @ found.T_target_source, confidence=0.9)
    both = replace(result, alignments={**result.alignments, ("one", "three"): surer})
    assert "of three orange" in both._repr_html_()
    assert colours(both._repr_html_()) == colours(surer._repr_html_())
    assert "<img" not in replace(result, alignments={})._repr_html_()
    assert "<img" not in replace(result, alignments={("one", "<two>"): NO_POSE})._repr_html_()
