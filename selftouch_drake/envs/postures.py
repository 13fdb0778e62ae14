"""Random postures of a robot: any possible ones, or those in which it touches itself."""

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
        if not world.probe.impossible(q[None])[0]:
            return q
    raise ExperimentError(
        f"in each of {_MOST_BATCHES} random postures rigid parts of the robot run into each other; "
        "see them with `selftouch robot EXPERIMENT --show`, or give robot.collision_depth more"
    )


class FirmTouches:
    """Random touching postures, found many at a time and given out one by one.

    Firm is the stronger half of random touches, as in plans.
    """

    def __init__(self, world: World):
        self._world = world
        self._random: np.random.Generator | None = None
        self._left: list[tuple[np.ndarray, Touches]] = []

    def next(
        self, random: np.random.Generator, contacts: Contacts | None = None
    ) -> tuple[np.ndarray, Touches]:
        """A posture `(J,)` rad or m that the robot can take, and its touches, which are firm.

        Args:
            random: source of randomness; a new one decides all postures from now on.
            contacts: pairs that are to touch; any pairs by default.

        Raises:
            ExperimentError: no such posture was found among very many.
        """
        if random is not self._random:
            self._random, self._left = random, []
        for _ in range(_MOST_BATCHES):
            for k, (_, touches) in enumerate(self._left):
                if contacts is None or contacts_of(touches) == contacts:
                    return self._left.pop(k)
            lower, upper = self._world.robot.babbled_range
            q = random.uniform(lower, upper, (_BATCH, len(lower)))
            rows, touches = self._world.probe.felt(q)
            strength = np.linalg.norm(touches.sensation, axis=1)
            firm = np.flatnonzero(strength >= np.median(strength)) if len(rows) else rows
            firm = firm[~self._world.probe.impossible(q[rows[firm]])]
            self._left = [(q[rows[k]], touches.of_rows(np.array([k]))) for k in firm]
        raise ExperimentError(
            f"none of {_BATCH * _MOST_BATCHES} random postures makes the wanted touch; see what "
            "can touch what with `selftouch robot EXPERIMENT --show`"
        )


def contacts_of(touches: Touches) -> Contacts:
    """The touching pairs at any of some instants."""
    return frozenset(zip(touches.skin.tolist(), touches.toucher.tolist(), strict=True))
