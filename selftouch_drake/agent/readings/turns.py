"""Joints that turn round and round (naive): whether a reading one turn on is the same posture.

A turntable's angle may be counted on, over many turns, or begin again after each. For the agent
both are one thing, if what is felt comes back after a turn.
"""

import numpy as np
from scipy.spatial import KDTree

#: A turn in rad and in degrees. Ticks turn after a power of two.
_TURNS = (2 * np.pi, 360.0)
_TICKS = tuple(float(2**power) for power in range(8, 25))
#: Touches that are compared, of so many, and neighbours of each.
_SAMPLE, _MOST, _NEIGHBOURS = 600, 20_000, 40
#: Share of the likeness of neighbours in one turn that those of other turns must have, and the
#: likeness beyond chance that neighbours must have for a comparison.
_AS_ALIKE, _ALIKE = 0.7, 0.1
#: Touches half a turn away must lack this share of that likeness: a joint that does not matter, and
#: a slide on a coarse skin, feel the same there as well.
_HALF_A_TURN = 0.5
#: With fewer comparisons than this, nothing is known.
_FEWEST = 50


def turning(q: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """The turn of each joint after which touches come back, in its unit; 0 if they do not.

    Only joints that move by more than a turn of 2 pi, 360 or, for whole numbers, a power of two
    are asked about.

    Args:
        q: `(n, J)` motor configurations of touches.
        sensation: `(n, S)` what is felt there.

    Returns:
        `(J,)`.
    """
    q = np.asarray(q, dtype=float)
    found = np.zeros(q.shape[1])
    if len(q) < 2 * _FEWEST:
        return found
    reach = np.ptp(q, axis=0)
    for joint in np.flatnonzero(reach > _TURNS[0]).tolist():
        values = q[:, joint]
        ticks = _TICKS if (values == np.round(values)).all() else ()
        for turn in (*_TURNS, *ticks):
            # Within a turn and a little, too few touches are a turn apart to be compared.
            if reach[joint] > turn and _comes_back(q, sensation, joint, turn):
                found[joint] = turn
                break
    return found


def within_a_turn(q: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """`(n, J)` motor configurations, from minus half a turn to half a turn where joints turn.

    Args:
        q: `(n, J)`.
        turn: `(J,)` as in `turning`.
    """
    if not (turn > 0).any():
        return q
    q = np.array(q, dtype=float)
    turns = turn > 0
    q[:, turns] -= turn[turns] * np.floor(q[:, turns] / turn[turns] + 0.5)
    return q


def wrapping(q: np.ndarray, follows: np.ndarray) -> np.ndarray:
    """The turn after which each joint's reading begins again, in its unit; 0 if it does not.

    It jumps by nearly its whole range, a usual turn, and never by about half of it.

    Args:
        q: `(n, J)` in the order of time.
        follows: `(n - 1,)` bool, whether the next row follows in time.

    Returns:
        `(J,)`.
    """
    found = np.zeros(q.shape[1])
    if len(q) < 2:
        return found
    steps = np.abs(np.diff(q.astype(float), axis=0))[follows]
    for joint, reach in enumerate(np.ptp(q.astype(float), axis=0)):
        far = steps[:, joint] > 0.8 * reach
        middle = (steps[:, joint] > 0.25 * reach) & ~far
        if not reach or not far.any() or middle.sum() > 0.1 * far.sum():
            continue
        values = q[:, joint]
        ticks = _TICKS if (values == np.round(values)).all() else ()
        for turn in (*_TURNS, *ticks):
            if 0.97 * turn < reach <= 1.001 * turn:
                found[joint] = turn
                break
    return found


def _comes_back(q: np.ndarray, sensation: np.ndarray, joint: int, turn: float) -> bool:
    """Whether touches one turn apart are as alike as touches equally near in the same turn.

    And more alike than those half a turn apart.
    """
    rng = np.random.default_rng(0)
    kept = np.sort(rng.permutation(len(q))[:_MOST])
    q, felt = q[kept], sensation[kept].astype(float)
    felt /= np.maximum(np.linalg.norm(felt, axis=1, keepdims=True), 1e-12)
    angle = 2 * np.pi * q[:, joint] / turn
    number = np.floor(q[:, joint] / turn + 0.5)
    others = np.delete(q, joint, axis=1)
    spread = others.std(axis=0)
    others = others[:, spread > 0] / spread[spread > 0]
    places = np.column_stack([others, np.cos(angle), np.sin(angle)])
    asked = rng.permutation(len(q))[:_SAMPLE]
    tree, num = KDTree(places), min(_NEIGHBOURS, len(q))
    apart, near = tree.query(places[asked], k=num)
    opposite = places[asked]
    opposite[:, -2:] *= -1.0
    _, near_opposite = tree.query(opposite, k=1)
    half = (felt[asked] * felt[near_opposite]).sum(axis=1)
    across, within = [], []
    for row, distance, neighbours in zip(asked, apart, near, strict=True):
        # Rows next to each other in time are one touch.
        later = np.abs(neighbours - row) > 20
        in_turn = later & (number[neighbours] == number[row])
        elsewhere = later & ~in_turn
        if not in_turn.any() or not elsewhere.any():
            continue
        one = np.flatnonzero(elsewhere)[0]
        other = np.flatnonzero(in_turn)[np.argmin(np.abs(distance[in_turn] - distance[one]))]
        across.append(felt[row] @ felt[neighbours[one]])
        within.append(felt[row] @ felt[neighbours[other]])
    if len(across) < _FEWEST:
        return False
    chance = float((felt[asked] * felt[rng.permutation(len(q))[: len(asked)]]).sum(axis=1).mean())
    alike = float(np.mean(within)) - chance
    after_a_turn = float(np.mean(across))
    return (
        alike > _ALIKE
        and after_a_turn - chance > _AS_ALIKE * alike
        and after_a_turn - float(np.mean(half)) > _HALF_A_TURN * alike
    )
