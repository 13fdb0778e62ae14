"""The world of a run: its robot as Drake builds it, from the models at the start of the run."""

from __future__ import annotations

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot import World
from selftouch_drake.robot.world import drakes_refusals
from selftouch_drake.run.directory import RunDirectory


class NoWorldError(ExperimentError):
    """The experience was imported: there is no robot, so no world can be built."""


def require_robot(experiment: Experiment) -> None:
    """Refuses a run without a robot: its experience was imported.

    Raises:
        NoWorldError: it was.
    """
    if experiment.imported is not None:
        raise NoWorldError(
            f"{experiment.name} was imported, without a robot to simulate: use learn, "
            "plan and report, and execute its plans on the robot that recorded it"
        )


def build_world(experiment: Experiment) -> World:
    """The world of an experiment, with its robot built.

    Raises:
        ExperimentError: Drake refuses it; the text is Drake's own.
        NoWorldError: the experience was imported.
        ValueError: the experiment names what the robot does not have, or a skin cannot be made.
    """
    require_robot(experiment)
    world = World(experiment)
    with drakes_refusals():
        _ = world.robot
    return world


def make_world(run: RunDirectory) -> World:
    """The world of a run.

    Raises:
        RunError: a model was edited since the start of the run.
        ValueError: as `build_world`.
    """
    run.require_models()
    return build_world(run.experiment)
