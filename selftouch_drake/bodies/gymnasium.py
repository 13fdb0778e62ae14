"""A Gymnasium environment as a body: it observes joint positions and touch, and takes actions."""

import dataclasses
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, cast

import numpy as np

from selftouch_drake.agent.body import BodyError, Felt, Followed
from selftouch_drake.bodies.class_of_file import load_class, make_instance, split_reference
from selftouch_drake.bodies.drive import Actions, Drive, Kind, find_actions
from selftouch_drake.experiment import closest, shown
from selftouch_drake.experiment.schema import GymnasiumSettings

#: Share of the velocity limits at which a body travels to what it is to feel.
_SLOW = 0.5

#: Peak of the speed of a motion of least jerk, as a multiple of its mean.
_PEAK = 1.875

#: Share of its range within which a joint counts as there: soft contact pushes it off a little.
_NEAR = 0.03

#: Share of its range by which a joint is behind if something is in its way.
_BLOCKED = 0.08

#: s in which a body becomes still, or counts as not there.
_SETTLED_S = 3.0

#: A joint is still if it moves by less than this share of its range in this many seconds.
_STILL, _STILL_S = 0.0005, 0.1

#: Times that a motion is begun again when the episode ends in it.
_TRIES = 3

#: Range of a joint without limits while its actions are tried.
_UNKNOWN_RANGE = 2.0


class _EpisodeEndedError(Exception):
    """The episode has ended; the next one has begun."""


