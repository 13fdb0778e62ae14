"""Random postures of a robot: any possible ones, or those in which it touches itself."""

import numpy as np

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot import Touches, World

# Postures per batch. Of a robot that touches itself in one of thirty, some of them touch.
_BATCH = 512
# Number of batches, or of single postures, after which a search gives up.
_MOST_BATCHES = 400

#: Which touchers press which skins: pairs of the number of a skin and of a toucher.
TouchingPairs = frozenset[tuple[int, int]]


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
        self, random: np.random.Generator, pairs: TouchingPairs | None = None
    ) -> tuple[np.ndarray, Touches]:
        """A posture `(J,)` rad or m that the robot can take, and its touches, which are firm.

        Args:
            random: source of randomness; a new one decides all postures from now on.
            pairs: those that are to touch, and no others; any by default.

        Raises:
            ExperimentError: no such posture was found among very many.
        """
        if random is not self._random:
            self._random, self._left = random, []
        for _ in range(_MOST_BATCHES):
            for number, (_, touches) in enumerate(self._left):
                if pairs is None or touching_pairs(touches) == pairs:
                    return self._left.pop(number)
            self._left = self._search(random)
        raise ExperimentError(
            f"none of {_BATCH * _MOST_BATCHES} random postures makes the wanted touch; see what "
            "can touch what with `selftouch robot EXPERIMENT --show`"
        )

    def _search(self, random: np.random.Generator) -> list[tuple[np.ndarray, Touches]]:
        """The possible postures with firm touches in one batch of random ones."""
        lower, upper = self._world.robot.babbled_range
        q = random.uniform(lower, upper, (_BATCH, len(lower)))
        rows, touches = self._world.probe.felt_rows(q)
        if not len(rows):
            return []
        strength = np.linalg.norm(touches.sensation, axis=1)
        firm = np.flatnonzero(strength >= np.median(strength))
        possible = firm[~self._world.probe.impossible(q[rows[firm]])]
        return [(q[rows[number]], touches.of_rows(np.array([number]))) for number in possible]


def touching_pairs(touches: Touches) -> TouchingPairs:
    """The pairs that touch at any of some instants."""
    return frozenset(zip(touches.skin.tolist(), touches.toucher.tolist(), strict=True))
