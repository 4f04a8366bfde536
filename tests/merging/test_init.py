import pytest

import merging
from tests.processes import python


def test_every_name_is_there_when_it_is_used():
    assert {merging.__getattr__(name).__name__ for name in merging.__all__} == set(merging.__all__)
    assert set(merging.__all__) <= set(dir(merging))


def test_a_wrong_name_is_an_error():
    with pytest.raises(AttributeError, match="'merging' has no attribute 'mereg'"):
        _ = merging.mereg


def test_parameters_do_not_wait_for_methods():
    heavy = "{'scipy.optimize', 'merging.rigid_alignment', 'merging.merger'}"
    code = f"import sys, merging.config; print({heavy} & set(sys.modules))"
    assert python("-c", code).stdout == "set()\n"
