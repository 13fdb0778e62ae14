"""Loads what a run learned, for programs of others."""

from pathlib import Path

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.motions import Motion
from selftouch_drake.run import artifacts
from selftouch_drake.run.directory import MissingError, RunDirectory


def load_agent(run: RunDirectory | Path | str, *, predicts: bool = False) -> Agent:
    """The agent of a run, or of its path; all else is as in `artifacts.load_agent`."""
    return artifacts.load_agent(opened(run), predicts=predicts)


def load_body_model(run: RunDirectory | Path | str) -> BodyModel:
    """The body model of a run, or of its path, whether the agent accepted it or not.

    Errors are as in `artifacts.load_body_model`.
    """
    return artifacts.load_body_model(opened(run))


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
    run = opened(run)
    try:
        return artifacts.load_motion(run, start, goal)
    except MissingError:
        from selftouch_drake.run.stages import planned  # a stored plan needs no planner

        return planned(run, start, goal)


def opened(run: RunDirectory | Path | str) -> RunDirectory:
    """The run, opened if only its path is given.

    Raises:
        RunError: it is not a run of this version.
    """
    return run if isinstance(run, RunDirectory) else RunDirectory.open(Path(run))
