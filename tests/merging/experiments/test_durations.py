from merging.config.registration import FeatureConfig
from merging.experiments.durations import measure_durations


def test_a_merge_is_timed_so_many_times(pair):
    result = measure_durations(pair, 2, FeatureConfig(keypoints=50))
    assert result.milliseconds.shape == (2,)
    assert (result.milliseconds > 0.0).all()
    assert result.area_m2 >= 150 * 190 * 0.01
