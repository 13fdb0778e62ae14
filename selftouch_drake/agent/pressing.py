"""What is felt beside a motion: on the way to the skin, and from it (naive).

Before a motion is executed, the agent feels its way along it. At places along it, it tries along
which movement of all joints the touch changes most: that is the way through the skin. Then it feels
how strong the touch is along that way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.sliding import Slider

#: rad of path, between places at which it feels. Some 0.3 s of computing for a path of 5 rad.
_SAMPLED = 0.03

#: rad, to either side, where the two flanks of a touch are: 1.5 cm at an arm's length.
_FLANK = 0.025

# Rounds until the first way is found; each later one starts with the one before.
_FIRST_ROUNDS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pressing:
    """What is felt beside a motion.

    K places along it, J joints, G places across.

    Attributes:
        time_s: `(K,)` s, when the motion is there.
        across: `(K, J)` unit length, the scaled direction through the skin; it turns without jumps.
        strength: `(K, G)` N, L2 norm of what is felt across the motion; null in the air.
    """

    time_s: np.ndarray
    across: np.ndarray
    strength: np.ndarray


def felt_across(
    motion: Motion, offsets: np.ndarray, representation: QuotientRepresentation, slider: Slider
) -> Pressing:
    """Feels what a motion would feel if it were off its way, to the skin or from it.

    Args:
        motion: the motion.
        offsets: `(G,)` rad, how far off, to either side.
        representation: the one that it was planned with.
        slider: feels in the agent's world.
    """
    x = representation.scaled(motion.q)
    _, rows = np.unique((motion.s / _SAMPLED).astype(int), return_index=True)
    across = np.zeros((len(rows), x.shape[1]))
    strength = np.zeros((len(rows), len(offsets)))
    way = np.zeros(x.shape[1])
    for place, row in enumerate(rows):
        known = way.any()
        way = way if known else _unit(slider.slope(x[row]))
        for _ in range(1 if known else _FIRST_ROUNDS):
            # On either flank of a touch the slope leads across, to the skin's middle: this is an
            # iteration of the power method, for the line that slopes are nearest to.
            slopes = [slider.slope(x[row] + flank * way) for flank in (-_FLANK, _FLANK)]
            turned = _unit(np.sum([slope * (slope @ way) for slope in slopes], axis=0))
            way = turned if turned.any() else way
        across[place] = way
        if motion.touching[row]:
            felt = slider.feel(slider.within(x[row] + offsets[:, None] * way))
            strength[place] = np.linalg.norm(felt, axis=1)
    return Pressing(time_s=motion.time_s[rows], across=across, strength=strength)


def _unit(slope: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(slope)
    return slope / length if length > 0 else slope
