"""Experience of a sphere, and what the paper's own `learn` makes of it."""

import sys
from pathlib import Path

import pytest

from selftouch_drake.quotient import learn

# pytest's importlib mode imports each test file by itself: this lets them share `bodies_by_hand`.
sys.path.insert(0, str(Path(__file__).parent))

from touched_sphere import touch_sphere


@pytest.fixture(scope="session")
def experience():
    return touch_sphere(6000)


@pytest.fixture(scope="session")
def representation(experience):
    return learn(*experience, num_targets=120, max_kernel_size=40, seed=3)
