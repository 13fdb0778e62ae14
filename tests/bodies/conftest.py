import sys
from pathlib import Path

# pytest's importlib mode imports test files alone: this lets them share `toys`.
sys.path.insert(0, str(Path(__file__).parent))
