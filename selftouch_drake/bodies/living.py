"""Bodies of others as an agent lives in them: raw readings become sensations."""

from __future__ import annotations

import atexit
from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body import BodyError, Felt, Followed
from selftouch_drake.agent.calibration import Calibration, calibrate
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.experience.collect import random_walk, walker_of
from selftouch_drake.experiment import Experiment

#: A body that stops at least this share of a joint's range before a place has something in its way.
#: Then it goes by two random postures, most of which touch nothing, and tries again. Of 30 ways
#: between touches of the tests' arm in MuJoCo, 30 % are free when they are straight, and 97 % after
#: so many rounds.
_BLOCKED, _BY, _ROUNDS = 0.1, 2, 4

#: Rows from which a skin is calibrated, and s of the robot after which there are enough.
_ROWS, _LONG_ENOUGH_S = 2000, 60.0


class LivingBody:
    """A body of others: it babbles, practises and acts, and nobody knows its truth.

    Its raw readings become sensations; the import uses the same calibration. It is left at rest
    when the program ends. The agent calibrates its receptors itself if they are not calibrated yet.

    Attributes:
        met: touches that it meets from now on, if it is to note them: they are experience too.
    """

    world = None

    def __init__(self, body: CheckedBody, calibration: Calibration | None = None):
        self._body, self.calibration = body, calibration
        self.joint_names, self.jumps = body.joint_names, body.jumps
        self.lower, self.upper = body.lower, body.upper
        self.velocity, self.acceleration = body.velocity, body.acceleration
        self.num_receptors = body.num_receptors
        self.met: list[Felt] | None = None
        # Where the last motion was to end.
        self._at: np.ndarray | None = None
        self._rng = np.random.default_rng(0)
        atexit.register(body.close)

    @property
    def babbling(self) -> LivingBody:
        """The body, with sensations.

        Raises:
            BodyError: its receptors are not calibrated yet.
        """
        if self.calibration is None:
            raise BodyError(f"{self._body.name} is not calibrated: babble first")
        return self

    practice = acting = babbling

    @property
    def still(self) -> LivingBody | None:
        """The body, if it can be at rest everywhere."""
        return self.babbling if self.jumps else None

    @property
    def robot_s(self) -> float:
        """s, time of the robot so far.

        Raises:
            AttributeError: a body that jumps keeps no time.
        """
        if self.jumps:
            raise AttributeError("robot_s")
        return self._body.robot_s

    def feel(self, q: np.ndarray) -> Felt:
        """As of `Body`, with sensations."""
        felt = self._body.feel(q)
        self._at = None
        return self._noted(replace(felt, sensation=self._sensation(felt.sensation)))

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As of `Body`, with sensations; a body that travels goes to the first one before."""
        there = self._at is not None and np.array_equal(q[0], self._at)
        if not (self.jumps or there):
            self._go(q[:1])
        followed = self._body.follow(time_s, q)
        self._at = q[-1].copy()
        followed = replace(followed, sensation=self._sensation(followed.sensation))
        self._noted(followed.felt())
        return followed

    def calibrate(self, experiment: Experiment) -> Calibration:
        """Calibrates the receptors: the body walks at random, in touch or not.

        Raises:
            BodyError: what the body reads cannot be calibrated.
        """
        walker, path = walker_of(experiment, self._body), random_walk(experiment, self._body, 0)
        if walker.timed:
            start = path.steps(1)
            self._body.feel(start)
            walker.begin_at(start[0])
        parts, num_rows, began = list[Felt](), 0, self._body.robot_s
        while num_rows < _ROWS and self._body.robot_s - began < _LONG_ENOUGH_S:
            size = walker.batch if walker.timed else _ROWS
            parts.append(walker.walk(path.steps(size)))
            num_rows += len(parts[-1].q)
        q, readings = (np.concatenate([getattr(p, n) for p in parts]) for n in ("q", "sensation"))
        try:
            self.calibration = calibrate(q, readings)
        except ValueError as error:
            raise BodyError(f"{self._body.name} cannot be calibrated: {error}") from None
        return self.calibration

    def _go(self, q: np.ndarray) -> None:
        """Travels to `(1, J)`, round what is in the way."""
        least = _BLOCKED * (self.upper - self.lower)
        for _ in range(_ROUNDS):
            if (np.abs(self._body.feel(q).q - q) < least).all():
                return
            self._body.feel(self._rng.uniform(self.lower, self.upper, (_BY, len(least))))
        self._body.feel(q)

    def _sensation(self, readings: np.ndarray) -> np.ndarray:
        calibration = self.babbling.calibration
        assert calibration is not None
        return calibration.sensation(readings)

    def _noted(self, felt: Felt) -> Felt:
        if self.met is not None:
            _, touches = felt.touches()
            self.met.append(touches.of_rows(np.flatnonzero(touches.reached)))
        return felt
