"""A chain that is known, for tests of what changes."""

import pytest
from hand_made_chains import ArmOnBall

from selftouch_drake.agent.body_model.known_chain import found_chain


@pytest.fixture(scope="session")
def known():
    """The chain of an arm on a ball, from 400 touches."""
    return found_chain(*ArmOnBall().touches(400))


@pytest.fixture(scope="session")
def usual():
    """Other touches of it."""
    return ArmOnBall().touches(200, seed=5)
