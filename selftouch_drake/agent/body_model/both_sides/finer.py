"""A body that was found, with finer skins and steadier joints.

A search moves few patterns of each skin: more of them only make it slower. Where the touches were,
it then knows no better than these patterns can say. A finish by least squares takes more. It would
also bend joints to what touches say by chance, so it holds them where several drafts agree.
"""

from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.body_model.both_sides.finish import finished
from selftouch_drake.agent.body_model.both_sides.judgement import Found
from selftouch_drake.agent.body_model.both_sides.pairs import senses
from selftouch_drake.agent.body_model.both_sides.problem import Body, Problem
from selftouch_drake.agent.body_model.both_sides.recordings import Recording, folds_of_postures
from selftouch_drake.agent.body_model.both_sides.search import SIGMA
from selftouch_drake.agent.body_model.both_sides.steady import Joints, Pair, agreed

#: Patterns of each skin, chosen on fold 0 of the touches of one Nao.
FINE = 40
# Drafts, each without one part of the postures, and steps of each finish; chosen likewise.
_DRAFTS, _STEPS = 5, 40
# Damping of coefficients that take places over from other patterns.
_DAMPING = 1e-2


def finer(found: Found, recordings: Sequence[Recording], size: int = FINE) -> Found:
    """The body with so many patterns of each skin, after finishes by least squares.

    Args:
        found: what a search found in these recordings.
        recordings: of the body.
        size: patterns of each skin.
    """
    layout = found.body.layout
    pairs = [
        Pair(
            first=layout.limbs[first], second=layout.limbs[second],
            sense=senses(recordings, layout, first, second),
        )
        for first, second in layout.mirrored
    ]  # fmt: skip
    return _fitted(found, recordings, size, agreed(found, _drafts(found, recordings, size), pairs))


def _drafts(found: Found, recordings: Sequence[Recording], size: int) -> list[Found]:
    """The body without one part of the postures after the other, with more and more patterns."""
    fewest = max(found.body.size(end) for end in found.body.skins)
    parts = [
        folds_of_postures(one.q[:, found.body.layout.between(one)], folds=_DRAFTS)
        for one in recordings
    ]
    drafts = []
    for number, patterns in enumerate(np.linspace(fewest, size, _DRAFTS).round()):
        # A recording of a single posture is in every draft.
        some = [
            one.some(np.flatnonzero(rest)) if (rest := part != number).any() else one
            for one, part in zip(recordings, parts, strict=True)
        ]
        drafts.append(_fitted(found, some, int(patterns)))
    return drafts


def _fitted(
    found: Found, recordings: Sequence[Recording], size: int, joints: Joints | None = None
) -> Found:
    """The body with so many patterns, its joints held near some as far as these are sure."""
    body = Body.of(recordings, found.body.layout, size)
    problem = Problem.of(body, recordings)
    columns = np.arange(body.num_joints)[None]
    row = moved_over(found, body)
    expected = None
    if joints is not None:
        expected = np.full(body.length, np.inf)
        body.axes(row)[:], body.centres(row)[:] = joints.axes, joints.centres
        body.axes(expected)[:] = joints.axes_off[:, None]
        body.centres(expected)[:] = joints.centres_off[:, None]
    begun = problem.evaluated(row[None], columns, SIGMA)
    row = finished(problem, begun, sigma=SIGMA, steps=_STEPS, expected=expected).rows[0]
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
