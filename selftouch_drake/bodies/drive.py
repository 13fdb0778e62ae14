"""Finds out what actions do to joints by moving a little, and moves joints by actions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from selftouch_drake.agent.body import BodyError

Kind = Literal["position", "velocity", "torque"]

#: Seconds for which each action is held, and for which it is watched afterwards.
_HOLD_S = 1.0

#: Shares of an action's range that are tried, until a joint moves by `_LITTLE` of its own range.
_STRENGTHS = 0.001 * 4.0 ** np.arange(6)
_LITTLE = 0.01

#: An effect is one if it is this many times what differs when nothing is done, and at least this
#: share of a joint's range.
_ABOVE_CHANCE, _LEAST_EFFECT = 10.0, 1e-4

#: Joints whose actions differ by less than this share move together only.
_TOGETHER = 1e-4

#: A torque moves other joints too, because they carry each other. Up to this share that changes
#: with the posture, and is left to feedback: an arm misses fewer postures.
_CARRIED = 0.6

#: A joint that differs by less than this share after a while has settled, or stays.
_SAME = 0.35

#: s, the lag of a joint whose action sets its velocity.
_PROMPT_S = 0.06

#: Natural frequency of the feedback, in rad per step, and the most of it, in rad/s.
_FIRMNESS, _FASTEST = 0.3, 20.0
#: Its damping, over the critical one: more than 1, because joints carry more in other postures.
_DAMPING = 1.2
#: Rates at which errors are integrated, by what an action sets: 1/s for positions, else shares of
#: that frequency.
_PATIENCE = {"position": 2.0, "velocity": 0.5, "torque": 0.3}

#: A trial: the actions `(n, A)` of an episode that begins as always; `(n, J)` where it then was.
Trial = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actions:
    """What A actions do to J joints.

    Attributes:
        kind: what an action sets.
        effect: `(J, A)` change of position, velocity or acceleration per unit of action.
        needed: `(A, J)` smallest action per unit of change.
        neutral: `(A,)` action that pushes nothing.
        low: `(A,)` least action.
        high: `(A,)` greatest action.
        q: `(J,)` where joints are under the neutral action, if an action sets positions.
        lag_s: `(J,)` s by which joints come later than their actions.
        step_s: s per step.
    """

    kind: Kind
    effect: np.ndarray
    needed: np.ndarray
    neutral: np.ndarray
    low: np.ndarray
    high: np.ndarray
    q: np.ndarray
    lag_s: np.ndarray
    step_s: float

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` least and greatest positions that actions reach, if they set positions."""
        ends = [self.effect * (end - self.neutral) for end in (self.low, self.high)]
        return self.q + np.minimum(*ends).sum(axis=1), self.q + np.maximum(*ends).sum(axis=1)


def find_actions(
    trial: Trial,
    low: np.ndarray,
    high: np.ndarray,
    span: np.ndarray,
    joint_names: Sequence[str],
    step_s: float,
    kind: Kind | None = None,
) -> Actions:
    """Tries each action by itself, weakly, and sees which joints follow and how.

    Of `(A,)` least and greatest actions, -1 and 1 are tried if they are infinite; `(J,)` spans are
    the ranges of the joints, about; the kind is found out by default.

    Raises:
        BodyError: no action moves a joint, or some joints move together only.
    """
    low, high = np.where(np.isfinite(low), low, -1.0), np.where(np.isfinite(high), high, 1.0)
    neutral = np.zeros(len(low)).clip(low, high)
    held = max(4, round(_HOLD_S / step_s))
    still, responses = _responses(trial, neutral, low, high, span, held)
    strength = np.abs(responses).max(axis=1)
    _require_motion(strength, joint_names)
    # How each joint answers the action that moves it most.
    own = responses[strength.argmax(axis=0), :, np.arange(len(span))].T
    kind = kind or _kind(own, held, step_s)
    lag_s = np.zeros(len(span))
    if kind == "position":
        lag_s = _position_lags(own, held, step_s)
    effect = _effects(kind, responses, held, step_s)
    unit = _unit_effects(effect)
    if kind == "torque":
        effect = np.where(np.abs(effect) < _CARRIED * unit, 0.0, effect)
    if (num := np.linalg.matrix_rank(effect / unit, tol=_TOGETHER)) < len(span):
        raise BodyError(
            f"{len(low)} actions move {', '.join(joint_names)} in {num} ways only; leave out of "
            "`joints` those that move with others"
        )
    return Actions(
        kind=kind,
        effect=effect,
        needed=np.linalg.pinv(effect / unit) / unit.T,
        neutral=neutral,
        low=low,
        high=high,
        q=still[-1],
        lag_s=lag_s,
        step_s=step_s,
    )


