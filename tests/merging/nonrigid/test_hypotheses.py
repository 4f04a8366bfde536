from merging import MergeConfig
from merging.nonrigid.deformation import DeformableMap
from merging.nonrigid.hypotheses import DeformedPoses
from tbmslam.geometry.se2 import SE2
from tests.merging.bent_floor import bent_maps


def test_a_pose_without_support_is_no_hypothesis():
    target, source, true = bent_maps("store")
    fixed, moving = (DeformableMap.of(one.grid, MergeConfig()) for one in (source, target))
    poses = DeformedPoses(fixed.structure, moving, MergeConfig())
    assert poses.likeliest([], ()) is None
    assert poses.likeliest([SE2(100.0, 0.0, 0.0)], ()) is None
    assert poses.likeliest([true.inverse()], ()) is poses.best([true.inverse()])[0]  # compared once
