"""Many runs of experiments that differ in a few fields, and what their figures say together."""

from selftouch_drake.sweep.design import Sweep, SweepError, load_sweep, shipped_sweeps
from selftouch_drake.sweep.figures import draw_figures
from selftouch_drake.sweep.runs import SweepDirectory, run_sweep
from selftouch_drake.sweep.table import gather, read_table

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
