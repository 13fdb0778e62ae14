import sys
from pathlib import Path

# pytest's importlib mode imports each test file by itself: this lets them use this folder.
sys.path.append(str(Path(__file__).parents[1] / "quotient"))
