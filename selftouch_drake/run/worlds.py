"""The bodies of a run: its robot, from the models at the start of the run."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy.sparse import csr_array, vstack

from selftouch_drake.agent.body import Body
from selftouch_drake.bodies.embodiment import (
    Bodies,
    World,
    bodies_of,
    kept_skins,
    make_bodies,
    without_robot,
)
from selftouch_drake.bodies.own import open_reference
from selftouch_drake.bodies.user_body import UserBody
from selftouch_drake.experience.store import ExperienceReader, Shard, shards_of, write_shard
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import load_arrays
from selftouch_drake.run.directory import MissingError, RunDirectory, RunError

#: Touches of a run that a body is to feel again; most touches in a shard of those that it met.
_FELT_AGAIN, _IN_A_SHARD = 20, 10_000


class OtherBodyWarning(UserWarning):
    """A body that was given does not feel what the run has felt."""


def require_robot(experiment: Experiment) -> None:
    """Refuses a run without a robot that Drake simulates.

    Raises:
        MissingError: it has none.
    """
    if (reason := without_robot(experiment)) is not None:
        raise MissingError(reason)


def run_bodies(run: RunDirectory) -> Bodies:
    """The bodies of a run: the same for all calls from one thread, until others are asked for.

    The run keeps its skins for other processes and later commands.

    Raises:
        RunError: a model was edited since the start of the run, or another version of the program
            made its skins otherwise.
        ValueError: as `build_world`.
    """
    run.require_models()
    known = run.experiment.after(0), run.fingerprint()
    if not bodies_of.knows(*known):
        bodies = make_bodies(known[0], run.cache, known[1], run.known_baseline())
        if bodies.world is not None:
            _require_skins(run, bodies.world)
        bodies_of.keep(bodies, *known)
    return bodies_of(*known)


def _require_skins(run: RunDirectory, world: World) -> None:
    """Refuses skins that differ from those with which a run felt: its readings mean others.

    Raises:
        RunError: they differ.
    """
    if not run.skin.exists():
        return
    stored = load_arrays(run.skin)
    for skin in world.skins:
        for key in ("vertices", "faces", "p_LS"):
            felt, made = stored.get(f"{skin.name}_{key}"), getattr(skin.fields, key)
            if felt is None or felt.shape != made.shape or not np.allclose(felt, made, atol=1e-6):
                raise RunError(
                    f"{run.path} felt with another skin {skin.name!r}: an older version made it "
                    "otherwise; babble again, or use that version"
                )


def babbling_body(run: RunDirectory, experiment: Experiment, fingerprint: str) -> Body:
    """The body that babbles, for jobs: of the run's experiment, or as it is after a change."""
    known = experiment, fingerprint
    if not bodies_of.knows(*known):
        bodies_of.keep(make_bodies(experiment, baseline=run.known_baseline()), *known)
    return bodies_of(*known).babbling


@contextmanager
def with_user_body(run: RunDirectory, reference: str | None) -> Iterator[None]:
    """Keeps the touches that a user's body meets meanwhile, for `selftouch learn --add`.

    The reference, such as `my_body.py:MyBody`, is the body in which the agent lives from now on. A
    run may have one that was imported, or whose body Drake does not simulate.

    Raises:
        BodyError: as `open_reference`.
        RunError: it is not the body of this run.

    Warns:
        OtherBodyWarning: it feels nothing where the run did.
    """
    if reference is not None:
        keep_bodies(run, _opened(run, reference))
    elif run.experiment.has_truth or run.experiment.imported is not None:
        yield
        return
    body = run_bodies(run)
    assert isinstance(body, UserBody)
    body.met = []
    try:
        yield
    finally:
        met, body.met = body.met, None
        if met:
            q, felt = np.concatenate([q for q, _ in met]), vstack([felt for _, felt in met], "csr")
            for first in range(0, len(q), _IN_A_SHARD):
                rows = slice(first, first + _IN_A_SHARD)
                _keep_met(run, q[rows], felt[rows])


def _keep_met(run: RunDirectory, q: np.ndarray, sensation: csr_array) -> None:
    known = [*shards_of(run.met), *shards_of(run.added)]
    shard = Shard(
        walk=max((int(path.stem.removeprefix("part-")) for path in known), default=-1) + 1,
        num_steps=len(q),
        step=np.arange(len(q)),
        q=q,
        sensation=sensation.toarray(),
    )
    write_shard(run.path, shard, fingerprint=run.fingerprint(), folder=run.met.name)


def _opened(run: RunDirectory, reference: str) -> UserBody:
    """The body that a user names for a run."""
    if run.experiment.has_truth:
        raise RunError(
            f"--body is {reference}, but {run.path} has a robot that Drake simulates: leave "
            "--body out"
        )
    body, imported = open_reference(reference), run.experiment.imported
    joints, num_receptors = list(body.joint_names), run.num_receptors
    if imported is not None and joints != imported.joints:
        raise RunError(
            f"--body has the joints {', '.join(joints)}, and the run {', '.join(imported.joints)}; "
            "give the body that was recorded, with the names of its columns"
        )
    if body.num_receptors != num_receptors:
        raise RunError(
            f"--body has {body.num_receptors} receptors, and the run {num_receptors}; give the "
            "body that was recorded"
        )
    opened = UserBody(body, run.known_baseline())
    if (still := opened.still) is not None:
        _, q = next(run.touches().touches())
        some = q[:: max(len(q) // _FELT_AGAIN, 1)]
        again = int(still.feel(some.astype(float)).sensation.any(axis=1).sum())
        if again < len(some) / 2:
            warnings.warn(
                f"--body feels something at {again} of {len(some)} touches of the run: are its "
                "readings and joints those of the recording, in the same units?",
                OtherBodyWarning,
                stacklevel=2,
            )
    return opened


def add_met(run: RunDirectory) -> int:
    """Adds the touches that were met to the experience; returns how many are added by now."""
    run.added.mkdir(exist_ok=True)
    for shard in shards_of(run.met):
        shard.rename(run.added / shard.name)
    return ExperienceReader(run.added).num_rows if shards_of(run.added) else 0


def make_world(run: RunDirectory) -> World:
    """The world of a run with a robot; as `run_bodies`.

    Raises:
        MissingError: it has no robot.
    """
    require_robot(run.experiment)
    world = run_bodies(run).world
    assert world is not None
    return world


def keep_bodies(run: RunDirectory, bodies: Bodies) -> None:
    """Makes `bodies` those that `run_bodies` returns; skins are kept for other processes.

    The run keeps the names of their joints.
    """
    if (world := bodies.world) is not None:
        run.keep_joint_names(world.robot.joint_names)
        kept_skins(run.cache, run.fingerprint(), world)
    elif isinstance(bodies, UserBody):
        run.keep_joint_names(bodies.joint_names)
        bodies.baseline = bodies.baseline or run.known_baseline()
    bodies_of.keep(bodies, run.experiment.after(0), run.fingerprint())
