"""The world of a run: its robot as Drake builds it, from the models at the start of the run."""

from __future__ import annotations

import hashlib
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from selftouch_drake.experience.collect import world_of
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import content_digest, kept_arrays
from selftouch_drake.robot import World
from selftouch_drake.robot.skins import ARRAYS, SkinModel, make_skins
from selftouch_drake.robot.world import MakeSkins, drakes_refusals
from selftouch_drake.run.directory import MissingError, RunDirectory


class NoWorldError(MissingError):
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


def build_world(experiment: Experiment, make_skins: MakeSkins = make_skins) -> World:
    """The world of an experiment, with its robot built.

    Args:
        experiment: the experiment.
        make_skins: as of `World`.

    Raises:
        ExperimentError: Drake refuses it; the text is Drake's own.
        NoWorldError: the experience was imported.
        ValueError: the experiment names what the robot does not have, or a skin cannot be made.
    """
    require_robot(experiment)
    world = World(experiment, make_skins)
    with drakes_refusals():
        _ = world.robot
    return world


def make_world(run: RunDirectory) -> World:
    """The world of a run: the same for all calls from one thread, until another is asked for.

    The run keeps its skins for other processes and later commands.

    Raises:
        RunError: a model was edited since the start of the run.
        ValueError: as `build_world`.
    """
    run.require_models()
    known = run.experiment, run.fingerprint()
    if not world_of.knows(*known):
        world_of.keep(build_world(run.experiment, partial(_kept_skins, run)), *known)
    return world_of(*known)


def keep_world(run: RunDirectory, world: World) -> None:
    """Makes `world` the one that `make_world` returns; its skins are kept for other processes."""
    _kept_skins(run, run.experiment, lambda _: world.skins)
    world_of.keep(world, run.experiment, run.fingerprint())


def _kept_skins(
    run: RunDirectory, experiment: Experiment, make: MakeSkins = make_skins
) -> tuple[SkinModel, ...]:
    """As `make_skins`, whose results are kept in the run for the same experience and program."""

    def as_arrays() -> dict[str, np.ndarray]:
        return {
            f"{skin.name}_{key}": array
            for skin in make(experiment)
            for key, array in skin.to_arrays().items()
        }

    made_from = hashlib.sha256(f"{run.fingerprint()} {_program()}".encode()).hexdigest()[:16]
    names = [f"{name}_{key}" for name in experiment.skins for key in ARRAYS]
    arrays = kept_arrays(run.cache / f"skins-{made_from}.npz", names, as_arrays)
    return tuple(
        SkinModel.from_arrays(name, skin.link, {key: arrays[f"{name}_{key}"] for key in ARRAYS})
        for name, skin in experiment.skins.items()
    )


@lru_cache
def _program() -> str:
    """Identifies the program that makes skins."""
    package = Path(__file__).parents[1]
    files = sorted(f for room in ("geometry", "robot") for f in (package / room).glob("*.py"))
    return " ".join(content_digest(file) for file in files)
