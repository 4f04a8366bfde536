import pytest

import datasets
from tests.processes import python


@pytest.mark.parametrize("name", datasets.__all__)
def test_every_name_leads_somewhere(name):
    assert getattr(datasets, name).__name__ == name
    assert name in dir(datasets)


def test_no_other_name():
    with pytest.raises(AttributeError, match="module 'datasets' has no attribute 'Recordings'"):
        _ = datasets.Recordings


def test_the_list_of_recordings_is_read_without_compiled_code():
    code = "import sys; from datasets.downloading import known_recordings; known_recordings(); "
    assert (
        python("-c", f"{code}print({{'numpy', 'numba', 'rosbags', 'requests'}} & set(sys.modules))").stdout == "set()\n"
    )
