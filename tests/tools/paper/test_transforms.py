from merging.config import MergeConfig
from merging.config.registration import FeatureConfig
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tools.paper.map_pair import MapPair
from tools.paper.transforms import measure_durations, measure_transforms


def test_a_merge_is_timed_so_many_times(pair):
    result = measure_durations(pair, 2, FeatureConfig(keypoints=50))
    assert result.milliseconds.shape == (2,)
    assert (result.milliseconds > 0.0).all()
    assert result.area_m2 >= 150 * 190 * 0.01


def test_the_true_error_is_given_with_the_distances(pair):
    result = measure_transforms(pair, MergeConfig(features=FeatureConfig(keypoints=300)), 0.5)
    assert 0.8 * result.matches < result.right <= result.matches
    assert result.least_m <= result.geometric_mean_m <= result.most_m
    assert result.affine_error_m < 0.3
    assert result.rigid_error_m < 0.1


def test_without_matches_there_is_nothing_to_tell():
    nothing = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 40, 40))
    result = measure_transforms(MapPair("one", "two", nothing, nothing, SE2.identity()), MergeConfig(), 0.5)
    assert (result.matches, result.right) == (0, 0)
    assert result.geometric_mean_m is result.affine_error_m is result.default_error_m is None
