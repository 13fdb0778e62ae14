"""A chain in a plane: axes across one plane, in which the toucher and all its places lie.

The criterion of a chain asks in how much of each dimension kernels are small. Across the plane of a
chain there is nothing to see, and least squares would bend the chain a little until there is. So a
chain whose axes are nearly parallel is tried with axes that are.
"""

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene, Solution
from selftouch_drake.agent.body_model.who_touched import started

# Share of all turning that is about one axis above which a plane is tried.
_PARALLEL = 0.8


def in_a_plane(scene: Scene, solution: Solution) -> tuple[Solution, np.ndarray] | None:
    """The solution with all axes across one plane, refined; None where axes are far from parallel.

    Args:
        scene: touches of one part by one toucher.
        solution: of them.

    Returns:
        The solution, whose plane is that of x and y, and `(n,)` bool, parameters that it holds.
    """
    w = solution.twists[:, :3]
    size, axes = np.linalg.eigh(w.T @ w)
    if size[2] < _PARALLEL * size.sum() or size.sum() == 0:
        return None
    motion = np.eye(4)
    motion[:3, :3] = axes.T if np.linalg.det(axes) > 0 else -axes.T
    twists = adjoint(motion, solution.twists)
    points = solution.points @ motion[:3, :3].T
    across = np.array([True, True, False, False, False, True])
    twists[:, across] = 0.0
    # The plane may be any that is parallel: it goes through the origin.
    points[:, 2] = 0.0
    fixed = np.concatenate(
        [np.tile(across, len(twists)), np.tile([False, False, True], len(points))]
    )
    flat = started(scene, twists, points)
    return refined(scene, flat, fixed=fixed), fixed
