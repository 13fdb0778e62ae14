"""Bodies of others as an agent lives in them: raw readings become sensations."""

from __future__ import annotations

import atexit
from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body import Body, BodyError, Felt, Followed
from selftouch_drake.agent.calibration import Calibration, calibrate
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.experience.collect import random_walk, walker_of
from selftouch_drake.experiment import Experiment

#: Rows from which a skin is calibrated, and s of the robot after which there are enough.
_ROWS, _LONG_ENOUGH_S = 2000, 60.0


class CalibratedBody:
    """A body whose raw readings become sensations; the import uses the same calibration.

    It notes the touches that it meets: they are experience too.

    Args:
        body: the body.
        calibration: of its receptors.
    """

    def __init__(self, body: CheckedBody, calibration: Calibration):
        self._body, self._calibration = body, calibration
        self.joint_names, self.jumps = body.joint_names, body.jumps
        self.lower, self.upper = body.lower, body.upper
        self.velocity, self.acceleration = body.velocity, body.acceleration
        self.num_receptors = body.num_receptors
        self._met = list[Felt]()
        # Where the last motion was to end.
        self._at: np.ndarray | None = None

    @property
    def robot_s(self) -> float:
        """s, time of the robot so far; 0 for a body that jumps."""
        return self._body.spent.robot_s

    def feel(self, q: np.ndarray) -> Felt:
        """As of `Body`, with sensations."""
        felt = self._body.feel(q)
        self._at = None
        sensation = self._calibration.sensation(felt.sensation)
        return self._noted(Felt(q=felt.q, sensation=sensation, reached=felt.reached))

    def take_met(self) -> tuple[np.ndarray, np.ndarray]:
        """`(n, J)` and `(n, S)`: touches since the last call."""
        q = [np.empty((0, len(self.joint_names))), *(felt.q for felt in self._met)]
        sensation = [np.empty((0, self.num_receptors)), *(felt.sensation for felt in self._met)]
        self._met.clear()
        return np.concatenate(q), np.concatenate(sensation)

    def _noted(self, felt: Felt) -> Felt:
        _, touches = felt.touches()
        self._met.append(touches.of_rows(np.flatnonzero(touches.reached)))
        return felt

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As of `Body`, with sensations; a body that travels goes to the first one before."""
        there = self._at is not None and np.array_equal(q[0], self._at)
        if not (self.jumps or there):
            self._body.feel(q[:1])
        followed = self._body.follow(time_s, q)
        self._at = q[-1].copy()
        sensation = self._calibration.sensation(followed.sensation)
        measured = replace(followed, sensation=sensation)
        self._noted(measured.felt())
        return measured


class LivingBody:
    """One body of others: it babbles, practises and acts, and nobody knows its truth.

    It is left at rest when the program ends.

    Args:
        body: the body.
        calibration: of its receptors; the agent calibrates them itself if there is none yet.
    """

    world = None

    def __init__(self, body: CheckedBody, calibration: Calibration | None = None):
        self._body = body
        self._calibrated: CalibratedBody | None = None
        self.recall(calibration)
        atexit.register(body.close)

    @property
    def babbling(self) -> CalibratedBody:
        """The body, with sensations.

        Raises:
            BodyError: its receptors are not calibrated yet.
        """
        if self._calibrated is None:
            raise BodyError(f"{self._body.name} is not calibrated: babble first")
        return self._calibrated

    practice = acting = babbling

    @property
    def still(self) -> Body | None:
        """The body, if it can be at rest everywhere."""
        return self.babbling if self._body.jumps else None

    @property
    def jumps(self) -> bool:
        """Whether any posture may be asked for next."""
        return self._body.jumps

    def recall(self, calibration: Calibration | None) -> None:
        """Takes a calibration that is known, if it has none yet."""
        if self._calibrated is None and calibration is not None:
            self._calibrated = CalibratedBody(self._body, calibration)

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
        parts, num_rows, began = list[Felt](), 0, self._body.spent.robot_s
        while num_rows < _ROWS and self._body.spent.robot_s - began < _LONG_ENOUGH_S:
            size = walker.batch if walker.timed else _ROWS
            parts.append(walker.walk(path.steps(size)))
            num_rows += len(parts[-1].q)
        q, readings = (np.concatenate([getattr(p, n) for p in parts]) for n in ("q", "sensation"))
        try:
            found = calibrate(q, readings)
        except ValueError as error:
            raise BodyError(f"{self._body.name} cannot be calibrated: {error}") from None
        self._calibrated = CalibratedBody(self._body, found)
        return found
