import pytest


@pytest.fixture
def robot(drive_in):
    return drive_in("apartment", 30.0, odometry="good")
