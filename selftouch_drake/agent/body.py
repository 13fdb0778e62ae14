"""The one door between agent and world: whatever has joints and a skin is a `Body` (naive).

A body has limits and two methods. It alone knows poses, if anyone does; units and types of its
joints, the number of its skins and how it is simulated or built are its own affair.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np


class BodyError(ValueError):
    """A body cannot do what a body must; the text says what, where, and what helps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Felt:
    """What a body felt where it was asked to go.

    n configurations, J joints, S receptors.

    Attributes:
        q: `(n, J)` where it really was, in its own units.
        sensation: `(n, S)` raw readings there.
        reached: `(n,)` bool; False where it could not or would not go.
    """

    q: np.ndarray
    sensation: np.ndarray
    reached: np.ndarray

    def touches(self) -> "tuple[np.ndarray, Felt]":
        """The rows in which something is felt, and what was felt there."""
        rows = np.flatnonzero(self.sensation.any(axis=1))
        return rows, self.of_rows(rows)

    def of_rows(self, rows: np.ndarray) -> "Felt":
        """What was felt at some of the configurations."""
        return Felt(q=self.q[rows], sensation=self.sensation[rows], reached=self.reached[rows])


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """What a body measured while it followed a motion.

    T samples, J joints, S receptors, and N samples of the efforts, as many as there are.

    Attributes:
        time_s: `(T,)` s, from the start of the motion.
        q: `(T, J)` where it was, in its own units.
        sensation: `(T, S)` raw readings.
        v: `(T, J)` velocities, if the body measures them.
        torque: `(N, J)` efforts of the joints, if the body measures them.
    """

    time_s: np.ndarray
    q: np.ndarray
    sensation: np.ndarray
    v: np.ndarray | None = None
    torque: np.ndarray | None = None

    def felt(self) -> "Felt":
        """What was felt at each sample."""
        reached = np.ones(len(self.q), dtype=bool)
        return Felt(q=self.q, sensation=self.sensation, reached=reached)


@runtime_checkable
class Body(Protocol):
    """Joints and a skin.

    Attributes:
        joint_names: of the J joints.
        lower: `(J,)` lower limits of the joints, in the body's own units.
        upper: `(J,)` upper limits.
        velocity: `(J,)` limits for the timing of motions, units per second.
        acceleration: `(J,)` limits for the timing of motions, units per second squared.
        num_receptors: S.
        jumps: whether any posture may be asked for next; if not, it must be travelled to.
    """

    @property
    def joint_names(self) -> Sequence[str]:
        """As above."""
        ...

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    num_receptors: int
    jumps: bool

    def feel(self, q: np.ndarray) -> "Felt":
        """Visits `(n, J)` configurations in order, slowly, and feels at each.

        What cannot be undone, such as pressing hard, is the body's to refuse: there it has not
        reached.
        """
        ...

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """Carries out a timed motion: `(T,)` s from 0, and `(T, J)` where to be then.

        It begins where the last motion ended. If that is not the first configuration, a body that
        jumps is put there, at rest; another goes there first.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchProfile:
    """The sensations beside a motion.

    K places along it, J joints, G places across.

    Attributes:
        time_s: `(K,)` s, time of the motion at each place.
        across: `(K, J)` unit length, scaled direction through the skin; it changes continuously.
        joint_scale: `(J,)` factors of scaled configurations.
        strength: `(K, G)` N, L2 norm of the sensations across the motion; 0 in the air.
    """

    time_s: np.ndarray
    across: np.ndarray
    joint_scale: np.ndarray
    strength: np.ndarray


@runtime_checkable
class ServoedBody(Body, Protocol):
    """A body that corrects a motion by touch while it follows it.

    Attributes:
        offsets: `(G,)` mu, displacements across the skin that it distinguishes.
    """

    offsets: np.ndarray

    def follow_beside(self, time_s: np.ndarray, q: np.ndarray, beside: TouchProfile) -> Followed:
        """As `follow`, and stays in the skin by what is felt `beside` the motion."""
        ...
