"""A user's own body as an agent lives in it: raw readings become sensations."""

import atexit
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body import BodyError, Felt, Followed
from selftouch_drake.agent.readings.baseline import Baseline, estimate_baseline
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.experience.collect import random_walk, walker_of
from selftouch_drake.experiment import Experiment

#: Where the straight way to a motion is blocked, and more than this share of a joint's range long,
#: the body goes by two random postures, where mostly nothing touches, and tries again. Of 78 ways
#: to starts that the tests' arm in MuJoCo chose, 58 % are free when they are straight, 95 % after
#: four rounds, and all after so many.
_FAR, _BY, _ROUNDS = 0.1, 2, 12

#: Rows from which a skin is calibrated, and s of the robot after which there are enough.
_ROWS, _LONG_ENOUGH_S = 2000, 60.0


class UserBody:
    """A body that a user gave: it babbles, practises and acts, and nobody knows its truth.

    Its raw readings become sensations; the import uses the same baseline. It is left at rest
    when the program ends. The agent finds the baseline itself if it is not known yet.

    Attributes:
        met: touches that it meets from now on, if it is to note them, `(n, J)` and `(n, S)` N: they
            are experience too.
    """

    world = None

    def __init__(self, body: CheckedBody, baseline: Baseline | None = None):
        self._body, self.baseline = body, baseline
        self.joint_names, self.jumps = body.joint_names, body.jumps
        self.lower, self.upper = body.lower, body.upper
        self.velocity, self.acceleration = body.velocity, body.acceleration
        self.num_receptors = body.num_receptors
        self.met: list[tuple[np.ndarray, csr_array]] | None = None
        # Where the last motion was to end, and where it did.
        self._at: np.ndarray | None = None
        self._where = np.full(len(body.lower), np.inf)
        self._rng = np.random.default_rng(0)
        atexit.register(body.close)

    @property
    def babbling(self) -> "UserBody":
        """The body, with sensations.

        Raises:
            BodyError: the baseline of its receptors is not known yet.
        """
        if self.baseline is None:
            raise BodyError(f"{self._body.name} is not calibrated: babble first")
        return self

    practice = acting = babbling

    @property
    def still(self) -> "UserBody | None":
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
        """As in `Body`, with sensations."""
        felt = self._body.feel(q)
        self._at = None
        if len(felt.q):
            self._where = felt.q[-1]
        return self._noted(replace(felt, sensation=self._sensation(felt.sensation)))

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`, with sensations; a body that travels goes to the first one before."""
        there = self._at is not None and np.array_equal(q[0], self._at)
        if not (self.jumps or there):
            self._go(q[:1])
        followed = self._body.follow(time_s, q)
        self._at, self._where = q[-1].copy(), followed.q[-1]
        followed = replace(followed, sensation=self._sensation(followed.sensation))
        self._noted(followed.felt())
        return followed

    def find_baseline(self, experiment: Experiment) -> Baseline:
        """Finds the baseline of its readings: the body walks at random, in touch or not.

        Raises:
            BodyError: what the body reads has no baseline.
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
            self.baseline = estimate_baseline(q, readings)
        except ValueError as error:
            raise BodyError(f"{self._body.name} cannot be calibrated: {error}") from None
        return self.baseline

    def _go(self, q: np.ndarray) -> None:
        """Travels to `(1, J)`, round what is in the way."""
        far = (np.abs(q - self._where) > _FAR * (self.upper - self.lower)).any()
        for _ in range(_ROUNDS if far else 0):
            if self._body.feel(q).reached[0]:
                return
            self._body.feel(self._rng.uniform(self.lower, self.upper, (_BY, q.shape[1])))
        self._body.feel(q)

    def _sensation(self, readings: np.ndarray) -> np.ndarray:
        baseline = self.babbling.baseline
        assert baseline is not None
        return baseline.sensation(readings)

    def _noted(self, felt: Felt) -> Felt:
        if self.met is not None:
            _, touches = felt.touches()
            q, sensation = touches.q[touches.reached], touches.sensation[touches.reached]
            self.met.append((q.astype(np.float32), csr_array(sensation.astype(np.float32))))
        return felt
