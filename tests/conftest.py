"""What all tests share."""

from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, so that a change and not chance decides; `--hypothesis-profile=default` explores.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

SHARED_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


@pytest.fixture
def shared_data():
    if not SHARED_DATA.is_dir():
        pytest.skip("the folder of shared recordings is absent")
    return SHARED_DATA
