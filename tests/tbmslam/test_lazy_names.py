import pytest

import datasets
import merging
import tbmslam
from tests.processes import python

PACKAGES = (datasets, merging, tbmslam)
NAMES = [(package, name) for package in PACKAGES for name in package.__all__]


@pytest.mark.parametrize(("package", "name"), NAMES, ids=str)
def test_every_name_leads_somewhere(package, name):
    assert getattr(package, name).__name__ == name
    assert name in dir(package)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_other_name(package):
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'Slamm'"):
        _ = package.Slamm


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_loaded_when_they_are_used(package):
    code = f"import sys, {package.__name__}; print({{'numpy', 'numba', 'rosbags'}} & set(sys.modules))"
    assert python("-c", code).stdout == "set()\n"
