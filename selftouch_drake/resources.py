"""Where models, experiments and sweeps lie: in a wheel, or beside a checkout's package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_ROOT = _PACKAGE if (_PACKAGE / "models").is_dir() else _PACKAGE.parent

MODELS = _ROOT / "models"
EXPERIMENTS = _ROOT / "experiments"
SWEEPS = _ROOT / "sweeps"
