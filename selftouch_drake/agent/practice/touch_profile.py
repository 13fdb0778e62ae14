"""The sensations beside a motion: deeper in the skin, and less deep (naive).

Before a motion is executed, the agent explores it. At places along it, the agent searches for the
direction in motor space in which the touch changes most: this direction leads through the skin.
Then it measures how strong the touch is along that direction.
"""

import numpy as np

from selftouch_drake.agent.body import TouchProfile
from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.practice.sliding import Slider

#: mu of path, between these places. Takes about 0.3 s of computing for a path of 5 mu.
_SAMPLED = 0.03

#: mu, offset of the two flanks of a touch on either side: 1.5 cm at an arm's length.
_FLANK = 0.025

# Iterations to find the first direction; each later one starts from the previous direction.
_FIRST_ROUNDS = 5


def felt_across(motion: Motion, offsets: np.ndarray, slider: Slider) -> TouchProfile:
    """Measures the sensations of a motion that is displaced by `(G,)` mu, to either side.

    The slider feels in the agent's world.
    """
    x = motion.q * slider.joint_scale
    _, rows = np.unique((motion.s / _SAMPLED).astype(int), return_index=True)
    across = np.zeros((len(rows), x.shape[1]))
    strength = np.zeros((len(rows), len(offsets)))
    way = np.zeros(x.shape[1])
    for place, row in enumerate(rows):
        known = way.any()
        way = way if known else _unit(slider.slope(x[row]))
        for _ in range(1 if known else _FIRST_ROUNDS):
            # On both flanks of a touch the slope points across, to the middle of the skin. This is
            # an iteration of the power method for the line nearest to the slopes.
            slopes = [slider.slope(x[row] + flank * way) for flank in (-_FLANK, _FLANK)]
            turned = _unit(np.sum([slope * (slope @ way) for slope in slopes], axis=0))
            way = turned if turned.any() else way
        across[place] = way
        if motion.touching[row]:
            felt = slider.feel(slider.within(x[row] + offsets[:, None] * way)).sensation
            strength[place] = np.linalg.norm(felt, axis=1)
    return TouchProfile(
        time_s=motion.time_s[rows],
        across=across,
        joint_scale=slider.joint_scale,
        strength=strength,
    )


def _unit(slope: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(slope)
    return slope / length if length > 0 else slope
