"""Who touched, before any model: where in motor space the touches of one toucher lie dense.

Within one kernel the joints that carry a toucher hold each other, so that its touches lie on a
surface of low dimension, and those of others are spread. Touchers on different limbs are told apart
by the densities of their limbs' joints. The bandwidth is annealed: wide ones find the touchers, and
narrow ones make them sure.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.body_model.fit import Group
from selftouch_drake.agent.body_model.structure import pair_statistic
from selftouch_drake.compiled import compiled, inner

# Standard deviations of the readings. The next one is not taken if it explains less.
_BANDWIDTHS = (0.5, 0.35, 0.25, 0.18)
_ROUNDS = 8
# Floor of a density, relative to the background, and of a toucher's share of a kernel.
_FLOOR = 0.02
#: A touch is surely of a limb above this probability. Of the iCub's head 1 and 0.6 % of those above
#: 0.85 are of the other hand, 0.1 of those above this: the criterion of a right chain falls by 2,
#: and that of a wrong order by half as much.
SURE = 0.99
#: The same for a first look, or where surer ones are few.
NEARLY_SURE = 0.85
# A joint that another limb needs by more than this share is of both.
_OF_BOTH = 0.5
# A limb has so many joints here at most, those that hold each other most; a weaker limb than this,
# relative to the strongest, is none.
_CORE, _WEAKEST = 4, 0.15


def limbs(statistic: np.ndarray, noise: float) -> list[list[int]]:
    """Groups of joints that hold each other, by modularity of the statistic of pairs.

    Args:
        statistic: `(J, J)` of `structure.pair_statistic`.
        noise: its standard deviation by chance; NaN where nothing is known of pairs.
    """
    if not np.isfinite(noise):
        return []
    num_joints = len(statistic)
    apart = statistic[~np.eye(num_joints, dtype=bool)]
    low = float(np.median(apart[apart < np.median(apart) + 4 * noise]))
    tie = np.sqrt(np.maximum(statistic - max(low, 0.0) - 4 * noise, 0.0))
    np.fill_diagonal(tie, 0.0)
    degree = tie.sum(axis=1)
    live = np.flatnonzero(degree > 0)
    if len(live) < 4:
        return [live.tolist()] if len(live) else []
    gain = tie - np.outer(degree, degree) / degree.sum()
    groups = [[int(joint)] for joint in live]
    while len(groups) > 1:
        best, pair = 1e-12, None
        for a, b in itertools.combinations(range(len(groups)), 2):
            value = gain[np.ix_(groups[a], groups[b])].sum()
            if value > best:
                best, pair = value, (a, b)
        if pair is None:
            break
        groups[pair[0]] += groups.pop(pair[1])
    groups = _single_moves(groups, gain)
    return _cores(groups, statistic)


def _single_moves(groups: list[list[int]], gain: np.ndarray) -> list[list[int]]:
    for _ in range(30):
        best, move = 1e-9, None
        for a, b in itertools.permutations(range(len(groups)), 2):
            for joint in groups[a]:
                rest = [other for other in groups[a] if other != joint]
                value = gain[joint, groups[b]].sum() - gain[joint, rest].sum()
                if value > best:
                    best, move = value, (a, joint, b)
        if move is None:
            break
        groups[move[0]].remove(move[1])
        groups[move[2]].append(move[1])
        groups = [group for group in groups if group]
    return groups


def _cores(groups: list[list[int]], statistic: np.ndarray) -> list[list[int]]:
    cores = []
    for group in groups:
        inside = statistic[np.ix_(group, group)].max(axis=1)
        strong = [j for j, value in zip(group, inside, strict=True) if value > 0.25 * inside.max()]
        strong.sort(key=lambda joint: -statistic[joint, group].max())
        if len(strong) >= 2:
            cores.append(sorted(strong[:_CORE]))
    if not cores:
        return []
    strength = [statistic[np.ix_(core, core)].max() for core in cores]
    return [
        core
        for core, value in zip(cores, strength, strict=True)
        if value > _WEAKEST * max(strength)
    ]


@inner
def _fill_near(x, scale, near):
    """Fills in how near each two of `(n, D)` touches are, `(n, n)` or more; none to itself."""
    for a in range(len(x)):
        near[a, a] = 0.0
        for b in range(a):
            square = 0.0
            for d in range(x.shape[1]):
                step = x[a, d] - x[b, d]
                square += step * step
            value = math.exp(scale * square)
            near[a, b] = value
            near[b, a] = value


@inner
def _share_anew(share, near, background, floor, fresh, mass, total):
    """One round in a kernel of n touches: replaces `(n, U)` shares; fills in `(n,)` evidence."""
    n, num_limbs = share.shape
    for u in range(num_limbs):
        mass[u] = 0.0
        for a in range(n):
            mass[u] += share[a, u]
    for a in range(n):
        total[a] = 0.0
        for u in range(num_limbs):
            density = 0.0
            for b in range(n):
                density += near[u, a, b] * share[b, u]
            density = density / (mass[u] - share[a, u] + 1e-6) / (background[a, u] + 1e-6)
            fresh[a, u] = (density + floor) * (mass[u] / n + floor)
            total[a] += fresh[a, u]
        for u in range(num_limbs):
            fresh[a, u] /= total[a]
    for a in range(n):
        for u in range(num_limbs):
            share[a, u] = fresh[a, u]


@compiled
def _rounds(x, first, offsets, background, share, bandwidth, rounds, floor):
    """Rounds of responsibilities within each kernel; returns the mean log evidence."""
    num_touches, num_limbs = share.shape
    largest = 0
    for k in range(len(offsets) - 1):
        largest = max(largest, offsets[k + 1] - offsets[k])
    near = np.zeros((num_limbs, largest, largest), np.float32)
    fresh, mass = np.zeros((largest, num_limbs)), np.zeros(num_limbs)
    total = np.zeros(largest)
    evidence = 0.0
    for k in range(len(offsets) - 1):
        start, stop = offsets[k], offsets[k + 1]
        here = share[start:stop]
        for u in range(num_limbs):
            _fill_near(x[start:stop, first[u] : first[u + 1]], -0.5 / bandwidth**2, near[u])
        for _turn in range(rounds):
            _share_anew(here, near, background[start:stop], floor, fresh, mass, total)
        for a in range(stop - start):
            evidence += math.log(total[a])
    return evidence / num_touches


def telling_cores(q: np.ndarray, group: Group, cores: list[list[int]]) -> list[list[int]]:
    """Joints that tell limbs apart: those of the mixture, or of each limb's own touches.

    Those that tell who made more of the touches surely.

    Args:
        q: `(J, R)` standardised readings.
        group: touches of one part: all of some kernels.
        cores: of limbs, in the mixture.
    """
    own = own_cores(q, group, cores)
    tried = [some for some in (cores, own) if len(some) >= 2]
    sure = [float((who_touched(q, group, some).max(axis=1) > SURE).mean()) for some in tried]
    return tried[int(np.argmax(sure))] if tried else []


def own_cores(q: np.ndarray, group: Group, cores: list[list[int]]) -> list[list[int]]:
    """The joints of limbs among the touches of each limb alone.

    In a mixture of limbs joints of one may seem to hold those of another, one limb may fall into
    two, and joints that several limbs need are given to one of them. Two limbs with the same joints
    are one.

    Args:
        q: `(J, R)` standardised readings.
        group: touches of one part.
        cores: of limbs, in the mixture.
    """
    share = who_touched(q, group, cores, _BANDWIDTHS[:2])
    labels, limb_of = group.labels(), share.argmax(axis=1)
    strength = list[np.ndarray]()
    for limb in range(len(cores)):
        sure = (limb_of == limb) & (share[:, limb] > NEARLY_SURE)
        own = Group.of(group.rows[sure], labels[sure])
        statistic, noise = pair_statistic(q, own, least=20)
        if np.isfinite(noise):
            strength.append(np.sort(statistic, axis=1)[:, -_CORE:].sum(axis=1))
    strongest = [set(np.argsort(-mine)[:_CORE].tolist()) for mine in strength]
    kept = list[int]()
    for limb in sorted(range(len(strength)), key=lambda limb: -strength[limb].max()):
        if all(2 * len(strongest[limb] & strongest[other]) <= _CORE for other in kept):
            kept.append(limb)
    found = []
    for limb in kept:
        mine = strength[limb]
        others = [strength[other] for other in kept if other != limb]
        most = np.max(others, axis=0) if others else np.zeros(len(mine))
        alone = np.flatnonzero(most < _OF_BOTH * mine)
        found.append(sorted(alone[np.argsort(-mine[alone])][:_CORE].tolist()))
    return [core for core in found if len(core) >= 2]


def who_touched(
    q: np.ndarray,
    group: Group,
    cores: list[list[int]],
    bandwidths: Sequence[float] = _BANDWIDTHS,
) -> np.ndarray:
    """`(n, U)` probability that each limb made each touch, in the order of `group.rows`.

    Args:
        q: `(J, R)` standardised readings.
        group: touches of one part.
        cores: U limbs, each a list of joints.
        bandwidths: one after another; standard deviations of the readings.
    """
    own = q[:, group.rows].T.astype(np.float32)
    x = np.ascontiguousarray(np.concatenate([own[:, core] for core in cores], axis=1))
    first = np.concatenate([[0], np.cumsum([len(core) for core in cores])]).astype(np.int64)
    best_evidence, best = -np.inf, np.full((len(own), len(cores)), 1 / len(cores))
    for bandwidth in bandwidths:
        background = np.stack([_background(own[:, core], bandwidth) for core in cores], axis=1)
        share = best.copy()
        evidence = _rounds(
            x, first, group.offsets, background, share, bandwidth, np.int64(_ROUNDS), _FLOOR
        )
        if evidence <= best_evidence:
            break
        best_evidence, best = evidence, share
    return best


def _background(x: np.ndarray, bandwidth: float, most: int = 2500) -> np.ndarray:
    """`(n,)` density of all touches, smoothed at least by 0.4 standard deviations."""
    some = x[:: max(1, len(x) // most)]
    wide = max(bandwidth, 0.4)
    density = np.empty(len(x))
    for start in range(0, len(x), 4000):
        piece = x[start : start + 4000]
        squares = (piece**2).sum(axis=1)[:, None] + (some**2).sum(axis=1) - 2 * piece @ some.T
        density[start : start + 4000] = np.exp(-0.5 * np.maximum(squares, 0) / wide**2).mean(axis=1)
    return density * (bandwidth / wide) ** x.shape[1]
