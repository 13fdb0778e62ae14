import sys
from pathlib import Path

import pytest
from untrained import train_nothing

# pytest's importlib mode imports each test file by itself: this lets them share `skins`.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "body_model")]


@pytest.fixture(scope="module")
def module_without_networks():
    """As `without_networks`, until the module ends."""
    with pytest.MonkeyPatch.context() as patch:
        train_nothing(patch)
        yield


@pytest.fixture
def without_networks(monkeypatch):
    """Parts, places and shapes are asked for, and not what networks find."""
    train_nothing(monkeypatch)
