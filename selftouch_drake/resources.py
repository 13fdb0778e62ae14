"""Folders of shipped models, experiments, sweeps, recordings: in a wheel, or beside the package."""

import itertools
import re
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_ROOT = _PACKAGE if (_PACKAGE / "models").is_dir() else _PACKAGE.parent

MODELS = _ROOT / "models"
EXPERIMENTS = _ROOT / "experiments"
SWEEPS = _ROOT / "sweeps"
RECORDINGS = _ROOT / "recordings"


def shipped(folder: Path) -> list[str]:
    """The names of the YAML files in one of these folders."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def summary(file: Path) -> str:
    """The first sentence of the comment at the beginning of a YAML file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comments = itertools.takewhile(lambda line: line.startswith("#"), lines)
    comment = " ".join(line.removeprefix("#").strip() for line in comments)
    return re.split(r"(?<=[.?]) ", comment)[0]
