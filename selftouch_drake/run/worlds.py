"""The bodies of a run: its robot, from the models at the start of the run."""

from __future__ import annotations

from selftouch_drake.agent.body import Body
from selftouch_drake.bodies.embodiment import (
    Bodies,
    World,
    bodies_of,
    kept_skins,
    make_bodies,
)
from selftouch_drake.experiment import Experiment
from selftouch_drake.run.directory import MissingError, RunDirectory


class NoWorldError(MissingError):
    """The experience was imported: there is no robot, so no world can be built."""


def require_robot(experiment: Experiment) -> None:
    """Refuses a run without a robot that Drake simulates.

    Raises:
        NoWorldError: it has none.
    """
    if experiment.imported is not None:
        raise NoWorldError(
            f"{experiment.name} was imported, without a robot to simulate: use learn, "
            "plan and report, and execute its plans on the robot that recorded it"
        )
    if not experiment.has_truth:
        raise NoWorldError(
            f"{experiment.name} has a body from {experiment.body_from}, which Drake does not "
            "simulate: there is nothing to show"
        )


def run_bodies(run: RunDirectory) -> Bodies:
    """The bodies of a run: the same for all calls from one thread, until others are asked for.

    The run keeps its skins for other processes and later commands.

    Raises:
        RunError: a model was edited since the start of the run.
        ValueError: as `build_world`.
    """
    run.require_models()
    known = run.experiment.after(0), run.fingerprint()
    if not bodies_of.knows(*known):
        bodies_of.keep(make_bodies(known[0], run.cache, known[1], run.known_calibration()), *known)
    return bodies_of(*known)


def babbling_body(run: RunDirectory, experiment: Experiment, fingerprint: str) -> Body:
    """The body that babbles, for jobs: of the run's experiment, or as it is after a change."""
    known = experiment, fingerprint
    if not bodies_of.knows(*known):
        bodies_of.keep(make_bodies(experiment, calibration=run.known_calibration()), *known)
    return bodies_of(*known).babbling


def make_world(run: RunDirectory) -> World:
    """The world of a run with a robot; as `run_bodies`.

    Raises:
        NoWorldError: it has no robot.
    """
    require_robot(run.experiment)
    world = run_bodies(run).world
    assert world is not None
    return world


def keep_bodies(run: RunDirectory, bodies: Bodies) -> None:
    """Makes `bodies` those that `run_bodies` returns; skins are kept for other processes."""
    if (world := bodies.world) is not None:
        kept_skins(run.cache, run.fingerprint(), run.experiment, lambda _: world.skins)
    bodies_of.keep(bodies, run.experiment.after(0), run.fingerprint())
