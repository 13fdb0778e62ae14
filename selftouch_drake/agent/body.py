"""The one door between agent and world: whatever has joints and a skin is a `Body` (naive).

A body has limits and two methods. It alone knows poses, if anyone does; units and types of its
joints, the number of its skins and how it is simulated or built are its own affair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np


class BodyError(Exception):
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """What a body measured while it followed a motion.

    T samples, J joints, S receptors.

    Attributes:
        time_s: `(T,)` s, from the start of the motion.
        q: `(T, J)` where it was, in its own units.
        sensation: `(T, S)` raw readings.
    """

    time_s: np.ndarray
    q: np.ndarray
    sensation: np.ndarray


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

    joint_names: Sequence[str]
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    num_receptors: int
    jumps: bool

    def feel(self, q: np.ndarray) -> Felt:
        """Visits `(n, J)` configurations in order, slowly, and feels at each.

        What cannot be undone, such as pressing hard, is the body's to refuse: there it has not
        reached.
        """
        ...

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """Carries out a timed motion: `(T,)` s from 0, and `(T, J)` where to be then.

        A body that jumps begins at rest at the first configuration, another where it is.
        """
        ...
