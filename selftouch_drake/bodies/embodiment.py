"""Makes the bodies of an experiment; each thread keeps those that it asked for last."""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Body
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.readings.baseline import Baseline
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.own import open_body
from selftouch_drake.bodies.user_body import UserBody
from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.files import content_digest, kept_arrays
from selftouch_drake.robot import World
from selftouch_drake.robot.models import one_line
from selftouch_drake.robot.skins import ARRAYS, SkinModel
from selftouch_drake.threads import OncePerThread

#: The bodies of one agent. They stand for one robot: `babbling` collects experience, in `practice`
#: plans are practised slowly, `acting` executes them, and `still`, where there is one, scores
#: motions without dynamics. Only Drake's have a `world`, which the experimenter knows.
Bodies = DrakeBodies | UserBody


def without_robot(experiment: Experiment) -> str | None:
    """Why Drake has no robot to simulate for an experiment; None if it has."""
    if experiment.imported is not None:
        return (
            f"{experiment.name} was imported, without a robot to simulate: use learn, plan and "
            "report, and execute its plans on the robot that recorded it, or give that robot as a "
            "body, with --body"
        )
    if not experiment.has_truth:
        return (
            f"{experiment.name} has a body from {experiment.body_from}, which Drake does not "
            "simulate: there is nothing to show"
        )
    return None


def build_world(experiment: Experiment, cache: Path | None = None, fingerprint: str = "") -> World:
    """The world of an experiment, with its robot built; arguments are as in `make_bodies`.

    Raises:
        ExperimentError: Drake refuses it, in its own words, or there is no robot.
        ValueError: the experiment names what the robot does not have, or a skin cannot be made.
    """
    if (reason := without_robot(experiment)) is not None:
        raise ExperimentError(reason)
    world = World(experiment)
    with one_line("robot.directives holds a robot that Drake refuses"):
        if cache is not None:
            world.skins = kept_skins(cache, fingerprint, world)
        _ = world.robot
    return world


def make_bodies(
    experiment: Experiment,
    cache: Path | None = None,
    fingerprint: str = "",
    baseline: Baseline | None = None,
) -> Bodies:
    """The bodies of an experiment.

    Args:
        experiment: says whether Drake simulates the body, or whose it is.
        cache: a folder that keeps skins for other processes and later commands.
        fingerprint: of the experience, which depends on the content of the robot's models.
        baseline: of the receptors of a body that Drake does not simulate, if it is known.

    Raises:
        BodyError: a body that Drake does not simulate cannot be made, or does not do what a body
            must.
        ValueError: as `build_world`.
    """
    if experiment.body_from in ("python", "gymnasium"):
        return UserBody(open_body(experiment), baseline)
    return DrakeBodies(build_world(experiment, cache, fingerprint))


@OncePerThread
def bodies_of(experiment: Experiment, fingerprint: str) -> Bodies:
    """As `make_bodies`, for jobs: Drake's diagrams cannot be pickled."""
    return make_bodies(experiment)


def pilot_in(bodies: Bodies, agent: Agent, experiment: Experiment) -> Pilot:
    """An agent in its bodies, as its experiment says."""
    return Pilot(
        agent,
        bodies.acting,
        bodies.practice,
        seed=experiment.seed,
        touch_servo=experiment.execution.touch_servo,
    )


def body_of(experiment: Experiment, fingerprint: str) -> Body:
    """The body that babbles, for jobs."""
    return bodies_of(experiment, fingerprint).babbling


def compile_for_babbling(experiment: Experiment, fingerprint: str, number: int) -> None:
    """Has a worker build its body, and compile what walks need.

    Two workers, of numbers 0 and 1, begin with different functions; each then finds the other
    function compiled.
    """
    if not experiment.has_truth:
        return  # a body of one's own may be there only once
    world = bodies_of(experiment, fingerprint).world
    assert world is not None
    q = np.zeros((1, len(world.robot.lower)), dtype=np.float32)
    asked: list[Callable[[np.ndarray], object]] = [world.probe.touches, world.probe.impossible]
    for ask in asked if number == 0 else reversed(asked):
        ask(q)


def kept_skins(cache: Path, fingerprint: str, world: World) -> tuple[SkinModel, ...]:
    """The skins of a world: those kept for the same experience and program, or made now."""

    def as_arrays() -> dict[str, np.ndarray]:
        return {
            f"{skin.name}_{key}": array
            for skin in world.skins
            for key, array in skin.to_arrays().items()
        }

    made_from = hashlib.sha256(f"{fingerprint} {_program()}".encode()).hexdigest()[:16]
    wanted = world.experiment.skins
    names = [f"{name}_{key}" for name in wanted for key in ARRAYS]
    arrays = kept_arrays(cache / f"skins-{made_from}.npz", names, as_arrays)
    return tuple(
        SkinModel.from_arrays(name, skin.link, {key: arrays[f"{name}_{key}"] for key in ARRAYS})
        for name, skin in wanted.items()
    )


@lru_cache
def _program() -> str:
    """Identifies the program that makes skins."""
    package = Path(__file__).parents[1]
    files = sorted(f for room in ("geometry", "robot") for f in (package / room).glob("*.py"))
    return " ".join(content_digest(file) for file in files)
