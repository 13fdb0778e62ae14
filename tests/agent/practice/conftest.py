import sys
from pathlib import Path

# pytest's importlib mode imports each test file by itself: this lets them share what they make.
sys.path.insert(0, str(Path(__file__).parent))
