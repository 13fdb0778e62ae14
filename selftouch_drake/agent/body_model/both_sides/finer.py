"""A body that was found, with finer skins.

A search moves few patterns of each skin: more of them only make it slower. Where the touches were,
it then knows no better than these patterns can say. A finish by least squares takes more.
"""

from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.body_model.both_sides.finish import finished
from selftouch_drake.agent.body_model.both_sides.judgement import Found
from selftouch_drake.agent.body_model.both_sides.problem import Body, Problem
from selftouch_drake.agent.body_model.both_sides.recordings import Recording
from selftouch_drake.agent.body_model.both_sides.search import SIGMA

#: Patterns of each skin, chosen on fold 0 of the touches of one Nao, and steps of the finish.
FINE, _STEPS = 40, 40
# Damping of coefficients that take places over from other patterns.
_DAMPING = 1e-2


def finer(found: Found, recordings: Sequence[Recording], size: int = FINE) -> Found:
    """The body with so many patterns of each skin, after a finish by least squares.

    Args:
        found: what a search found in these recordings.
        recordings: of the body.
        size: patterns of each skin.
    """
    body = Body.of(recordings, found.body.layout, size)
    problem = Problem.of(body, recordings)
    columns = np.arange(body.num_joints)[None]
    begun = problem.evaluated(moved_over(found, body)[None], columns, SIGMA)
    row = finished(problem, begun, sigma=SIGMA, steps=_STEPS).rows[0]
    return Found(body=body, row=row, order=found.order)


def moved_over(found: Found, body: Body) -> np.ndarray:
    """`(P,)` what was found, as other patterns of perhaps other receptors tell it."""
    row = np.zeros(body.length, dtype=np.float32)
    body.axes(row)[:] = found.body.axes(found.row)
    body.centres(row)[:] = found.body.centres(found.row)
    for end in body.ends:
        own = body.coefficients(row, end)
        if end in body.points:
            own[:] = found.body.coefficients(found.row, end)
            continue
        before, after = found.body.skins[end], body.skins[end]
        _, one, other = np.intersect1d(before.receptor, after.receptor, return_indices=True)
        basis, place = after.basis[other], found.body.places(found.row, end)[one]
        damped = basis.T @ basis + _DAMPING * np.eye(basis.shape[1])
        own[:] = np.linalg.solve(damped, basis.T @ place)
    return row
