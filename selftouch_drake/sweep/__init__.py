"""Many runs of experiments that differ in a few fields, and what their metrics show together.

`sweep.runs`, `sweep.table` and `sweep.figures` are imported by those who need them: Drake and
Matplotlib take seconds, and a list of sweeps needs neither.
"""

from selftouch_drake.sweep.design import Sweep, SweepError, load_sweep, shipped_sweeps

__all__ = ["Sweep", "SweepError", "load_sweep", "shipped_sweeps"]
