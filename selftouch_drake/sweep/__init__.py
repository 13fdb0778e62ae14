"""Many runs of experiments that differ in a few fields, and what their figures say together."""

import importlib
from typing import Any

from selftouch_drake.sweep.design import Sweep, SweepError, load_sweep, shipped_sweeps

__all__ = [
    "Sweep",
    "SweepDirectory",
    "SweepError",
    "draw_figures",
    "gather",
    "load_sweep",
    "read_table",
    "run_sweep",
    "shipped_sweeps",
]

# Imported when asked for: Drake and Matplotlib take seconds, and a list of sweeps needs neither.
_LATER = {
    "SweepDirectory": "runs",
    "draw_figures": "figures",
    "gather": "table",
    "read_table": "table",
    "run_sweep": "runs",
}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
