import sys
from pathlib import Path

# pytest's importlib mode imports each test file by itself: this lets them share `bodies_by_hand`.
sys.path.insert(0, str(Path(__file__).parents[2] / "quotient"))
