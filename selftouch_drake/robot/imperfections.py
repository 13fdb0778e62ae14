"""Readings of real skins and joints: noise, dead receptors, quantisation, slipped joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.special import ndtri

from selftouch_drake.experiment import Experiment
from selftouch_drake.experiment.schema import Imperfections, ReadingSettings, SkinChange
from selftouch_drake.robot.readings import read_forces
from selftouch_drake.robot.skins import SkinModel

# In standard deviations of the additive noise; see `Imperfections.threshold`.
_SILENCE = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImperfectSkins:
    """Turns sensations of perfect skins into readings of imperfect ones.

    Attributes:
        skins: for each skin the columns of a sensation that are its own, and its imperfections.
    """

    skins: "tuple[tuple[slice, ImperfectSkin], ...]"

    @staticmethod
    def of(experiment: Experiment, skins: Sequence[SkinModel]) -> "ImperfectSkins | None":
        """The imperfections of the skins of `experiment`; None if all are perfect."""
        ends = np.cumsum([0, *(skin.fields.num_receptors for skin in skins)]).tolist()
        found = tuple(
            (slice(ends[number], ends[number + 1]), imperfect)
            for number, skin in enumerate(skins)
            if (imperfect := ImperfectSkin.of(experiment, number, skin)) is not None
        )
        return ImperfectSkins(skins=found) if found else None

    def __call__(
        self, sensation: np.ndarray, q: np.ndarray, before: np.ndarray | None = None
    ) -> np.ndarray:
        """`(N, S)` N, readings if perfect skins feel `sensation` at `q` `(N, J)`.

        The last readings, `(N, S)`, count where a skin has hysteresis.
        """
        read = np.array(sensation, dtype=float)
        for columns, skin in self.skins:
            last = None if before is None else before[:, columns]
            read[:, columns] = skin(sensation[:, columns], q, last)
        return read


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImperfectSkin:
    """Turns sensations of one perfect skin into readings of an imperfect one.

    Noise is a function of the seed and of the motor configuration, so that kinematic and dynamic
    worlds agree, in any order and after any crash.

    Attributes:
        flaws: the imperfections of the skin.
        reading: what is reported of the forces in the end.
        leak: `(S, S)` sparse, rows that sum to one: where what leaks from a receptor goes.
        source: `(S,)` the receptor that each reading comes from.
        alive: `(S,)` which receptors read anything.
        seed: of the noise, 64 bits.
    """

    flaws: Imperfections
    reading: ReadingSettings
    leak: csr_matrix
    source: np.ndarray
    alive: np.ndarray
    seed: int

    @staticmethod
    def of(experiment: Experiment, number: int, skin: SkinModel) -> "ImperfectSkin | None":
        """The imperfections of skin `number` of `experiment`; None if it is perfect."""
        described, num_receptors = experiment.skins[skin.name], skin.fields.num_receptors
        flaws, reading = described.imperfections, described.reading
        changes = [
            change.skins[skin.name]
            for change in experiment.body_changes
            if skin.name in change.skins
        ]
        rewired = any(c.dead or c.new or c.swapped for c in changes)
        rewired |= any(c.dead_share or c.swapped_share for c in changes)
        if flaws == Imperfections() and reading.most == np.inf and not rewired:
            return None
        # The first skin keeps the stream of versions with one skin.
        which = (number,) if number else ()
        rng = np.random.default_rng(experiment.random_stream("skin", 0, *which))
        alive = np.ones(num_receptors, dtype=bool)
        num_dead = round(flaws.dead * num_receptors)
        alive[rng.choice(num_receptors, num_dead, replace=False)] = False
        source = np.arange(num_receptors)
        for when, change in enumerate(changes):
            changing = np.random.default_rng(experiment.random_stream("changes", number, when))
            _rewire(change, source, alive, changing)
        (seed,) = experiment.random_stream("skin", 1, *which).generate_state(1, np.uint64)
        leak = (skin.fields.vertex_weights.T @ skin.fields.vertex_weights).tocsr()
        # Nothing leaks from a field that overlaps with no other.
        alone = leak.diagonal() >= leak.sum(axis=1).A1
        leak.setdiag(alone.astype(float))
        leak = (leak / leak.sum(axis=1)).tocsr()
        return ImperfectSkin(
            flaws=flaws,
            reading=reading,
            leak=leak,
            source=source,
            alive=alive,
            seed=int(seed),
        )

    @property
    def threshold(self) -> float:
        """N, smaller readings count as zero."""
        given = self.flaws.threshold
        return _SILENCE * self.flaws.additive_noise if given is None else given

    def __call__(
        self, sensation: np.ndarray, q: np.ndarray, before: np.ndarray | None = None
    ) -> np.ndarray:
        """`(N, S)` readings if a perfect skin feels `sensation` `(N, S)` N at `q` `(N, J)`.

        None is negative. The last readings, `before`, are as in `read_forces`.
        """
        flaws = self.flaws
        read = np.array(sensation, dtype=float)
        if flaws.cross_talk:
            read += flaws.cross_talk * (read @ self.leak - read)
        touched = np.flatnonzero(read.any(axis=1))
        if flaws.multiplicative_noise and len(touched):
            error = standard_noise(q[touched], read.shape[1], seed=self.seed)
            read[touched] *= 1 + flaws.multiplicative_noise * error
        if flaws.additive_noise:
            read += flaws.additive_noise * standard_noise(q, read.shape[1], seed=self.seed + 1)
        if flaws.saturation is not None:
            np.minimum(read, flaws.saturation, out=read)
        if flaws.quantisation:
            # If the quantisation step underflows, readings stay unquantised.
            with np.errstate(over="ignore"):
                steps = read / flaws.quantisation
            read = np.where(np.isfinite(steps), flaws.quantisation * np.round(steps), read)
        read[(read < self.threshold) | (read < 0)] = 0.0
        read = read[:, self.source]
        read[:, ~self.alive] = 0.0
        return read_forces(read, self.reading, before)


def _rewire(
    change: SkinChange, source: np.ndarray, alive: np.ndarray, rng: np.random.Generator
) -> None:
    """Changes in place which receptor each reading comes from, and which receptors are alive."""
    num_receptors = len(source)
    num_pairs = round(change.swapped_share * num_receptors / 2)
    drawn = rng.permutation(num_receptors)[: 2 * num_pairs].reshape(-1, 2)
    for pair in [*change.swapped, *drawn.tolist()]:
        source[pair], alive[pair] = source[pair[::-1]], alive[pair[::-1]]
    alive[change.new] = True
    alive[change.dead] = False
    num_dead = round(change.dead_share * num_receptors)
    alive[rng.choice(num_receptors, num_dead, replace=False)] = False


def remembered(experiment: Experiment, q: np.ndarray) -> np.ndarray:
    """`(N, J)` configurations as the agent remembers them, for true ones `q` `(N, J)`."""
    if not experiment.joints.noise:
        return q
    (seed,) = experiment.random_stream("joints", 1).generate_state(1, np.uint64)
    error = standard_noise(q, q.shape[1], seed=int(seed))
    return (q + experiment.joints.noise * error).astype(q.dtype)


def slip(experiment: Experiment, num_joints: int) -> np.ndarray:
    """`(J,)` rad or m, by how much joint readings exceed the true positions after babbling."""
    rng = np.random.default_rng(experiment.random_stream("joints", 0))
    return experiment.joints.offset * rng.standard_normal(num_joints)


def standard_noise(q: np.ndarray, width: int, *, seed: int) -> np.ndarray:
    """`(N, width)` standard normal numbers, each row decided by the seed and by its `q` `(N, J)`.

    Configurations count as they are stored, in float32. A counter-based generator: the mixing
    function of SplitMix64 (Steele, Lea and Flood 2014) over seed, configuration and column.
    """
    state = np.full(len(q), seed & _ALL_BITS, dtype=np.uint64)
    for bits in np.ascontiguousarray(q, dtype=np.float32).view(np.uint32).T:
        state = _mixed(state ^ bits)
    columns = _GOLDEN * np.arange(1, width + 1, dtype=np.uint64)
    bits = _mixed(state[:, None] + columns)
    return ndtri(((bits >> np.uint64(11)) + 0.5) * 2.0**-53)


_ALL_BITS = 2**64 - 1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def _mixed(bits: np.ndarray) -> np.ndarray:
    bits = bits + _GOLDEN
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
