"""How the place of a toucher depends on a body model's twists and touchers."""

import numpy as np

from selftouch_drake.agent.body_model.chain import derivatives
from selftouch_drake.agent.body_model.model import BodyModel


def place_slopes(model: BodyModel, q: np.ndarray, part: int, toucher: int) -> np.ndarray:
    """`(n, 3, 6 J + 3 U)` derivatives of a toucher's place by what `covariance` is of.

    Args:
        model: with the part and the toucher on links of its tree.
        q: `(n, J)` readings.
        part: in the frame of whose link the place is.
        toucher: whose centre it is.
    """
    up, down = model.between(int(model.part_link[part]), int(model.toucher_link[toucher]))
    joints, signs = up + down, np.array([-1.0] * len(up) + [1.0] * len(down))
    slope = np.zeros((len(q), 3, model.twists.size + model.toucher_place.size))
    own = np.ascontiguousarray(q[:, joints], dtype=float)
    _, by_twist, by_point, _ = derivatives(
        own, model.twists[joints], model.toucher_place[toucher], signs
    )
    for index, joint in enumerate(joints):
        slope[:, :, 6 * joint : 6 * joint + 6] = by_twist[:, :, index]
    first = model.twists.size + 3 * toucher
    slope[:, :, first : first + 3] = by_point
    return slope
