"""Explains why touches surprise: tries what may have changed, from simple to complicated (naive).

Any fit lowers surprise, the more so the worse the agent expects. So each explanation is fitted a
second time, to touches from before the change, and only the ratio of the two surprises counts.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar
from scipy.spatial import cKDTree

from selftouch_drake.agent.lifelong.expectation import (
    NUM_STEPS,
    Expectation,
    TouchSet,
    with_unit_norm,
)
from selftouch_drake.agent.network import Network, train
from selftouch_drake.quotient.sensations import unit

#: A receptor counts as felt if its reading is at least this share of a sensation; felt in this many
#: touches, it is no chance.
_FELT, _SURELY = 0.1, 20

#: A touch from before the change is forgotten if new receptors make up more than this share of it.
_GUESSED = 0.98

#: Number of touches since the change from which a guess is made. On a torus on which a patch of 10
#: of 100 receptors was blind, means of 3, 5 and 8 touches are about as good; one is worse.
_ALIKE = 3

#: Share of the touches from before the change, the lightest, that are forgotten if they were moved
#: by a displacement: it is not exact, and a small error leads a light touch off the skin. If half
#: are forgotten, the shape is worse (3.1 %, not 2.9 %, on a torus whose skin slipped).
_LIGHTEST = 0.25

#: Least surprise that counts in a geometric mean.
_LEAST = 0.001

#: A more complicated explanation is taken if it leaves less than this share of the ratio of
#: surprises. The search ends if the ratio is at most the second number.
_WORTH, _ENOUGH = 0.9, 1.1

#: A reading moved if its cosine with what another receptor should feel exceeds by this much the
#: cosine with what its own receptor should feel.
_BETTER = 0.3

#: Standard deviations to either side within which offsets of a joint are tried, and their number;
#: touches for the first search of each joint's zero.
_REACH, _TRIED, _FEW = 1.0, 41, 400

#: A blunt expectation has the training steps of a sharp one divided by this.
_BLUNT = 2

#: Networks of a displacement; the mean of all counts. After the forearm of a torus grew, what is
#: felt at moved touches is off by a cosine distance of 0.0025 (median), of 0.0032 with three.
_NETWORKS = 6

#: Hidden units of such a network and training steps, for 1000 touches; both grow with the square
#: root of the number of touches. Touches per training step. On a cube that was stretched, with 5000
#: touches since, 81 % of the touches of before touch, and 82 % with twice as many of both.
_HIDDEN, _NUM_STEPS, _BATCH = 32, 500, 512

#: Weight of the squared displacement, in standard deviations, beside the squared error of what is
#: expected, for 1000 touches; it falls with the square root of their number. Without it, joints
#: without effect on a touch go astray: of 3000 touches of a cube, 1510 are kept and touch, not 1680
#: (1000 touches since).
_PENALTY = 0.2


class NewReceptors:
    """What new receptors feel in a touch: what they felt in touches that the others felt alike.

    On a torus, 1000 touches after a patch began to feel, a guess of half to seven tenths of a touch
    is off by a cosine distance of 0.04 (mean), one of more than nine tenths by 0.07.

    Args:
        silent_before: `(S,)` bool, receptors that felt nothing before the change.
        felt: `(n, S)` touches since the change, of unit L2 norm.

    Attributes:
        receptors: `(S,)` bool, those that are new: if one surely is, all that felt anything.
    """

    def __init__(self, silent_before: np.ndarray, felt: np.ndarray) -> None:
        began = silent_before & ((felt > _FELT).sum(axis=0) >= _SURELY)
        self.silent_before = silent_before
        self.receptors = silent_before & felt.any(axis=0) & began.any()
        others = np.where(silent_before, 0.0, felt)
        some = others.any(axis=1) & self.receptors.any()
        self.felt = felt[some]
        self._by_others = cKDTree(with_unit_norm(others[some]))

    def filled_in(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, S)` N, sensations with what the new receptors would feel beside the others.

        It is a mean of the most similar touches, weighted by similarity; 0 if none is similar.
        """
        if self._by_others.n < _ALIKE:
            return sensation
        others = np.where(self.silent_before, 0.0, sensation)
        distance, row = self._by_others.query(with_unit_norm(others), _ALIKE)
        # Unit vectors that have nothing in common are a distance of the root of 2 apart.
        weight = np.maximum(1.0 / np.maximum(distance, 1e-6) ** 2 - 0.5, 0.0)
        alike = np.einsum("nk,nks->ns", weight, self.felt[row])
        by_others = np.linalg.norm(alike[:, ~self.silent_before], axis=1)
        strength = np.linalg.norm(others, axis=1)
        times = np.divide(strength, by_others, out=np.zeros_like(strength), where=by_others > 0)
        return np.where(self.receptors, alike * times[:, None], sensation)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyChange:
    """What changed in the body: readings of receptors, and what readings of joints mean.

    Attributes:
        expectation: what was expected before the change.
        source: `(S,)` number of the old receptor that each reading now comes from.
        silent: `(S,)` bool, receptors that no longer feel.
        new: receptors that never felt before, and what they would have felt.
        offset: `(J,)` difference between where each joint is and what it reads.
        displacement: networks from standardised configurations to a further difference, in standard
            deviations; their mean counts. There are none if the offset explains all.
        through: expectations, from blunt to sharp, through which the displacement was learned; none
            before it is.
        reach: `(2, J)` least and greatest reading of each joint, before and after the change.
    """

    expectation: Expectation
    source: np.ndarray
    silent: np.ndarray
    new: NewReceptors
    offset: np.ndarray
    displacement: tuple[Network, ...] = ()
    through: tuple[Expectation, ...] = ()
    reach: np.ndarray

    def expected(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected now at `q` `(n, J)`."""
        return self._readings(self.expectation(self._as_before(q)))

    def surprise_left(self, touches: TouchSet) -> float:
        """Geometric mean of the surprise of touches, if this is what changed.

        Novel touches surprise much in any body; in an arithmetic mean they would hide that all
        others surprise far more than before.
        """
        surprise = self.expectation.surprise(self.expected(touches.q), touches.sensation)
        return float(np.exp(np.log(np.maximum(surprise, _LEAST)).mean()))

    def adapted(self, touches: TouchSet) -> TouchSet:
        """Makes touches from before the change into touches of the changed body.

        Those in which nothing would be felt now are forgotten. If there is a displacement, the
        lightest are forgotten too, and those at readings that no joint had.
        """
        felt = self._readings(touches.sensation)
        # If only a faint receptor at the rim of a touch remains, it says little of its place.
        strength = np.linalg.norm(felt, axis=1)
        holds = strength > 2 * _FELT * np.linalg.norm(touches.sensation, axis=1)
        guessed = np.linalg.norm(felt[:, self.new.receptors], axis=1)
        holds &= guessed <= _GUESSED * strength
        if self.displacement and holds.any():
            holds &= strength >= np.quantile(strength[holds], _LIGHTEST)
        q = touches.q[holds]
        now = q - self.offset
        # Steps towards `_as_before(now) = q` shrink, as the displacement is smooth.
        for _ in range(8 if self.displacement else 0):
            now = now + q - self._as_before(now)
        moved = TouchSet(now.astype(np.float32), felt[holds])
        if not self.displacement:
            return moved
        return moved[np.all((moved.q >= self.reach[0]) & (moved.q <= self.reach[1]), axis=1)]

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        swapped = np.flatnonzero(self.source != np.arange(len(self.source)))
        found = [
            f"{num} receptor{' is' if num == 1 else 's are'} {what}"
            for num, what in ((self.silent.sum(), "silent"), (self.new.receptors.sum(), "new"))
            if num
        ]
        if len(swapped):
            found.append(f"{len(swapped)} receptors changed places")
        # A displacement says more than numbers that were not enough.
        if self.displacement:
            found.append("all joints act as if they were a little elsewhere")
        else:
            found += [
                f"joint {joint} is {self.offset[joint]:+.4f} from what it reads"
                for joint in np.flatnonzero(self.offset)
            ]
        return "; ".join(found) or "nothing that explains it"

    def _readings(self, sensation: np.ndarray) -> np.ndarray:
        felt = self.new.filled_in(sensation[:, self.source])
        return np.where(self.silent, 0.0, felt).astype(np.float32)

    def _as_before(self, q: np.ndarray) -> np.ndarray:
        moved = q + self.offset
        if not self.displacement:
            return moved
        x = self.expectation.standardised(q)
        displaced = np.mean([network(x) for network in self.displacement], axis=0)
        return moved + displaced * self.expectation.scale


def explain_change(
    expectation: Expectation,
    usual: TouchSet,
    before: TouchSet,
    since: TouchSet,
    *,
    num_steps: int = NUM_STEPS,
    seed: int = 0,
) -> BodyChange:
    """Finds out what changed, by touches that were remembered before, and touches since the change.

    The usual ones are the last from before the change, in order, from which the expectation did not
    learn; as many of them count as there are touches since. No sensation is null. The steps train
    an expectation.
    """
    fit, others = _divided(since)
    usual_fit, usual_others = _divided(usual[-len(since) :])
    silent_before = ~np.any(before.sensation > 0, axis=0)

    def displaced(change: BodyChange, touches: TouchSet) -> BodyChange:
        through = change.through or tuple(
            Expectation(before, like=expectation, num_steps=steps, seed=seed)
            for steps in (num_steps // _BLUNT, num_steps)
        )
        return _displaced(replace(change, through=through), touches, seed)

    best = BodyChange(
        expectation=expectation,
        source=np.arange(len(silent_before)),
        silent=np.zeros_like(silent_before),
        new=NewReceptors(silent_before, unit(fit.sensation)),
        offset=np.zeros(since.q.shape[1]),
        reach=np.stack([before.q.min(axis=0), before.q.max(axis=0)]),
    )
    by_chance = replace(
        best,
        # Before the change, receptors that are new felt nothing.
        new=NewReceptors(np.zeros_like(silent_before), unit(fit.sensation)),
        # Other networks would learn from the touches that are compared with. Twice, for as many
        # steps as through a blunt and a sharp one.
        through=(expectation, expectation),
    )
    least = best.surprise_left(others) / by_chance.surprise_left(usual_others)
    for explained in (_rewired, _with_offset, displaced):
        if least <= _ENOUGH:
            break
        found, chance = explained(best, fit), explained(by_chance, usual_fit)
        ratio = found.surprise_left(others) / chance.surprise_left(usual_others)
        if ratio < _WORTH * least:
            best, by_chance, least = found, chance, ratio
    # One silent receptor of many leaves hardly any surprise.
    return refined(replace(best, silent=best.silent | _silent(best, since)), since, seed=seed)


def refined(change: BodyChange, since: TouchSet, *, seed: int = 0) -> BodyChange:
    """Makes a displacement, or a guess of what new receptors feel, more exact with more touches.

    No sensation of `since` is null; `seed` is for the training.
    """
    new = NewReceptors(change.new.silent_before, unit(since.sensation))
    q = np.concatenate([change.reach, since.q])
    change = replace(change, new=new, reach=np.stack([q.min(axis=0), q.max(axis=0)]))
    return _displaced(change, since, seed) if change.displacement else change


def _divided(touches: TouchSet) -> tuple[TouchSet, TouchSet]:
    """Two thirds, to which explanations are fitted, and every third touch, to judge them."""
    judge = np.arange(len(touches)) % 3 == 2
    return touches[~judge], touches[judge]


def _rewired(change: BodyChange, touches: TouchSet) -> BodyChange:
    """Finds silent receptors, and readings that changed places."""
    expected, felt = with_unit_norm(change.expected(touches.q)), unit(touches.sensation)
    both = expected.T @ felt
    both /= np.outer(np.linalg.norm(expected, axis=0), np.linalg.norm(felt, axis=0)) + 1e-9
    _, was = linear_sum_assignment(-both.T)
    reading = np.arange(len(was))
    moved = both[was, reading] > both[reading, reading] + _BETTER
    # Where a reading moved, its own receptor must be the source of another moved reading.
    while moved.any() and (lost := moved & ~np.isin(reading, was[moved])).any():
        moved &= ~lost
    source = np.where(moved, was, reading)
    return replace(change, source=source, silent=_silent(change, touches))


def _silent(change: BodyChange, touches: TouchSet) -> np.ndarray:
    """`(S,)` bool, receptors that should have felt and never did."""
    expected = with_unit_norm(change.expected(touches.q))
    return ((expected > _FELT).sum(axis=0) >= _SURELY) & ~touches.sensation.any(axis=0)


def _with_offset(change: BodyChange, touches: TouchSet) -> BodyChange:
    """Finds joints whose zeros moved, one after another, as long as surprise falls."""
    axes = np.diag(change.expectation.scale)

    def left(offset: np.ndarray, num: int | None = None) -> float:
        return replace(change, offset=offset).surprise_left(touches[:num])

    best, least = change.offset, left(change.offset)
    for _ in axes:
        tried = [best + by * axis for axis in axes for by in np.linspace(-_REACH, _REACH, _TRIED)]
        found = min(tried, key=lambda offset: left(offset, _FEW))
        axis = axes[np.abs(found - best).argmax()]
        finer = minimize_scalar(
            lambda by, found=found, axis=axis: left(found + by * axis),
            bounds=(-2 * _REACH / (_TRIED - 1), 2 * _REACH / (_TRIED - 1)),
            method="bounded",
            options={"maxiter": 12},
        )
        if finer.fun > _WORTH * least:
            break
        best, least = found + finer.x * axis, finer.fun
    return replace(change, offset=best)


def _displaced(change: BodyChange, touches: TouchSet, seed: int) -> BodyChange:
    """Learns where the joints would have to be for the agent to expect what it feels.

    A blunt expectation shows from farther away where to go, a sharp one where exactly. So the
    displacement is learned through one after the other.
    """
    expectation, rng = change.expectation, np.random.default_rng(seed)
    # What readings would have been before they changed places; silent and new ones say nothing,
    # nor does firmness if there are any.
    unknown = change.silent | change.new.receptors
    wanted = expectation.as_learned(touches)
    counts = np.full(wanted.shape[1], not unknown.any(), np.float32)
    wanted[:, change.source] = wanted[:, :-1].copy()
    counts[change.source] = ~unknown
    x = expectation.standardised(touches.q)
    start = expectation.standardised(touches.q + change.offset)
    num_joints, growth = x.shape[1], math.sqrt(len(x) / 1000)

    def trained() -> Network:
        network = Network.random([num_joints, round(_HIDDEN * growth), num_joints], rng)
        network.weights[-1][:] = 0.0
        for expects in (one.network for one in change.through):

            def slope(
                displaced: np.ndarray, rows: np.ndarray, expects: Network = expects
            ) -> np.ndarray:
                outputs, _, slopes = expects.forward(start[rows] + displaced)
                off = 2.0 * counts * (outputs - wanted[rows]) / len(rows)
                pull = 2.0 * _PENALTY / growth / len(rows) * displaced
                return expects.slope_of_inputs(off, slopes) + pull

            draw = partial(rng.integers, len(x), size=_BATCH)
            train(network, x, draw, slope, round(_NUM_STEPS * growth))
        return network

    return replace(change, displacement=tuple(trained() for _ in range(_NETWORKS)))
