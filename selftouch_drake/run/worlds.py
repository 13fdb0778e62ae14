"""The world of a run: its robot as Drake builds it, from the models that the run was begun with."""

from __future__ import annotations

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.world import drakes_refusals
from selftouch_drake.run.directory import RunDirectory


def build_world(experiment: Experiment) -> World:
    """The world of an experiment, with its robot built.

    Raises:
        ExperimentError: Drake refuses it; the text is Drake's own.
        ValueError: the experiment names what the robot does not have, or a skin cannot be made.
    """
    world = World(experiment)
    with drakes_refusals():
        _ = world.robot
    return world


def make_world(run: RunDirectory) -> World:
    """The world of a run.

    Raises:
        RunError: a model was edited since the run was begun.
        ValueError: as `build_world`.
    """
    run.require_models()
    return build_world(run.experiment)
