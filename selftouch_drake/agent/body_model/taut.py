"""A motion over the skin pulled taut: its path on the skin becomes short, wherever that leads it.

A way through lived touches wanders. Here knots may move along the skin, not only in the joints, as
those of a rubber band that lies on it: squared distances of neighbouring places are made small by
Levenberg-Marquardt, beside squared speed and acceleration of the joints.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from selftouch_drake.agent.body_model.lift import Lifter, roughness, roughness_bands, with_blocks

# Weights of squared distances of neighbouring places, in distances of kernels, and of squared
# accelerations, beside squared speeds in mu. Ways round are then 1.1 to 1.6 times the shortest
# where those through lived touches are 1.3 to 2.7; 10 in place of 3 is no shorter.
_TAUT, _ACCELERATION = 3.0, 2.0
# Tolerances of the toucher's place across the skin, and of the end, in distances of kernels.
_ACROSS, _END = 0.05, 0.1
# Most steps, each at most so long, mu; one that gains less than this share is the last.
_STEPS, _MOST, _GAIN = 60, 0.5, 0.003
# Damping at first, what it is divided by when a step pays and multiplied by when none does, and
# how often.
_DAMPED, _EASED, _STIFFENED, _TRIED = 1.0, 4.0, 5.0, 6
# Steps of damped least squares that put knots back onto the skin.
_PUT = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _State:
    """A motion of T knots and L joints, and what it costs.

    Attributes:
        x: `(T, J)` scaled postures.
        cost: that is made small.
        pull: `(T, L)` half of its derivatives.
        square: `(T, L, L)` half of the second ones at each knot, without roughness.
        across: `(T - 1, L, L)` those between each knot, rows, and the one before it, columns.
    """

    x: np.ndarray
    cost: float
    pull: np.ndarray
    square: np.ndarray
    across: np.ndarray


def pulled_taut(skin: Lifter, x: np.ndarray, end: np.ndarray) -> np.ndarray:
    """`(T, J)` a motion like `(T, J)` x over the skin, with a shorter path on it.

    The first posture stays.

    Args:
        skin: the toucher and the skin.
        x: a motion on the skin.
        end: `(3,)` the place on the skin at which it ends.
    """
    joints = skin.reach.joints
    lower, upper = skin.lower[joints], skin.upper[joints]
    rough = roughness(len(x), acceleration=_ACCELERATION)
    state, damping = _state(skin, x, end, rough), _DAMPED
    bands = roughness_bands(rough, len(joints))
    for _ in range(_STEPS):
        for _ in range(_TRIED):
            step = _step(state, bands, damping)
            moved = state.x.copy()
            moved[1:, joints] = np.clip(moved[1:, joints] + step, lower, upper)
            trial = _state(skin, _on_skin(skin, moved), end, rough)
            if trial.cost < state.cost:
                break
            damping *= _STIFFENED
        else:
            break
        gained, state, damping = state.cost - trial.cost, trial, damping / _EASED
        if gained < _GAIN * state.cost:
            break
    return state.x


def _on_skin(skin: Lifter, x: np.ndarray) -> np.ndarray:
    """`(T, J)` postures put onto the skin below them, all but the first."""
    on_it, normal = skin.surface.projected(skin.centres(x))
    put = skin.put(x, on_it, normal, steps=_PUT)
    put[0] = x[0]
    return put


def _state(skin: Lifter, x: np.ndarray, end: np.ndarray, rough: np.ndarray) -> _State:
    """What a motion costs, and how that changes with it."""
    joints, spacing = skin.reach.joints, skin.surface.spacing
    on_it, normal = skin.surface.projected(skin.centres(x))
    at, by_x = skin.places(x, normal)
    by_x = by_x / spacing
    # Off the skin.
    off = np.einsum("ta,ta->t", at - on_it, normal) / (_ACROSS * spacing)
    by_off = np.einsum("ta,tal->tl", normal, by_x) / _ACROSS
    square = np.einsum("tl,tm->tlm", by_off, by_off)
    pull = rough @ x[:, joints] + by_off * off[:, None]
    cost = float(np.sum(x[:, joints] * (rough @ x[:, joints])) + off @ off)
    # Beside the end.
    missed = (at[-1] - end) / (_END * spacing)
    square[-1] += by_x[-1].T @ by_x[-1] / _END**2
    pull[-1] += by_x[-1].T @ missed / _END
    cost += float(missed @ missed)
    # Far from the neighbours.
    apart = np.diff(at, axis=0) / spacing
    own = np.einsum("tal,tam->tlm", by_x, by_x)
    square[1:] += _TAUT * own[1:]
    square[:-1] += _TAUT * own[:-1]
    pull[1:] += _TAUT * np.einsum("tal,ta->tl", by_x[1:], apart)
    pull[:-1] -= _TAUT * np.einsum("tal,ta->tl", by_x[:-1], apart)
    across = -_TAUT * np.einsum("tal,tam->tlm", by_x[1:], by_x[:-1])
    cost += _TAUT * float(np.sum(apart**2))
    return _State(x=x, cost=cost, pull=pull, square=square, across=across)


def _step(state: _State, bands: np.ndarray, damping: float) -> np.ndarray:
    """`(T - 1, L)` a damped step of all knots but the first, which is given."""
    num, length = state.pull.shape
    system = with_blocks(bands, state.square)
    for row in range(length):
        for column in range(length):
            band = system[length + row - column].reshape(num, length)
            band[:-1, column] += state.across[:, row, column]
    system[0] += damping
    step = -solveh_banded(system[:, length:], state.pull[1:].ravel(), lower=True)
    step = step.reshape(num - 1, length)
    return step * min(1.0, _MOST / max(np.abs(step).max(), 1e-12))
