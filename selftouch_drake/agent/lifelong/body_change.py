"""Finds what changed in the body, and makes old touches into touches of it (naive).

Two kinds of things can change between motor configurations and sensations. First, the readings of
receptors: receptors fall silent, begin to feel, or change places. Second, what the readings of
joints mean: after a zero moved, a link grew or a skin slipped, the body acts as if the joints were
a little elsewhere. So the agent asks where its joints would have to be for it to expect what it
feels. It first tries one number for one joint; if that is not enough, a smooth displacement that
depends on the configuration.

The expectation does not change meanwhile: it says what the body before the change would have felt.
An explanation counts only if it explains more than one like it, fitted to touches from before the
change, explains there.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar

from selftouch_drake.agent.lifelong.displacement import displacement
from selftouch_drake.agent.lifelong.new_receptors import NewReceptors
from selftouch_drake.agent.lifelong.surprise import NUM_STEPS, Expectation, with_unit_norm
from selftouch_drake.agent.network import Network
from selftouch_drake.agent.representation.quantise import unit

#: A receptor that is expected to feel in this many touches, and feels in none, is silent.
_SURELY = 20

#: A receptor counts as expected, or felt, if its reading is at least this share of a sensation.
_FELT = 0.1

#: A touch from before the change is forgotten if new receptors make up more than this share of it.
_GUESSED = 0.98

#: A reading moved if its cosine with what another receptor should feel exceeds by this much the
#: cosine with what its own receptor should feel.
_BETTER = 0.3

#: Standard deviations to either side within which offsets of a joint are tried, and their number.
_REACH, _TRIED = 1.0, 41

#: Surprise is compared with that of touches from before the change, to which the same explanation
#: was fitted: any fit lowers surprise, the more so the worse the agent expects. A more complicated
#: explanation is taken if it leaves less than this share of this ratio. The search ends if the
#: ratio is at most the second number.
_WORTH, _ENOUGH = 0.9, 1.1

#: Least surprise that counts. The mean is a geometric one, as novel touches surprise much in any
#: body: after a cube's forearm grew in an active life, a displacement lowers the ratio from 1.43 to
#: 1.06, and that of arithmetic means only from 1.20 to 1.09. After ten receptors died, the ratio
#: rises with a displacement, either way (1.20 to 1.39, and 1.24 to 1.53).
_LEAST = 0.001

#: Touches for the first search of each joint's zero.
_FEW = 400

#: Number of series of expectations through which a displacement is learned; a blunt expectation has
#: the training steps of a sharp one divided by the second number.
_THROUGH, _BLUNT = 2, 2

#: Share of the touches from before the change, the lightest, that are forgotten if they were moved
#: by a displacement: it is not exact, and a small error leads a light touch off the skin. Without
#: them, planned paths keep contact better (by 1 percentage point on a stretched torus); if half are
#: forgotten, the shape is worse (3.1 %, not 2.9 %, on a torus whose skin slipped).
_LIGHTEST = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyChange:
    """What changed in the body, and what becomes of touches from before the change.

    Attributes:
        source: `(S,)` number of the old receptor that each reading now comes from.
        silent: `(S,)` bool, receptors that no longer feel.
        new: receptors that never felt before, and what they would have felt.
        offset: `(J,)` difference between where each joint is and what it reads.
        displacement: networks from standardised configurations to a further difference, in standard
            deviations; their mean counts. There are none if the offset explains all.
        through: series of expectations, from blunt to sharp, through which the displacement was
            learned; none before it is.
        reach: `(2, J)` least and greatest reading of each joint, before and after the change.
        surprise: geometric mean of the surprise of touches since the change, without and with this
            explanation.
        expectation: what was expected before the change.
    """

    source: np.ndarray
    silent: np.ndarray
    new: NewReceptors
    offset: np.ndarray
    displacement: tuple[Network, ...]
    through: tuple[tuple[Expectation, ...], ...]
    reach: np.ndarray
    surprise: tuple[float, float]
    expectation: Expectation

    def expected(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected now at `q` `(n, J)`."""
        return self._readings(self.expectation(self._as_before(q)))

    def left(self, touches: _Touches) -> float:
        """Geometric mean of the surprise of touches, if this is what changed."""
        expected = self.expected(touches.q)
        surprise = self.expectation.surprise(expected, touches.sensation)
        return float(np.exp(np.log(np.maximum(surprise, _LEAST)).mean()))

    def mended(self, q: np.ndarray, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Makes touches from before the change into touches of the changed body.

        Args:
            q: `(n, J)` motor configurations from before the change.
            sensation: `(n, S)` what was felt there.

        Returns:
            `(m, J)` and `(m, S)`, without touches in which nothing would be felt now. If there is a
            displacement, the lightest are missing too, and those at readings that no joint had.
        """
        felt = self._readings(sensation)
        # If only a faint receptor at the rim of a touch remains, it says little of its place.
        strength = np.linalg.norm(felt, axis=1)
        holds = strength > 2 * _FELT * np.linalg.norm(sensation, axis=1)
        guessed = np.linalg.norm(felt[:, self.new.receptors], axis=1)
        holds &= guessed <= _GUESSED * strength
        if self.displacement and holds.any():
            holds &= strength >= np.quantile(strength[holds], _LIGHTEST)
        now, felt = self._as_now(q[holds]), felt[holds]
        if self.displacement:
            lower, upper = self.reach
            reached = np.all((now >= lower) & (now <= upper), axis=1)
            now, felt = now[reached], felt[reached]
        return now, felt

    @property
    def is_a_guess(self) -> bool:
        """Whether more touches of the changed body would make this more exact."""
        return bool(self.displacement) or bool(self.new.receptors.any())

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

    def _as_now(self, q: np.ndarray) -> np.ndarray:
        """Solves `_as_before(now) = q`; its steps shrink, as the displacement is smooth."""
        now = q - self.offset
        for _ in range(8 if self.displacement else 0):
            now = now + q - self._as_before(now)
        return now.astype(np.float32)


def explain_change(
    expectation: Expectation,
    usual: tuple[np.ndarray, np.ndarray],
    before: tuple[np.ndarray, np.ndarray],
    q: np.ndarray,
    sensation: np.ndarray,
    *,
    num_steps: int = NUM_STEPS,
    seed: int = 0,
) -> BodyChange:
    """Finds out what changed.

    Args:
        expectation: what was expected before the change.
        usual: `(k, J)` motor configurations and `(k, S)` N, the last touches from before the
            change, in order, from which the expectation did not learn. The last `n` count.
        before: `(m, J)` motor configurations and `(m, S)` N, remembered touches from before the
            change.
        q: `(n, J)` motor configurations since the change.
        sensation: `(n, S)` N, what was felt there; no row null.
        num_steps: training steps of an expectation.
        seed: for the training of a displacement and its expectations.
    """
    fit, others = _Touches(q, sensation).divided
    usual_fit, usual_others = _Touches(usual[0][-len(q) :], usual[1][-len(q) :]).divided
    known = np.any(before[1] > 0, axis=0)

    nothing = BodyChange(
        source=np.arange(len(known)),
        silent=np.zeros(len(known), dtype=bool),
        new=NewReceptors.learned(~known, fit.felt),
        offset=np.zeros(q.shape[1]),
        displacement=(),
        through=(),
        reach=_reach(before[0], q),
        surprise=(0.0, 0.0),
        expectation=expectation,
    )

    def displaced(one: BodyChange, touches: _Touches) -> BodyChange:
        through = one.through or tuple(
            tuple(
                Expectation.learn(*before, like=expectation, num_steps=steps, seed=seed + number)
                for steps in (num_steps // _BLUNT, num_steps)
            )
            for number in range(_THROUGH)
        )
        return _displaced(dataclasses.replace(one, through=through), touches, seed)

    by_chance = dataclasses.replace(
        nothing,
        # Before the change, receptors that are new felt nothing.
        new=NewReceptors.learned(np.zeros_like(known), fit.felt),
        # Other networks would learn from the touches that are compared with. Twice, for as many
        # steps as through a blunt and a sharp one.
        through=((expectation, expectation),),
    )
    best, at_first = nothing, nothing.left(others)
    least = at_first / by_chance.left(usual_others)
    for explained in (_rewired, _with_offset, displaced):
        if least <= _ENOUGH:
            break
        found, chance = explained(best, fit), explained(by_chance, usual_fit)
        if (ratio := found.left(others) / chance.left(usual_others)) < _WORTH * least:
            best, by_chance, least = found, chance, ratio
    # One silent receptor of many leaves hardly any surprise.
    silent = best.silent | _silent(best, _Touches(q, sensation))
    best = dataclasses.replace(best, silent=silent)
    best = dataclasses.replace(best, surprise=(at_first, best.left(others)))
    return learned_again(best, q, sensation, seed=seed)


def learned_again(
    mending: BodyChange, q: np.ndarray, sensation: np.ndarray, *, seed: int = 0
) -> BodyChange:
    """Makes a guess more exact, with more touches since the change; see `BodyChange.is_a_guess`.

    Args:
        mending: what changed, as far as the agent knows.
        q: `(n, J)` motor configurations since the change.
        sensation: `(n, S)` N, what was felt there; no row null.
        seed: for the training.
    """
    touches = _Touches(q, sensation)
    new = NewReceptors.learned(mending.new.silent_before, touches.felt)
    mending = dataclasses.replace(mending, new=new, reach=_reach(mending.reach, q))
    return _displaced(mending, touches, seed) if mending.displacement else mending


@dataclass(frozen=True, slots=True, eq=False)
class _Touches:
    """Touches: `(n, J)` configurations, and `(n, S)` N, what was felt there."""

    q: np.ndarray
    sensation: np.ndarray

    @property
    def felt(self) -> np.ndarray:
        """`(n, S)` unit L2 norm."""
        return unit(self.sensation)

    @property
    def divided(self) -> tuple[_Touches, _Touches]:
        """Two thirds, from which explanations are found, and every third touch, to judge them."""
        judge = np.arange(len(self.q)) % 3 == 2
        fit, others = (_Touches(self.q[rows], self.sensation[rows]) for rows in (~judge, judge))
        return fit, others


def _reach(*qs: np.ndarray) -> np.ndarray:
    """`(2, J)` least and greatest reading of each joint in arrays `(n, J)`."""
    return np.array(
        [np.min([q.min(axis=0) for q in qs], axis=0), np.max([q.max(axis=0) for q in qs], axis=0)]
    )


def _rewired(mending: BodyChange, touches: _Touches) -> BodyChange:
    """Finds silent receptors, and readings that changed places."""
    expected, felt = with_unit_norm(mending.expected(touches.q)), touches.felt
    both = expected.T @ felt
    both /= np.outer(np.linalg.norm(expected, axis=0), np.linalg.norm(felt, axis=0)) + 1e-9
    _, was = linear_sum_assignment(-both.T)
    reading = np.arange(len(was))
    moved = both[was, reading] > both[reading, reading] + _BETTER
    # Where a reading moved, its own receptor must be the source of another moved reading.
    while moved.any() and (lost := moved & ~np.isin(reading, was[moved])).any():
        moved &= ~lost
    source = np.where(moved, was, reading)
    return dataclasses.replace(mending, source=source, silent=_silent(mending, touches))


def _silent(mending: BodyChange, touches: _Touches) -> np.ndarray:
    """`(S,)` bool, receptors that should have felt and never did."""
    expected = with_unit_norm(mending.expected(touches.q))
    return ((expected > _FELT).sum(axis=0) >= _SURELY) & ~touches.sensation.any(axis=0)


def _with_offset(mending: BodyChange, touches: _Touches) -> BodyChange:
    """Finds joints whose zeros moved, one after another, as long as surprise falls."""
    scale = mending.expectation.scale

    def left(offset: np.ndarray, num: int | None = None) -> float:
        some = _Touches(touches.q[:num], touches.sensation[:num])
        return dataclasses.replace(mending, offset=offset).left(some)

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


def _displaced(mending: BodyChange, touches: _Touches, seed: int) -> BodyChange:
    """Learns where the joints would have to be for the agent to expect what it feels."""
    expectation = mending.expectation
    # What readings would have been before they changed places; silent and new ones say nothing,
    # nor does firmness if there are any.
    unknown = mending.silent | mending.new.receptors
    wanted = expectation.felt(touches.sensation)
    counts = np.full(wanted.shape[1], not unknown.any(), np.float32)
    wanted[:, mending.source] = wanted[:, :-1].copy()
    counts[mending.source] = ~unknown
    networks = displacement(
        [[one.network for one in series] for series in mending.through],
        expectation.standardised(touches.q),
        expectation.standardised(touches.q + mending.offset),
        wanted,
        counts,
        seed=seed,
    )
    return dataclasses.replace(mending, displacement=networks)
