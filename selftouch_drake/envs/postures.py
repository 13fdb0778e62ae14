"""Random postures of a robot: any possible ones, or those in which it touches itself."""

from __future__ import annotations

import numpy as np

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot import Touches, World

# Postures per batch: with one touch in thirty, some of them touch.
_BATCH = 512
# Number of postures after which the search ends.
_MOST_BATCHES = 400

#: Contacts as pairs of numbers: of a skin and of a toucher.
Contacts = frozenset[tuple[int, int]]


def possible_posture(world: World, random: np.random.Generator) -> np.ndarray:
    """`(J,)` rad or m, a posture that the robot can take, touching or not.

    Raises:
        ExperimentError: the robot can take none of very many.
    """
    for _ in range(_MOST_BATCHES):
        q = random.uniform(*world.robot.babbled_range)
        if world.probe.collision_depth(q[None])[0] == 0:
            return q
    raise ExperimentError(
        f"in each of {_MOST_BATCHES} random postures rigid parts of the robot run into each other; "
        "see them with `selftouch robot EXPERIMENT --show`, or give robot.collision_depth more"
    )


def touching_posture(
    world: World, random: np.random.Generator, contacts: Contacts | None = None
) -> tuple[np.ndarray, Touches]:
    """A posture `(J,)` rad or m that the robot can take, and its touches, which are firm.

    Firm are the stronger half of random touches, as in plans.

    Args:
        world: of the robot.
        random: source of randomness.
        contacts: pairs that are to touch; any pairs by default.

    Raises:
        ExperimentError: no such posture was found among very many.
    """
    lower, upper = world.robot.babbled_range
    for _ in range(_MOST_BATCHES):
        q = random.uniform(lower, upper, (_BATCH, len(lower)))
        rows, touches = world.probe.felt(q)
        strength = np.linalg.norm(touches.sensation, axis=1)
        firm = np.flatnonzero(strength >= np.median(strength)) if len(rows) else rows
        for k in firm:
            found = touches.of_rows(np.array([k]))
            wanted = contacts is None or contacts_of(found) == contacts
            if wanted and world.probe.collision_depth(q[rows[k]][None])[0] == 0:
                return q[rows[k]], found
    raise ExperimentError(
        f"none of {_BATCH * _MOST_BATCHES} random postures makes the wanted touch; see what can "
        "touch what with `selftouch robot EXPERIMENT --show`"
    )


def contacts_of(touches: Touches) -> Contacts:
    """The touching pairs at any of some instants."""
    return frozenset(zip(touches.skin.tolist(), touches.toucher.tolist(), strict=True))
