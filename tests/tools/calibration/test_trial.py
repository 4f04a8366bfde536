import pytest

from merging import MergeConfig
from merging.nonrigid import hypotheses
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tests.merging.bent_floor import bent_maps
from tools.calibration.trial import Trial
from tools.map_pairs.known_pair import KnownPair

# One worker makes and aligns the bent maps for all of them.
pytestmark = pytest.mark.xdist_group("bent_maps")


@pytest.fixture(scope="module", params=[False, True], ids=["as it is", "swapped"])
def bent(request):
    """Return a distorted pair, its trial after deformation, and the pairs of maps that were correlated for it."""
    target, source, true = bent_maps("store")
    pair = KnownPair("crop_store_1_100", target, source, true, 1.0)
    if request.param:
        pair = KnownPair("crop_store_1_100", source, target, true.inverse(), 1.0)
    correlated, propose = [], hypotheses.propose
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hypotheses, "propose", lambda *maps: correlated.append(maps) or propose(*maps))
        return pair, Trial.of_deformed(pair, MergeConfig()), correlated


def test_the_evidence_of_distorted_maps_is_collected_after_deformation(bent):
    pair, deformed, _ = bent
    rigid = Trial.of(pair, MergeConfig())
    assert deformed.near[0]
    assert deformed.near.sum() == 1
    assert deformed.candidates[0].agreed_wall_m > 1.5 * max(one.agreed_wall_m for one in rigid.candidates)
    assert len(deformed.candidates) <= 1 + 2 * MergeConfig().nonrigid.rivals
    assert max(one.agreement for one in deformed.decoys) < deformed.candidates[0].agreement


def test_the_map_and_its_mirror_image_are_correlated_once(bent):
    _, _, correlated = bent
    assert len(correlated) == 2


def test_maps_that_do_not_fit_are_not_deformed():
    target, _, _ = bent_maps("store")
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 30, 30)))
    for other in (empty, bent_maps("office")[0]):
        assert Trial.of_deformed(KnownPair("negd_store_office_1", target, other, None, None), MergeConfig()) is None
