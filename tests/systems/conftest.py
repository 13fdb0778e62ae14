import sys
from pathlib import Path

# pytest's importlib mode imports test files alone: this lets them share `robots`.
sys.path.insert(0, str(Path(__file__).parents[1] / "robot"))

from shipped_worlds import cube_world, open_world, two_arms, world  # noqa: F401
