"""The world of a run: its robot as Drake builds it, from the models at the start of the run."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import yaml

from selftouch_drake.experiment import (
    Experiment,
    ExperimentError,
    dump_experiment,
    experiment_from_fields,
)
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


def as_text(run: RunDirectory) -> tuple[str, str]:
    """A run for another process: its path and its experiment, which may differ from the stored."""
    return str(run.path.resolve()), dump_experiment(run.experiment)


@lru_cache(maxsize=1)
def known_world(path: str, text: str) -> tuple[RunDirectory, World]:
    """The run of `as_text` and its world, built once per process."""
    run = RunDirectory(Path(path), experiment_from_fields(yaml.safe_load(text)))
    return run, make_world(run)
