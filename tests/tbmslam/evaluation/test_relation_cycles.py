import itertools
import math

import numpy as np
import pytest

from tbmslam.evaluation.relation_cycles import relation_noise
from tbmslam.evaluation.relations import Relations
from tbmslam.geometry.se2 import SE2


def relations(poses, position, heading, seed=0, reach=2):
    """Return relations between poses up to some steps apart, with noise [m], [rad]; some are stated backwards."""
    generator, stamps, motions = np.random.default_rng(seed), [], []
    for first, second in itertools.combinations(range(len(poses)), 2):
        if second - first <= reach:
            start, end = (second, first) if generator.uniform() < 0.5 else (first, second)
            noise = SE2(*generator.normal(0.0, position, 2), generator.normal(0.0, heading))
            stamps.append((float(start), float(end)))
            motions.append((*(poses[start].to(poses[end]) @ noise),))
    return Relations(np.array(stamps), np.array(motions))


def drive(number=400):
    return [SE2(0.3 * math.cos(0.1 * k), 0.3 * math.sin(0.1 * k), 0.2 * k) for k in range(number)]


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_relations_is_found_without_any_other_truth(seed):
    noise = relation_noise(relations(drive(), 0.02, 0.004, seed))
    # Means of a Rayleigh and of a half-normal distribution.
    assert noise.translation_m == pytest.approx(0.02 * math.sqrt(math.pi / 2), rel=0.1)
    assert noise.rotation_deg == pytest.approx(math.degrees(0.004) * math.sqrt(2 / math.pi), rel=0.1)
    assert noise.cycles == 398


def test_relations_of_one_trajectory_and_few_cycles_say_nothing():
    assert relation_noise(relations(drive(), 0.0, 0.0)) is None
    assert relation_noise(relations(drive(21), 0.02, 0.004)) is None
    assert relation_noise(relations(drive(22), 0.02, 0.004)) is not None
    assert relation_noise(relations(drive(), 0.02, 0.004, reach=1)) is None
