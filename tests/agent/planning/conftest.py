import pytest
from by_hand import ring_by_hand


@pytest.fixture(scope="session")
def ring():
    return ring_by_hand()


@pytest.fixture(scope="session")
def make_ring():
    return ring_by_hand
