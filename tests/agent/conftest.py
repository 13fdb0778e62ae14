import sys
from pathlib import Path

# pytest's importlib mode imports each test file by itself: this lets them share `skins`.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "body_model")]
