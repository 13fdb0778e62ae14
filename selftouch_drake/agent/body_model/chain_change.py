"""What changed of a known chain: the fewest numbers that explain where touches are felt now.

What is felt in a touch says where it lies on the skin as it was. A chain that did not change brings
its toucher there. One that did does so after something was moved: a joint's zero, a link, the
toucher, or the skin itself. Each of these is a few numbers, found by least squares on the touches
since; of all, and of pairs where one is not enough, the change with the least description is taken
(Schwarz 1978).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import scipy.linalg
from scipy.optimize import least_squares
from scipy.sparse import csr_array
from scipy.stats import chi2

from selftouch_drake.agent.body_model.chain import adjoint, exponentials
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.body_model.smoothness import SmoothChain

# Residuals count with their squares up to so many standard deviations; beyond, less and less.
_ROBUST = 2.0
# A posture gets to a place if it comes nearer than this share of the skin's radius.
_REACHED = 0.01
# Share of usual touches, those foretold worst, that do not say how exact places are.
_WORST = 0.05
# Two things are tried if one needs more numbers than these, or describes touches so many times as
# long as usual ones; the first is one of so many that alone explain most.
_FEW_NUMBERS, _WORTH_TWO, _FIRST_OF_TWO = 3, 1.5, 3
# What each number must earn at least, relative to the logarithm of the number of touches: what a
# chain leaves out is alike in touches of one place.
_PRICE = 3.0
# Touches that follow each other, over so many at most, may be off alike: those of a finger that
# slides are.
_FOLLOW = 10
# A part of a change is sure if its numbers are this improbable by chance.
_CHANCE = 1e-4


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
class Part:
    """One thing that changed of a chain.

    Attributes:
        kind: what changed.
        joint: which joint, or which carries the link; -1 if it is neither.
        amount: `(k,)` the numbers: the zero's shift in the reading's unit; a displacement in
            radii of the skin; a turn in radians, then a displacement; a displacement, then the
            logarithm of a stretch.
        covariance: `(k, k)` of the numbers.
    """

    kind: Change
    joint: int
    amount: np.ndarray
    covariance: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """`(k,)` standard errors of the numbers."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sure(self) -> bool:
        """Whether its numbers are more than their errors explain."""
        inverse = np.linalg.pinv(self.covariance, hermitian=True)
        return float(self.amount @ inverse @ self.amount) > chi2.isf(_CHANCE, len(self.amount))

    def said(self, joint_names: Sequence[str] | None = None) -> str:
        """What changed, with its standard error; joints are numbers if they have no names."""
        joint = self.joint if joint_names is None or self.joint < 0 else joint_names[self.joint]
        what = self.kind.value.format(joint)
        if self.kind == Change.ZERO:
            return f"{what} moved by {self.amount[0]:+.4f} ± {self.sigma[0]:.4f}"
        said = []
        if self.kind in (Change.BENT_LINK, Change.TURNED_SKIN):
            turn, error = _size(self.amount[:3], self.sigma[:3])
            said.append(f"by {np.degrees(turn):.1f} ± {np.degrees(error):.1f} degrees")
        if self.kind == Change.STRETCHED_SKIN:
            stretch, share = np.exp(self.amount[3]), self.sigma[3]
            said.append(f"by a factor of {stretch:.3f} ± {stretch * share:.3f}")
        if not said:
            way, error = _size(self.amount, self.sigma)
            said.append(f"moved by {way:.3f} ± {error:.3f} of the skin's radius")
        return " ".join([what, *said])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChainChange:
    """A change of a chain.

    Attributes:
        parts: what changed, one thing or two.
        before: the chain as it was.
        after: as it is. Where `before` takes the toucher in a posture, `after` takes it in the
            posture in which the same is felt now.
        turn: `(3, 3)` how the last link turned and stretched at readings of 0.
        left: how far touches are off now, in squares, as a multiple of what is usual.
    """

    parts: tuple[Part, ...]
    before: KnownChain
    after: KnownChain
    turn: np.ndarray
    left: float

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        return self.said()

    def said(self, joint_names: Sequence[str] | None = None) -> str:
        """As `in_words`, with names of the joints if there are any."""
        return "; ".join(part.said(joint_names) for part in self.parts)

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
        if self._zeros_alone:
            q -= self._zeros(q.shape[1])
            return q, np.all((q >= lower) & (q <= upper), axis=1)
        place = self.before.places(q)
        found = self.after.put(q, place, lower, upper)
        off = np.linalg.norm(self.after.places(found) - place, axis=1)
        return found, off < _REACHED * self.before.radius

    def left_of(self, usual: "Foretold", since: "Foretold") -> float:
        """As `left`, of other touches than those that told the change."""
        return _robust(since.errors(self.after)) / _robust(usual.errors(self.before))

    def as_before(self, q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """`(n, J)` postures in which was felt before what is felt at `(n, J)` q now."""
        q = q.astype(float)
        if self._zeros_alone:
            return q + self._zeros(q.shape[1])
        return self.before.put(q, self.after.places(q), lower, upper)

    @property
    def _zeros_alone(self) -> bool:
        return all(part.kind == Change.ZERO for part in self.parts)

    def _zeros(self, num_joints: int) -> np.ndarray:
        """`(J,)` by which zeros moved."""
        zeros = np.zeros(num_joints)
        for part in self.parts:
            zeros[part.joint] += part.amount[0]
        return zeros


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


def _with_inserted(
    known: KnownChain, together: Sequence[_Hypothesis], amount: np.ndarray
) -> tuple[KnownChain, np.ndarray]:
    """The chain after some things were moved, by their numbers one after the other.

    Returns:
        The chain, and `(3, 3)` how its last link turned and stretched at readings of 0.
    """
    twists, point, turn = known.chain.twists.copy(), known.chain.point, np.eye(3)
    ends = np.cumsum([one.basis.shape[1] for one in together])[:-1]
    moved = zip(together, np.split(amount, ends), strict=True)
    # What lies nearest to the toucher first: it leaves the axes of all before it as they were.
    for one, numbers in sorted(moved, key=lambda pair: -pair[0].place):
        motion = _motion(one.basis @ numbers, one.about)
        twists[one.place :] = adjoint(motion, twists[one.place :])
        point = motion[:3, :3] @ point + motion[:3, 3]
        turn = motion[:3, :3] @ turn
    return replace(known, chain=SmoothChain(twists, point, np.inf)), turn


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
    """Hypotheses fitted together.

    Attributes:
        together: one or two of them.
        amount: `(k,)` their numbers, one after the other.
        covariance: `(k, k)` of the numbers, if each touch is off by itself.
        errors: `(3 n,)` how far touches are off, in usual errors.
        left: their robust squares, as a multiple of what is usual.
    """

    together: tuple[_Hypothesis, ...]
    amount: np.ndarray
    covariance: np.ndarray
    errors: np.ndarray
    left: float

    def length(self, alike: float) -> float:
        """Of the description, if so many touches are off alike."""
        number = len(self.errors) // 3
        return 3 * number * self.left + price(len(self.amount), number, alike)

    def parts(self, alike: float = 1.0) -> tuple[Part, ...]:
        """What changed, if so many touches are off alike."""
        parts, start = [], 0
        for one in self.together:
            own = slice(start, start + one.basis.shape[1])
            part = Part(
                kind=one.kind,
                joint=one.joint,
                amount=self.amount[own],
                covariance=self.covariance[own, own] * alike,
            )
            parts.append(part)
            start = own.stop
        return tuple(parts)


def _fitted(
    known: KnownChain,
    together: tuple[_Hypothesis, ...],
    since: Foretold,
    usual: float,
    start: np.ndarray | None = None,
) -> _Fit:
    """The numbers that bring touches nearest to where they are felt."""
    count = sum(one.basis.shape[1] for one in together)

    def off(amount: np.ndarray) -> np.ndarray:
        return since.errors(_with_inserted(known, together, amount)[0])

    begin = np.zeros(count) if start is None else start
    found = least_squares(off, begin, loss="soft_l1", f_scale=_ROBUST)
    left = _robust(found.fun) / usual
    inverse = scipy.linalg.pinvh(found.jac.T @ found.jac)
    return _Fit(together, found.x, inverse * max(left, 1.0) * usual, found.fun, left)


def price(count: int, number: int, alike: float = 1.0) -> float:
    """What so many numbers cost that so many touches told, in squared usual errors.

    Args:
        count: of the numbers.
        number: of the touches.
        alike: how many of them are off alike, as of `off_alike`.
    """
    return max(_PRICE, alike) * count * float(np.log(number))


def off_alike(errors: np.ndarray) -> float:
    """The variance of a sum of errors over that of independent ones; 1 or more.

    Args:
        errors: `(n,)` or `(n, k)` of touches in order.
    """
    size = max(float(np.mean(errors * errors)), 1e-9)
    lags = range(1, min(_FOLLOW, len(errors) - 1) + 1)
    together = sum(float(np.mean(errors[:-lag] * errors[lag:])) for lag in lags)
    return max(1.0, 1.0 + 2.0 * together / size)


def new_point(known: KnownChain, usual: Foretold, since: Foretold) -> Part:
    """Where the chain touches, if nothing else changed: by few touches, and how sure.

    Args:
        known: the chain as it was.
        usual: touches from before, to which it was not fitted.
        since: touches since.
    """
    base = _robust(usual.errors(known))
    toucher = next(one for one in _hypotheses(known) if one.kind == Change.TOUCHER)
    return _fitted(known, (toucher,), since, base).parts()[0]


def _robust(errors: np.ndarray) -> float:
    """The mean of squared errors, in which great ones count less."""
    scaled = 1 + (errors / _ROBUST) ** 2
    return float(np.mean(2 * _ROBUST**2 * (np.sqrt(scaled) - 1)))


def explained(known: KnownChain, usual: Foretold, since: Foretold) -> ChainChange | None:
    """The change with the least description, of one thing or two; None if that is no change.

    Of two things, both are sure.

    Args:
        known: the chain as it was.
        usual: touches from before the change, to which it was not fitted.
        since: touches since.
    """
    base = _robust(usual.errors(known))
    unchanged = 3 * len(since.q) * _robust(since.errors(known)) / base
    single = [_fitted(known, (one,), since, base) for one in _hypotheses(known)]
    freest = min(single, key=lambda fit: fit.left)
    alike = max(map(_off_alike, (usual.errors(known), freest.errors)))
    single.sort(key=lambda fit: fit.length(alike))
    best = single[0]
    if best.length(alike) >= unchanged:
        return None
    if len(best.amount) > _FEW_NUMBERS or best.length(alike) > _WORTH_TWO * 3 * len(since.q):
        for first in single[:_FIRST_OF_TWO]:
            for second in single:
                if second.together[0].place == first.together[0].place:
                    continue  # one motion in one place
                start = np.concatenate([first.amount, np.zeros(len(second.amount))])
                two = _fitted(known, (*first.together, *second.together), since, base, start)
                shorter = two.length(alike) < best.length(alike)
                if shorter and all(part.sure for part in two.parts(alike)):
                    best = two
    after, turn = _with_inserted(known, best.together, best.amount)
    return ChainChange(
        parts=best.parts(alike), before=known, after=after, turn=turn, left=best.left
    )


def _off_alike(errors: np.ndarray) -> float:
    """Of `(3 n,)` errors in order, in which great ones count less."""
    return off_alike(errors.clip(-2 * _ROBUST, 2 * _ROBUST).reshape(-1, 3))
