import sys
from pathlib import Path

import pytest

# pytest's importlib mode imports test files alone: this lets them share `robots`.
sys.path.insert(0, str(Path(__file__).parent))

import robots
from shipped_worlds import cube_world, open_world, two_arms, world  # noqa: F401


@pytest.fixture(scope="session")
def turning_body():
    """A torus on a neck of three joints."""
    return robots.shipped("turning_body")
