"""Sweep of two parameters that several tests share."""

import pytest
from turning import run_sweep


@pytest.fixture(scope="session")
def speed_radius_sweep():
    return run_sweep({"speed": [4.0, 1.0, 2.0], "radius": [0.5, 0.0, 2.0]})
