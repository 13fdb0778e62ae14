import sys
from pathlib import Path

# pytest's importlib mode imports each test file by itself: this lets them use these folders.
TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS.parent / "benchmarks"), str(TESTS / "quotient")]
