"""What changed in the body, and the touches of before made into touches of the body of now (naive).

Two kinds of things can change between motor configurations and sensations. Readings: receptors fall
silent, begin to feel, or change places. And what the joints' readings mean: after a zero moved, a
link grew or a skin slipped, the body is as if the joints were a little elsewhere. So the agent asks
where it must think its joints to be to feel what it felt before. One number for one joint is tried
first; if that is not enough, a smooth displacement that depends on the configuration.

What it was expecting stays as it is meanwhile: it says what would have been felt.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar

from selftouch_drake.agent.living.surprise import Expectation, surprise
from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quantise import unit

#: A receptor that is expected to feel in so many touches, and feels in none, is silent.
_SURELY = 20

#: A receptor counts as expected, or felt, from this share of a touch on.
_FELT = 0.1

#: Readings changed places if they go with each other better than with themselves by this much.
_BETTER = 0.3

#: Places of a joint that are tried, out to so many standard deviations to either side.
_REACH, _TRIED = 1.0, 41

#: A more complicated explanation is taken if it leaves less surprise than this share. None is
#: looked for if surprise is back at what was usual, but for this factor.
_WORTH, _ENOUGH = 0.9, 1.1

#: Touches for the first look at each joint's zero.
_FEW = 400

#: The networks whose mean is a displacement, and their training. On a torus that stretched by 15 %
#: (whose forearm grew by a tenth), 79 (87) % of the mended touches touch with one network, 82 and
#: 90 % with five. With more hidden units, or more steps, fewer do.
_NETWORKS, _HIDDEN, _BATCH, _NUM_STEPS = 5, 32, 512, 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mending:
    """What became of the body, and what that makes of touches of before.

    Attributes:
        source: `(S,)` the receptor of before that each reading now comes from.
        silent: `(S,)` bool, receptors that no longer feel.
        new: `(S,)` bool, receptors that never felt before.
        of_new: `(S, S)` what each receptor adds to what new ones would have felt; null columns of
            all others.
        offset: `(J,)` by how much joints are elsewhere than they read.
        displacement: networks from standardised configurations to how much farther the joints are,
            in standard deviations, of which the mean counts; none if the offset explains all.
        surprise: mean, of the touches of now before and after this explanation.
        expectation: of before.
    """

    source: np.ndarray
    silent: np.ndarray
    new: np.ndarray
    of_new: np.ndarray
    offset: np.ndarray
    displacement: tuple[Network, ...]
    surprise: tuple[float, float]
    expectation: Expectation

    def expected(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` what is expected now at `q` `(n, J)`: unit L2 norm before readings changed."""
        return self._readings(self.expectation(self._as_before(q)))

    def mended(self, q: np.ndarray, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Makes touches of before into touches of now.

        Args:
            q: `(n, J)` motor configurations of before.
            sensation: `(n, S)` what was felt.

        Returns:
            `(m, J)` and `(m, S)`: touches in which nothing would be felt now are forgotten, and
            after a displacement, which is not exact, the lighter half: of those of the stretched
            and the grown torus 96 and 99 % touch.
        """
        felt = self._readings(sensation)
        # What one faint receptor at its rim would feel of a touch says little of its place.
        holds = np.linalg.norm(felt, axis=1) > 2 * _FELT * np.linalg.norm(sensation, axis=1)
        if self.displacement:
            strength = np.linalg.norm(felt, axis=1)
            holds &= strength >= np.median(strength[holds])
        return self._as_now(q[holds]), felt[holds]

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        swapped = np.flatnonzero(self.source != np.arange(len(self.source)))
        found = [
            f"{len(rows)} receptors {what}"
            for rows, what in (
                (np.flatnonzero(self.silent), "are silent"),
                (np.flatnonzero(self.new), "are new"),
                (swapped, "changed places"),
            )
            if len(rows)
        ]
        found += [
            f"joint {joint} is {self.offset[joint]:+.4f} from what it reads"
            for joint in np.flatnonzero(self.offset)
        ]
        if self.displacement:
            found.append("all joints act as if they were a little elsewhere")
        return "; ".join(found) or "nothing that explains it"

    def _readings(self, sensation: np.ndarray) -> np.ndarray:
        felt = sensation[:, self.source]
        felt = np.where(self.silent, 0.0, felt + np.maximum(felt @ self.of_new, 0.0))
        return felt.astype(np.float32)

    def _as_before(self, q: np.ndarray) -> np.ndarray:
        moved = q + self.offset
        if not self.displacement:
            return moved
        x = self.expectation.standardised(q)
        displaced = np.mean([network(x) for network in self.displacement], axis=0)
        return moved + displaced * self.expectation.scale

    def _as_now(self, q: np.ndarray) -> np.ndarray:
        """Solves `_as_before(now) = q` by steps that shrink, as the displacement is smooth."""
        now = q - self.offset
        for _ in range(8 if self.displacement else 0):
            now = now + q - self._as_before(now)
        return now.astype(np.float32)


def understand(
    expectation: Expectation,
    known: np.ndarray,
    usual: float,
    q: np.ndarray,
    sensation: np.ndarray,
    *,
    seed: int = 0,
) -> Mending:
    """Finds out what changed.

    Args:
        expectation: of before the change.
        known: `(S,)` bool, receptors that had felt something by then.
        usual: mean surprise before the change.
        q: `(n, J)` motor configurations since the change.
        sensation: `(n, S)` N, what was felt there; no row null.
        seed: of the displacement.
    """
    # Every third touch is kept to judge by.
    judge = np.arange(len(q)) % 3 == 2
    felt = unit(sensation)
    fit = _Touches(q=q[~judge], felt=felt[~judge])
    new = ~known & ((fit.felt > _FELT).sum(axis=0) >= _SURELY)

    def judged(one: Mending) -> float:
        return float(surprise(one.expected(q[judge]), felt[judge]).mean())

    nothing = Mending(
        source=np.arange(len(known)),
        silent=np.zeros(len(known), dtype=bool),
        new=new,
        of_new=_of_new(fit.felt, new),
        offset=np.zeros(q.shape[1]),
        displacement=(),
        surprise=(0.0, 0.0),
        expectation=expectation,
    )
    before = judged(nothing)
    best, least = nothing, before
    for explained in (_rewired, _with_offset, _displaced):
        if least <= _ENOUGH * usual:
            break
        found = explained(best, fit, seed)
        if (left := judged(found)) < _WORTH * least:
            best, least = found, left
    return dataclasses.replace(best, surprise=(before, least))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Touches:
    """Touches since the change: `(n, J)` configurations, and `(n, S)` felt, of unit L2 norm."""

    q: np.ndarray
    felt: np.ndarray


def _of_new(felt: np.ndarray, new: np.ndarray) -> np.ndarray:
    """`(S, S)` what new receptors feel as a linear function of what others do: ridge regression."""
    others = np.where(new, 0.0, felt)
    weights = np.linalg.solve(others.T @ others + np.eye(len(new)), others.T @ felt)
    return np.where(new, weights, 0.0)


def _rewired(mending: Mending, touches: _Touches, seed: int) -> Mending:
    """Finds silent receptors, and readings that changed places."""
    expected, felt = mending.expected(touches.q), touches.felt
    wanted = (expected > _FELT).sum(axis=0) >= _SURELY
    silent = wanted & ~felt.any(axis=0)
    both = expected.T @ felt
    both /= np.outer(np.linalg.norm(expected, axis=0), np.linalg.norm(felt, axis=0)) + 1e-9
    _, was = linear_sum_assignment(-both.T)
    reading = np.arange(len(was))
    moved = both[was, reading] > both[reading, reading] + _BETTER
    # A reading that now comes from elsewhere left its own place to another.
    while moved.any() and (lost := moved & ~np.isin(reading, was[moved])).any():
        moved &= ~lost
    return dataclasses.replace(mending, source=np.where(moved, was, reading), silent=silent)


def _with_offset(mending: Mending, touches: _Touches, seed: int) -> Mending:
    """Finds joints whose zeros moved: one after another, as long as that leaves less surprise."""
    scale = mending.expectation.scale

    def left(offset: np.ndarray, num: int | None = None) -> float:
        expected = dataclasses.replace(mending, offset=offset).expected(touches.q[:num])
        return float(surprise(expected, touches.felt[:num]).mean())

    best, least = mending.offset, left(mending.offset)
    for _ in range(len(scale)):
        tried = [
            best + by * scale * axis
            for axis in np.eye(len(scale))
            for by in np.linspace(-_REACH, _REACH, _TRIED)
        ]
        found = min(tried, key=lambda offset: left(offset, _FEW))
        joint = int(np.abs(found - best).argmax())
        width = 2 * _REACH / (_TRIED - 1) * scale[joint]
        refined = minimize_scalar(
            lambda by, found=found, joint=joint: left(found + by * np.eye(len(scale))[joint]),
            bounds=(-width, width),
            method="bounded",
            options={"maxiter": 12},
        )
        found = found + refined.x * np.eye(len(scale))[joint]
        if refined.fun > _WORTH * least:
            break
        best, least = found, refined.fun
    return dataclasses.replace(mending, offset=best)


def _displaced(mending: Mending, touches: _Touches, seed: int) -> Mending:
    """Learns where the joints would have to be, so that what was expected is felt."""
    rng = np.random.default_rng(seed)
    expectation, num_joints = mending.expectation, len(mending.offset)
    x = expectation.standardised(touches.q)
    start = expectation.standardised(touches.q + mending.offset)
    # What readings would have been before they changed places; silent and new ones say nothing.
    wanted, counts = np.empty_like(touches.felt), np.empty(touches.felt.shape[1], np.float32)
    wanted[:, mending.source] = touches.felt
    counts[mending.source] = ~(mending.silent | mending.new)
    rows = np.empty(0, dtype=int)

    def batch() -> np.ndarray:
        nonlocal rows
        rows = rng.integers(len(x), size=_BATCH)
        return x[rows]

    def slope(displaced: np.ndarray) -> np.ndarray:
        outputs, _, slopes = expectation.network.forward(start[rows] + displaced)
        off = 2.0 * counts * (outputs - wanted[rows]) / len(rows)
        return expectation.network.slope_of_inputs(off, slopes)

    def trained() -> Network:
        network = Network.random([num_joints, _HIDDEN, num_joints], rng)
        network.weights[-1][:] = 0.0
        train(network, batch, slope, _NUM_STEPS)
        return network

    return dataclasses.replace(mending, displacement=tuple(trained() for _ in range(_NETWORKS)))