def _responses(
    trial: Trial,
    neutral: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    span: np.ndarray,
    held: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Where joints stay if nothing pushes them, and how they answer each action by itself.

    Each action is held for so many steps, and watched for as many afterwards. Returns `(2 held, J)`
    positions under the neutral actions `(A,)`, and `(A, 2 held, J)` changes of position per unit of
    action; 0 of a joint that does not move by more than chance.
    """
    quiet = np.tile(neutral, (2 * held, 1))
    still = trial(quiet)
    chance = _ABOVE_CHANCE * np.abs(trial(quiet) - still).max(axis=0)
    least = np.maximum(chance, _LEAST_EFFECT * span)
    responses = np.zeros((len(low), 2 * held, len(span)))
    for action, ends in enumerate(zip(high - neutral, low - neutral, strict=True)):
        # One way first. Where nothing moves, as a joint that rests at its limit, the other way.
        for push in np.outer(sorted(ends, key=abs, reverse=True), _STRENGTHS).flat:
            pushed = quiet.copy()
            pushed[:held, action] += push
            moved = trial(pushed) - still
            most = np.abs(moved).max(axis=0)
            responses[action] = np.where(most > least, moved, 0.0) / (push or 1.0)
            if (most > np.maximum(_LITTLE * span, least)).any():
                break
    return still, responses


def _require_motion(strength: np.ndarray, joint_names: Sequence[str]) -> None:
    """Raises a `BodyError` unless each joint is moved by an action: `(A, J)` strengths."""
    if not strength.any():
        raise BodyError(
            f"no action moves a joint: {len(strength)} were tried; name others as `joints`, or say "
            "what an action sets"
        )
    for name, strengths in zip(joint_names, strength.T, strict=True):
        if not strengths.any():
            raise BodyError(f"no action moves {name}; leave it out of `joints`")


def _position_lags(own: np.ndarray, held: int, step_s: float) -> np.ndarray:
    """`(J,)` s by which joints come later than actions that set positions; `own` as in `_kind`."""
    share = own[:held] / own[_settled(held)].mean(axis=0)
    return step_s * (1 - share).sum(axis=0).clip(0.0, held / 2)


def _effects(kind: Kind, responses: np.ndarray, held: int, step_s: float) -> np.ndarray:
    """`(J, A)` as in `Actions`, from `(A, 2 held, J)` responses as in `_responses`."""
    if kind == "position":
        return responses[:, _settled(held)].mean(axis=1).T
    if kind == "velocity":
        half = held // 2
        return (responses[:, held - 1] - responses[:, half - 1]).T / ((held - half) * step_s)
    # Before friction and gravity make a difference.
    square = np.square(step_s * np.arange(1, 4)) / 2
    return (square @ responses[:, :3]).T / (square @ square)


def _settled(held: int) -> slice:
    """The steps at which joints have settled under an action that is held: its last quarter."""
    return slice(3 * held // 4, held)


def _unit_effects(effect: np.ndarray) -> np.ndarray:
    """`(J, A)` positive: the unit of each joint times that of each action, from their effects."""
    unit = np.ones(effect.shape)
    for axis in (1, 0):
        most = np.abs(effect / unit).max(axis=axis, keepdims=True)
        unit *= np.where(most > 0, most, 1.0)
    return unit


def _kind(own: np.ndarray, held: int, step_s: float) -> Kind:
    """What most of the actions set; `own` `(2 n, J)` is how each joint answers one."""
    half, end, after = own[held // 2 - 1], own[held - 1], own[-1]
    settled = (np.abs(end - half) < _SAME * np.abs(end)) & (np.abs(after) < _SAME * np.abs(end))
    if np.mean(settled) > 0.5:
        return "position"
    stays = np.abs(after - end) < _SAME * np.abs(end)
    with np.errstate(divide="ignore", invalid="ignore"):
        lag_s = step_s * (held - (held - held // 2) * end / (end - half))
    # Friction that stops a joint less promptly is no servo.
    return "velocity" if np.mean(stays & (lag_s < max(_PROMPT_S, 2 * step_s))) > 0.5 else "torque"


class Drive:
    """Chooses actions so that joints are where they are to be.

    Attributes:
        correction: `(J,)` integral of what remains, as of weight and friction.
    """

    def __init__(self, actions: Actions):
        self._actions = actions
        self._firm = min(_FIRMNESS / actions.step_s, _FASTEST)
        self.forget()

    def forget(self) -> None:
        """Begins anew, as after a reset."""
        self.correction = np.zeros(len(self._actions.q))
        self._q: np.ndarray | None = None

    def action(self, q: np.ndarray, target: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """`(A,)` for the next step, from where joints `(J,)` are to a target with its speed."""
        known, firm = self._actions, self._firm
        error = target - q
        moving = np.zeros_like(q) if self._q is None else (q - self._q) / known.step_s
        self._q = q
        if known.kind == "position":
            wanted = target - known.q + known.lag_s * speed + self.correction
            gain = 1.0
        elif known.kind == "velocity":
            wanted, gain = speed + firm * error + self.correction, firm**2
        else:
            push = firm**2 * error + 2 * _DAMPING * firm * (speed - moving)
            wanted, gain = push + self.correction, firm**3
        action = known.neutral + known.needed @ wanted
        possible = action.clip(known.low, known.high)
        more = gain * _PATIENCE[known.kind] * known.step_s * error
        # Not further beyond what is possible.
        excess = known.effect @ (action - possible)
        self.correction = self.correction + np.where(more * excess > 0, 0.0, more)
        return possible
