import pytest

from merging.pairwise.executor import Executor


def test_somebody_has_to_do_the_work():
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        Executor(workers=0)
