from merging import MergeConfig
from merging.nonrigid.deformation import DeformableMap, fit_tiles
from merging.nonrigid.hypotheses import DeformedPoses
from merging.nonrigid.rivals import DeformedRivals
from tbmslam.geometry.se2 import SE2
from tests.merging.bent_floor import bent_maps, errors


def test_rivals_that_end_at_one_place_count_once(monkeypatch):
    target, source, true = bent_maps("store")
    fixed, moving = (DeformableMap.of(one.grid, MergeConfig()) for one in (source, target))  # the target has less wall
    pose, elsewhere = true.inverse(), SE2(30.0, 0.0, 0.0) @ true.inverse()
    monkeypatch.setattr("merging.nonrigid.rivals._rivals", lambda *_: [SE2(1.5, 0.0, 0.0) @ pose, elsewhere])

    def fitted(fixed, moving, start, config):
        return None if start == elsewhere else fit_tiles(fixed, moving, pose, config)

    monkeypatch.setattr("merging.nonrigid.hypotheses.fit_tiles", fitted)
    poses = DeformedPoses(fixed.structure, moving, MergeConfig())
    rivals = DeformedRivals.of(poses, poses.best([pose])[0])
    assert len(rivals.motions) == len(rivals.evidence) == 2
    assert errors(rivals.motions[0], pose, target)[0] < 0.5
    assert len(rivals.decoys) == 2
