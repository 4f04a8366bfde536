import numpy as np
import pytest

from tbmslam.calibration.hand_eye import deviations_of_parts

PARTS, NUMBERS = 6, 3


def told(generator, claimed):
    """Return what parts tell with errors of 1, 2 and 3, each taking itself to know it so many times as well."""
    deviations = np.array([1.0, 2.0, 3.0])
    values = generator.normal(0.0, deviations, (PARTS, NUMBERS))
    informations = np.tile(np.diag((deviations / claimed) ** -2.0), (PARTS, 1, 1))
    return values, informations, values.mean(axis=0)


def test_parts_that_know_less_than_they_agree_are_believed(generator):
    found = deviations_of_parts(*told(generator, 0.1))
    np.testing.assert_allclose(found, np.array([10.0, 20.0, 30.0]) / np.sqrt(PARTS))


@pytest.mark.parametrize("claimed", [10.0, 1000.0])
def test_parts_that_differ_more_than_they_say_are_not(generator, claimed):
    """For parts that are all alike it is the standard error of their mean."""
    values, informations, mean = told(generator, claimed)
    expected = values.std(axis=0, ddof=1) / np.sqrt(PARTS)
    np.testing.assert_allclose(deviations_of_parts(values, informations, mean), expected)


def test_a_part_without_information_has_no_influence(generator):
    values, informations, mean = told(generator, 10.0)
    before = deviations_of_parts(values, informations, mean)
    values, informations = np.vstack((values, [[1e6] * 3])), np.concatenate((informations, 1e-12 * np.eye(3)[None]))
    after = deviations_of_parts(values, informations, mean)
    np.testing.assert_allclose(after, before * np.sqrt(7 / 6 * 5 / 6), rtol=1e-3)


def test_the_stated_deviation_equals_the_mean_error(generator):
    """Of numbers that each part knows along other directions, as walls tell poses."""
    off = []
    for _ in range(400):
        axes = generator.normal(size=(PARTS, NUMBERS, NUMBERS))
        informations = axes @ np.swapaxes(axes, 1, 2) + 0.1 * np.eye(NUMBERS)
        roots = np.linalg.cholesky(np.linalg.inv(informations))
        values = 2.0 * np.einsum("pij,pj->pi", roots, generator.normal(size=(PARTS, NUMBERS)))
        mean = np.linalg.solve(informations.sum(axis=0), np.einsum("pij,pj->i", informations, values))
        off.append(mean / deviations_of_parts(values, informations, mean))
    assert 0.85 < np.sqrt(np.mean(np.square(off))) < 1.4
