"""Fixtures of shipped robots, for tests of robots and of systems."""

import pytest
import robots


@pytest.fixture(scope="session", params=robots.SHIPPED)
def world(request):
    """The world of each of the shipped robots."""
    return robots.shipped(request.param)


@pytest.fixture(scope="session", params=[n for n in robots.SHIPPED if n != "infant"])
def open_world(request):
    """The world of each robot without rigid parts that may collide."""
    return robots.shipped(request.param)


@pytest.fixture(scope="session")
def cube_world():
    """One finger on a cube."""
    return robots.shipped("cube")


@pytest.fixture(scope="session")
def two_arms():
    """Two arms; each forearm wears a skin that the other hand can touch."""
    return robots.shipped("two_arms")
