"""Motions of a run for other programs: stored, or planned at once."""

from pathlib import Path

from selftouch_drake.agent.motions import Motion
from selftouch_drake.run.artifacts import load_motion as load_stored_motion
from selftouch_drake.run.directory import MissingError, RunDirectory


def load_motion(run: RunDirectory | Path | str, start: int, goal: int) -> Motion:
    """The motion from one target sensation of a run to another: its stored plan, else a new one.

    A new plan is made as by `selftouch plan`, and is not stored.

    Args:
        run: that has learned, or its path.
        start: number of a target sensation.
        goal: number of a target sensation.

    Raises:
        RunError: there is no such run or target sensation, or nothing was learned.
        ValueError: there is no way, or a file is damaged.
    """
    if not isinstance(run, RunDirectory):
        run = RunDirectory.open(Path(run))
    try:
        return load_stored_motion(run, start, goal)
    except MissingError:
        from selftouch_drake.run.stages import planned  # a stored plan needs no planner

        return planned(run, start, goal)
