"""What changed of a known chain: the fewest numbers that explain where touches are felt now.

What is felt in a touch says where it lies on the skin as it was. A chain that did not change brings
its toucher there. One that did does so after something was moved: a joint's zero, a link, the
toucher, or the skin itself. Each of these is a few numbers, found by least squares on the touches
since; of all, the change with the least description is taken (Schwarz 1978).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import scipy.linalg
from scipy.optimize import least_squares
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import adjoint, exponentials
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.body_model.smoothness import SmoothChain

# Residuals count with their squares up to so many standard deviations; beyond, less and less.
_ROBUST = 2.0
# A posture gets to a place if it comes nearer than this share of the skin's radius.
_REACHED = 0.01
# Share of usual touches, those foretold worst, that do not say how exact places are.
_WORST = 0.05
# What each number must earn, relative to the logarithm of the number of touches: touches that
# follow each other are off alike.
_PRICE = 3.0


class Change(Enum):
    """What may change, in words; `{}` is a joint."""

    ZERO = "the zero of joint {}"
    LINK = "the link after joint {}"
    BENT_LINK = "the link after joint {}, bent"
    TOUCHER = "what touches"
    SKIN = "the skin"
    STRETCHED_SKIN = "the skin, stretched"
    TURNED_SKIN = "the skin, turned"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChainChange:
    """A change of a chain.

    Attributes:
        kind: what changed.
        joint: which joint, or which carries the link; -1 if it is neither.
        amount: `(k,)` the numbers: the zero's shift in the reading's unit; a displacement in
            radii of the skin; a turn in radians, then a displacement; a displacement, then the
            logarithm of a stretch.
        sigma: `(k,)` their standard errors.
        before: the chain as it was.
        after: as it is. Where `before` takes the toucher in a posture, `after` takes it in the
            posture in which the same is felt now.
    """

    kind: Change
    joint: int
    amount: np.ndarray
    sigma: np.ndarray
    before: KnownChain
    after: KnownChain

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        what = self.kind.value.format(self.joint)
        if self.kind == Change.ZERO:
            return f"{what} moved by {self.amount[0]:+.4f} ± {self.sigma[0]:.4f}"
        said = []
        if self.kind in (Change.BENT_LINK, Change.TURNED_SKIN):
            turn, error = _size(self.amount[:3], self.sigma[:3])
            said.append(f"by {np.degrees(turn):.1f} ± {np.degrees(error):.1f} degrees")
        if self.kind == Change.STRETCHED_SKIN:
            stretch, error = np.exp(self.amount[3]), self.sigma[3]
            said.append(f"by a factor of {stretch:.3f} ± {stretch * error:.3f}")
        if not said:
            way, error = _size(self.amount, self.sigma)
            said.append(f"moved by {way:.3f} ± {error:.3f} of the skin's radius")
        return " ".join([what, *said])

    def moved(
        self, q: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where is felt now what was felt at `(n, J)` q before.

        Args:
            q: readings.
            lower: `(J,)` lower limits of the joints.
            upper: `(J,)` upper limits.

        Returns:
            `(n, J)` the postures nearest to q in which it is, and `(n,)` whether they get there.
        """
        q = q.astype(float)
        if self.kind == Change.ZERO:
            q[:, self.joint] -= self.amount[0]
            return q, np.all((q >= lower) & (q <= upper), axis=1)
        place = self.before.places(q)
        found = self.after.put(q, place, lower, upper)
        off = np.linalg.norm(self.after.places(found) - place, axis=1)
        return found, off < _REACHED * self.before.radius

    def as_before(self, q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """`(n, J)` postures in which was felt before what is felt at `(n, J)` q now."""
        q = q.astype(float)
        if self.kind == Change.ZERO:
            q[:, self.joint] += self.amount[0]
            return q
        return self.before.put(q, self.after.places(q), lower, upper)


def _size(amount: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """The norm of a vector, and its standard error."""
    size = float(np.linalg.norm(amount))
    return size, float(np.linalg.norm(amount / max(size, 1e-12) * sigma))


@dataclass(frozen=True, slots=True, eq=False)
class _Hypothesis:
    """Numbers that may have changed.

    Attributes:
        kind: what.
        place: what is inserted sits before this joint of the chain; 0 is the skin.
        joint: for words; -1 for none.
        basis: `(7, k)` turn, displacement, and logarithm of a stretch, for each number.
        about: `(3,)` what stays in place when something turns or stretches.
    """

    kind: Change
    place: int
    joint: int
    basis: np.ndarray
    about: np.ndarray


def _hypotheses(known: KnownChain) -> Iterator[_Hypothesis]:
    """From few numbers to many."""
    length, origin = len(known.joints), np.zeros(3)
    middle = known.places(known.q).mean(axis=0)
    turns, moves, stretch = np.eye(7)[:, :3], np.eye(7)[:, 3:6], np.eye(7)[:, 6:]
    moves = moves * known.radius
    for place, joint in enumerate(known.joints):
        axis = np.append(known.chain.twists[place], 0.0)[:, None] / known.scale[joint]
        yield _Hypothesis(Change.ZERO, place, joint, axis, origin)
    yield _Hypothesis(Change.SKIN, 0, -1, moves, origin)
    for place in range(1, length):
        yield _Hypothesis(Change.LINK, place, known.joints[place - 1], moves, origin)
    yield _Hypothesis(Change.TOUCHER, length, -1, moves, origin)
    yield _Hypothesis(Change.STRETCHED_SKIN, 0, -1, np.hstack([moves, stretch]), middle)
    rigid = np.hstack([turns, moves])
    yield _Hypothesis(Change.TURNED_SKIN, 0, -1, rigid, middle)
    for place in range(1, length):
        yield _Hypothesis(Change.BENT_LINK, place, known.joints[place - 1], rigid, middle)


def _motion(amount: np.ndarray, about: np.ndarray) -> np.ndarray:
    """`(4, 4)` what turn, displacement and stretch make of a point."""
    motion = exponentials(amount[None, :6])[0]
    turn = np.exp(amount[6]) * motion[:3, :3]
    motion[:3, 3] += about - turn @ about
    motion[:3, :3] = turn
    return motion


def _with_inserted(known: KnownChain, hypothesis: _Hypothesis, amount: np.ndarray) -> KnownChain:
    """The chain after something was moved."""
    motion = _motion(hypothesis.basis @ amount, hypothesis.about)
    twists, point = known.chain.twists.copy(), known.chain.point
    twists[hypothesis.place :] = adjoint(motion, twists[hypothesis.place :])
    point = motion[:3, :3] @ point + motion[:3, 3]
    return replace(known, chain=SmoothChain(twists, point, np.inf))


@dataclass(frozen=True, slots=True, eq=False)
class Foretold:
    """Where touches lie on the skin as it was, as what is felt in them says.

    Attributes:
        q: `(n, J)` readings.
        place: `(n, 3)`.
        root: `(3, 3)` that makes the usual errors of places 1.
    """

    q: np.ndarray
    place: np.ndarray
    root: np.ndarray

    def errors(self, known: KnownChain) -> np.ndarray:
        """`(3 n,)` how far a chain takes the toucher from there, in usual errors."""
        return ((known.places(self.q) - self.place) @ self.root).ravel()


def foretold(
    known: KnownChain,
    usual: tuple[np.ndarray, np.ndarray],
    since: tuple[np.ndarray, np.ndarray],
) -> tuple[Foretold, Foretold]:
    """Where usual touches lie, and those since a change: readings and sensations of each.

    The chain was fitted to others.
    """
    felt = known.sensed
    place = known.places(known.q)
    there = [
        felt.predicted(place, felt.like(csr_array(sensation))) for _, sensation in (usual, since)
    ]
    off = known.places(usual[0]) - there[0]
    size = np.linalg.norm(off, axis=1)
    kept = off[size <= np.quantile(size, 1 - _WORST)]
    values, vectors = np.linalg.eigh(kept.T @ kept / len(kept))
    root = vectors @ np.diag(np.maximum(values, 1e-12 * values.max()) ** -0.5) @ vectors.T
    return Foretold(usual[0], there[0], root), Foretold(since[0], there[1], root)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A hypothesis, fitted: its numbers, their standard errors, and the length of description."""

    amount: np.ndarray
    sigma: np.ndarray
    length: float


def _fitted(known: KnownChain, hypothesis: _Hypothesis, since: Foretold, usual: float) -> _Fit:
    """The numbers that bring touches nearest to where they are felt."""
    count = hypothesis.basis.shape[1]

    def off(amount: np.ndarray) -> np.ndarray:
        return since.errors(_with_inserted(known, hypothesis, amount))

    found = least_squares(off, np.zeros(count), loss="soft_l1", f_scale=_ROBUST)
    number = len(since.q)
    left = _robust(found.fun)
    inverse = scipy.linalg.pinvh(found.jac.T @ found.jac)
    spread = max(left / usual, 1.0) * usual
    sigma = np.sqrt(np.diag(inverse) * spread)
    return _Fit(found.x, sigma, 3 * number * left / usual + _PRICE * count * np.log(number))


def _robust(errors: np.ndarray) -> float:
    """The mean of squared errors, in which great ones count less."""
    scaled = 1 + (errors / _ROBUST) ** 2
    return float(np.mean(2 * _ROBUST**2 * (np.sqrt(scaled) - 1)))


def explained(known: KnownChain, usual: Foretold, since: Foretold) -> ChainChange | None:
    """The change with the least description; None if that is no change.

    Args:
        known: the chain as it was.
        usual: touches from before the change, to which it was not fitted.
        since: touches since.
    """
    base = _robust(usual.errors(known))
    best = None
    least = 3 * len(since.q) * _robust(since.errors(known)) / base
    for hypothesis in _hypotheses(known):
        fit = _fitted(known, hypothesis, since, base)
        if fit.length < least:
            least, best = fit.length, (hypothesis, fit)
    if best is None:
        return None
    hypothesis, fit = best
    return ChainChange(
        kind=hypothesis.kind,
        joint=hypothesis.joint,
        amount=fit.amount,
        sigma=fit.sigma,
        before=known,
        after=_with_inserted(known, hypothesis, fit.amount),
    )
