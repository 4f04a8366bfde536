import numpy as np

from merging.config.registration import FeatureConfig
from merging.registration.features import describe, match
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tools.paper.detectors import (
    AS_PROGRAMMED,
    AS_WRITTEN,
    MODIFICATIONS,
    Setting,
    Variant,
    compare_modifications,
)
from tools.paper.map_pair import MapPair


def test_every_setting_is_measured(pair):
    told = []
    studies = compare_modifications([pair], (50, 300), (0.6, 0.8), (AS_WRITTEN, AS_PROGRAMMED), 0.5, told.append)
    assert told == ["50 keypoints", "300 keypoints"]
    for study in studies.values():
        settings = {Setting(n, r, m) for n in (50, 300) for r in (0.6, 0.8) for m in MODIFICATIONS}
        assert set(study.shares) == set(study.matches) == settings
        assert 30 <= study.found[50].min() <= study.found[50].max() <= 50
        assert study.shares[300, 0.8, "b"][0] > 0.8
        assert study.matches[300, 0.6, "b"][0] <= study.matches[300, 0.8, "b"][0]


def test_the_program_s_descriptors_are_those_of_the_merger(pair):
    """256 bits and the unknown image as it is: what `--method features` matches, for every way of joining."""
    variant = Variant(256, "as it is")
    study = compare_modifications([pair], (300,), (0.7,), (variant,), 0.5)[variant]
    for letter, descriptor in MODIFICATIONS.items():
        config = FeatureConfig(keypoints=300, descriptor=descriptor)
        matches = match(describe(pair.target, config), describe(pair.source, config), config)
        assert study.matches[300, 0.7, letter][0] == len(matches)


def test_a_map_without_keypoints_matches_nothing():
    nothing = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 40, 40))
    pair = MapPair("one", "two", nothing, nothing, SE2.identity())
    study = compare_modifications([pair], (100,), (0.7,), (AS_WRITTEN,), 0.5)[AS_WRITTEN]
    assert np.isnan(study.shares[100, 0.7, "b"]).all()
    assert study.found[100].tolist() == [0, 0]