class GymnasiumBody:
    """A `Body` that lives in a Gymnasium environment.

    What actions do is found out by moving a little. The body travels to what it is to feel, unless
    the environment can be put into a posture.

    Args:
        env: whose actions are one array; its `reset` with a seed must begin alike each time.
        set_posture: as in `GymnasiumSettings`, or a function: puts the environment into `(J,)` and
            returns an observation, or None where it cannot be.

    All others are as in `GymnasiumSettings`. Without limits in the observation's space, those of
    the joints, `(J,)`, are what actions can reach; without `dt`, a step is of its `render_fps`.

    Attributes:
        robot_s: s of simulated time so far.

    Raises:
        BodyError: the observation has no such entry, no action moves a joint, or something is not
            known and not given.
    """

    def __init__(
        self,
        env: Any,
        *,
        joints: str | Sequence[int],
        touch: str | Sequence[int],
        joint_names: Sequence[str] | None = None,
        lower: Sequence[float] | None = None,
        upper: Sequence[float] | None = None,
        velocity: Sequence[float] | None = None,
        acceleration: Sequence[float] | None = None,
        action: str | None = None,
        step_s: float | None = None,
        set_posture: Callable[[np.ndarray], Any] | str | None = None,
        reset_option: str | None = None,
    ):
        self._env, self._joints, self._touch = env, joints, touch
        self.robot_s, self._drive = 0.0, None
        # Where the last motion was to end; None if it is elsewhere.
        self._at: np.ndarray | None = None
        self._set_posture = _setter(env, set_posture, reset_option)
        self.jumps = self._set_posture is not None
        self._step_s = step_s or _step_s(env)
        self._reset()
        num_joints, self.num_receptors = len(self._q), len(self._sensation)
        self.joint_names = list(joint_names or (f"joint_{n}" for n in range(num_joints)))
        observed_lower, observed_upper = self._observed_limits()
        bounds = [
            np.asarray(observed_lower if lower is None else lower, dtype=float),
            np.asarray(observed_upper if upper is None else upper, dtype=float),
        ]
        #: What was found out, or None if nothing moves by actions.
        self.actions: Actions | None = None
        if action != "none":
            self.actions = self._found_actions(action, bounds[1] - bounds[0])
            self._drive = Drive(self.actions)
            self._reset()
            if self.actions.kind == "position":
                bounds = [
                    np.where(np.isfinite(bound), bound, end)
                    for bound, end in zip(bounds, self.actions.limits(), strict=True)
                ]
        elif not self.jumps:
            raise BodyError("action is none; then give set_posture or reset_option")
        for name, bound in zip(("lower", "upper"), bounds, strict=True):
            _require_limits(name, bound, num_joints)
        self.lower, self.upper = bounds
        span = self.upper - self.lower
        # By default a quarter of the range per second, reached in a quarter of a second.
        self.velocity = np.asarray(span / 4 if velocity is None else velocity, dtype=float)
        fastest = 4 * self.velocity if acceleration is None else acceleration
        self.acceleration = np.asarray(fastest, dtype=float)
        self._near, self._blocked, self._still = _NEAR * span, _BLOCKED * span, _STILL * span

    def feel(self, q: np.ndarray) -> Felt:
        """As in `Body`."""
        rows = [(self._go(posture), self._q, self._sensation) for posture in q]
        reached, where, felt = map(np.array, zip(*rows, strict=True))
        self._at = q[-1].copy() if reached[-1] else None
        return Felt(q=where, sensation=felt, reached=reached)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`, with one sample per step.

        Raises:
            BodyError: the episode ends in each try.
        """
        if self._drive is None:
            felt = self.feel(q)
            return Followed(time_s=time_s, q=felt.q, sensation=felt.sensation)
        times = np.arange(0.0, time_s[-1] + self._step_s, self._step_s)
        path = np.stack([np.interp(times, time_s, column) for column in q.T], axis=1)
        speeds = np.gradient(path, self._step_s, axis=0) if len(path) > 1 else np.zeros_like(path)
        for _ in range(_TRIES):
            if self._at is None or not np.array_equal(q[0], self._at):
                self._go(q[0])
            with suppress(_EpisodeEndedError):
                rows = [(self._q, self._sensation)]
                for target, speed in zip(path[1:], speeds[1:], strict=True):
                    self._step(self._drive.action(self._q, target, speed))
                    rows.append((self._q, self._sensation))
                self._at = q[-1].copy()
                where, touched = map(np.array, zip(*rows, strict=True))
                return Followed(time_s=times, q=where, sensation=touched)
        raise BodyError(
            f"the episode ended in each of {_TRIES} tries of a motion of {time_s[-1]:.1f} s; make "
            "the environment with longer episodes"
        )

    def close(self) -> None:
        """Closes the environment."""
        self._env.close()

    def _observed_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` lowest and highest joint positions, as the space of the observation has them."""
        space = self._env.observation_space
        entries = getattr(space, "spaces", space)
        return _picked(entries, self._joints, "low"), _picked(entries, self._joints, "high")

    def _found_actions(self, kind: str | None, span: np.ndarray) -> Actions:
        """What actions do, found out by moving a little; `(J,)` is the range of the joints."""
        space = self._env.action_space
        if not hasattr(space, "low") or len(space.shape) != 1:
            raise BodyError(f"the action space is {shown(space)}; only Box(n,) can be used")
        return find_actions(
            self._trial,
            space.low.astype(float),
            space.high.astype(float),
            np.where(np.isfinite(span) & (span > 0), span, _UNKNOWN_RANGE),
            self.joint_names,
            self._step_s,
            cast("Kind | None", kind),
        )

    def _go(self, posture: np.ndarray) -> bool:
        """Goes to a posture `(J,)`; returns whether the body is there and still."""
        if self._set_posture is not None:
            observation = self._set_posture(posture)
            if observation is not None:
                self._take(observation)
                if self._drive is not None:
                    self._drive.forget()
            return observation is not None
        for _ in range(_TRIES):
            with suppress(_EpisodeEndedError):
                return self._travel(posture)
        return False

    def _travel(self, goal: np.ndarray) -> bool:
        """Travels to a posture `(J,)`; returns whether the body is there and still."""
        assert self._drive is not None
        correction = self._drive.correction
        blocked = not self._approach(goal)
        if blocked:
            # What is in the way is not pressed harder.
            goal, self._drive.correction = self._q, correction
        if self._settle(goal, anywhere=blocked):
            return not blocked
        self._drive.correction = correction
        return False

    def _approach(self, goal: np.ndarray) -> bool:
        """Moves to a posture with least jerk; returns whether nothing was in the way."""
        assert self._drive is not None
        start = self._q
        way = goal - start
        duration = (_PEAK * np.abs(way) / (_SLOW * self.velocity)).max()
        num_steps = int(np.ceil(duration / self._step_s))
        for step in range(1, num_steps + 1):
            s = step / num_steps
            share, rate = s**3 * (10 - 15 * s + 6 * s * s), 30 * (s * (1 - s)) ** 2
            target = start + share * way
            speed = rate / (duration or 1.0) * way
            self._step(self._drive.action(self._q, target, speed))
            if (np.abs(target - self._q) > self._blocked).any():
                return False
        return True

    def _settle(self, goal: np.ndarray, *, anywhere: bool) -> bool:
        """Holds a posture; returns whether the body became still, there or `anywhere`."""
        assert self._drive is not None
        before, nothing = self._q, np.zeros_like(goal)
        watched = max(1, round(_STILL_S / self._step_s))
        for step in range(1, round(_SETTLED_S / self._step_s) + 1):
            self._step(self._drive.action(self._q, goal, nothing))
            if step % watched == 0:
                still = (np.abs(self._q - before) < self._still).all()
                if still and (anywhere or (np.abs(self._q - goal) < self._near).all()):
                    return True
                before = self._q
        return False

    def _trial(self, actions: np.ndarray) -> np.ndarray:
        """`(n, J)` where it was after each of `(n, A)` actions of a new episode."""
        self._reset()
        where: list[np.ndarray] = []
        for action in actions:
            try:
                self._step(action)
            except _EpisodeEndedError:
                if not where or (actions == actions[0]).all():
                    raise BodyError(
                        f"the episode ends after {len(where) * self._step_s:.2g} s without "
                        "actions; make the environment with longer episodes, which do not end "
                        "where it falls"
                    ) from None
                break
            where.append(self._q)
        return np.array(where + where[-1:] * (len(actions) - len(where)))

    def _reset(self) -> None:
        observation, _ = self._env.reset(seed=0)
        self._take(observation)
        self._at = None
        if self._drive is not None:
            self._drive.forget()

    def _step(self, action: np.ndarray) -> None:
        space = self._env.action_space
        observation, _, terminated, truncated, _ = self._env.step(action.astype(space.dtype))
        self.robot_s += self._step_s
        self._take(observation)
        if terminated or truncated:
            self._reset()
            raise _EpisodeEndedError

    def _take(self, observation: Any) -> None:
        self._q = np.array(_picked(observation, self._joints), dtype=float)
        self._sensation = np.array(_picked(observation, self._touch), dtype=float)


def body_from_settings(settings: GymnasiumSettings) -> GymnasiumBody:
    """The body of an experiment's `gymnasium`.

    Raises:
        BodyError: the environment cannot be made, or as in `GymnasiumBody`.
    """
    try:
        import gymnasium
    except ImportError:
        raise BodyError(
            "gymnasium is not installed; `pip install 'selftouch-drake[gym]'` adds it"
        ) from None
    reference = split_reference(settings.env)
    if reference is not None:
        env = make_instance(load_class(*reference), settings.arguments)
    else:
        try:
            # Without a limit of steps: an agent's life is no episode.
            env = gymnasium.make(settings.env, max_episode_steps=-1, **settings.arguments)
        except (gymnasium.error.Error, ImportError, TypeError) as error:
            reason = " ".join(str(error).split())
            raise BodyError(
                f"gymnasium.env is {shown(settings.env)}: {reason}; correct its name or arguments"
            ) from error
    names = (entry.name for entry in dataclasses.fields(settings))
    others = (name for name in names if name not in ("env", "arguments"))
    return GymnasiumBody(env, **{name: getattr(settings, name) for name in others})


def _require_limits(name: str, bound: np.ndarray, num_joints: int) -> None:
    """Raises a `BodyError` if joints have no finite limits."""
    if bound.shape != (num_joints,) or not np.isfinite(bound).all():
        raise BodyError(
            f"{name} is {shown(bound.tolist())}: the space of the observation does not "
            f"limit the joints; give `{name}`, {num_joints} numbers"
        )


def _picked(observation: Any, where: str | Sequence[int], attribute: str | None = None) -> Any:
    """`(n,)` numbers of an observation, or of an attribute of its space."""
    entries: Any = observation
    numbers: Any = where
    if isinstance(where, str):
        # A key, a slice, or both, as in `qpos[7:19]`.
        key, part = cast("re.Match", re.fullmatch(r"(.*?)(?:\[?(-?\d*:-?\d*)\]?)?", where)).groups()
        if key:
            entries = _entry(observation, key)
        numbers = slice(*(int(n) if n else None for n in part.split(":"))) if part else slice(None)
    elif hasattr(observation, "keys"):
        raise BodyError(
            f"{shown(list(where))} numbers an observation that has entries "
            f"{', '.join(observation.keys())}; give the key of one, as in 'qpos[7:19]'"
        )
    values = np.asarray(getattr(entries, attribute) if attribute else entries).reshape(-1)
    try:
        return values[numbers]
    except IndexError:
        raise BodyError(
            f"{shown(where)} numbers more than the {len(values)} entries of the observation"
        ) from None


def _entry(observation: Any, key: str) -> Any:
    """The entry of an observation with this key."""
    known = list(observation.keys()) if hasattr(observation, "keys") else []
    if key not in known:
        hint = closest(key, known) or f"it has {', '.join(known) or 'no named entries'}"
        raise BodyError(f"the observation has no {shown(key)}; {hint}")
    return observation[key]


def _setter(
    env: Any, set_posture: Callable[[np.ndarray], Any] | str | None, option: str | None
) -> Callable[[np.ndarray], Any] | None:
    """Puts the environment into a posture and returns an observation; None if nothing does."""
    if option is not None:
        return lambda q: env.reset(options={option: q})[0]
    if isinstance(set_posture, str):
        found = getattr(env.unwrapped, set_posture, None)
        if not callable(found):
            raise BodyError(f"set_posture is {shown(set_posture)}; the environment has no such one")
        return found
    return set_posture


def _step_s(env: Any) -> float:
    """The seconds of a step, as the environment says."""
    found = getattr(env.unwrapped, "dt", None)
    fps = env.metadata.get("render_fps")
    if found is None and not fps:
        raise BodyError("the environment has no dt; give step_s, the seconds of a step")
    return float(found or 1 / fps)
