import sys
from pathlib import Path

import pytest

# pytest's importlib mode imports test files alone: this lets them share `laying`.
sys.path.insert(0, str(Path(__file__).parent))

from laying import Hand, skin_fields

from selftouch_drake.geometry import surfaces


@pytest.fixture(scope="session")
def sphere():
    """Fields of receptors on a ball of 0.2 m."""
    return skin_fields(surfaces.sphere(0.2))


@pytest.fixture(scope="session")
def torus():
    """Fields of receptors on a torus."""
    return skin_fields(surfaces.torus(0.22, 0.09), num_receptors=60)


@pytest.fixture(scope="session")
def tube():
    """Fields on a cylinder, which is a tube if it is touched on its side alone."""
    return skin_fields(surfaces.cylinder(0.1, 0.4), num_receptors=60)


@pytest.fixture
def hand():
    """Places touches on skins."""
    return Hand()
