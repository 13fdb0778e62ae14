"""Finds receptors that feel the same touches, and counts the places touched at once (naive).

The agent does not know where its receptors are. But receptors with overlapping fields feel the same
touches again and again, and distant ones do not. So receptors can be grouped into parts of the
body, and a sensation can be split into separate touches.
"""

import numpy as np
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: Receptors overlap if both feel this share of the touches of the rarer one. Measured on a sphere
#: with 100 receptors and two fingers a quarter turn apart: at 0.4 no touch of one finger was split,
#: and 73 % of those of two fingers were; at 0.2 only 28 % were, since receptors between the fingers
#: join them; at 0.5 some touches of one finger were split.
_LEAST_SHARED = 0.4

#: Receptors of one part that share this many touches may feel the same touch from opposite sides.
#: Receptors far apart share 0.003 of their touches by chance.
_LEAST_NEAR = 0.1

#: A receptor that felt fewer touches joins the receptor with which it shared most touches.
#: Otherwise two such receptors that meet by chance would connect two skins.
_LEAST_FELT = 20

#: Touches of two places at once count as coincidence up to this share. Random walks of the paper's
#: arm touch in at most 8 % of their steps, so two such arms touch together in at most 4 % of all
#: touches. Two fingers of one hand, a quarter turn apart on a sphere, do in 7.3 %.
_MOST_BY_CHANCE = 0.05


def overlapping(sensation: np.ndarray) -> np.ndarray:
    """`(S, S)` bool, symmetric, true on the diagonal: receptors that overlap.

    Touches that they share show it: `(n, S)` N sensations, unselected, most of them at one place.
    """
    shared, rarer, felt = _shared(sensation)
    known = felt >= _LEAST_FELT
    overlap = (shared >= _LEAST_SHARED) & np.logical_and.outer(known, known)
    # A receptor that overlaps with none, or felt too few touches, joins its best partner: alone it
    # would be a part of the body.
    best = np.where(known, shared, 0.0)
    partner, most = best.argmax(axis=1), best.max(axis=1)
    led = ~overlap.any(axis=1) & (most >= np.where(known, _LEAST_NEAR, np.finfo(float).tiny))
    overlap[np.flatnonzero(led), partner[led]] = True
    # Receptors without a known partner may be of one part: no evidence contradicts it.
    unknown = ~known & ~led
    overlap |= (shared > 0) & np.logical_and.outer(unknown, unknown)
    overlap |= overlap.T | np.eye(len(overlap), dtype=bool)
    # Within a part the upper error bound of the share counts: a touch must not be split because
    # there were few touches.
    maybe = shared + 1.0 / np.sqrt(np.maximum(rarer, 1.0)) >= _LEAST_SHARED
    return overlap | (maybe & (shared > 0) & _of_one_part(overlap))


def receptors_together(sensation: np.ndarray) -> tuple[np.ndarray, bool]:
    """Which receptors feel the same touch, and whether some touch two places by coincidence.

    They are `(S, S)` bool: of one part, they overlap, or nearly, by sensations as of `overlapping`.

    Two hands that move independently seldom touch at once: the share of such touches is about half
    the share of time that one hand touches. They are excluded, because any place of one hand occurs
    with any place of the other: these sensations have more dimensions than the body, and would take
    most targets. If they are the rule, as with two fingers of one hand, the quotient space is that
    of poses of the hand (paper, section II), and they are kept.
    """
    overlap = overlapping(sensation)
    near = overlap | ((_shared(sensation)[0] >= _LEAST_NEAR) & _of_one_part(overlap))
    several = apart(sensation, overlap)
    share = np.mean(several & ~of_several_parts(sensation, overlap))
    return near, bool(several.any() and share < _MOST_BY_CHANCE)


def expected_readings(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray | None:
    """`(S, S)` by which sensations are multiplied before they are compared; None where as they are.

    If all receptors that feel a touch read the same, two sets of them are equal or not, and hardly
    more or less alike. So each receptor stands for what is felt on average when it feels something,
    twice over: over receptors two neighbours away. `(n, S)` N sensations are unselected, overlaps
    are as of `receptors_together`.
    """
    if not ((sensation == 0) | (sensation == sensation.max())).all():
        return None
    touched = (sensation > 0).astype(np.float32)
    together = np.where(_of_one_part(overlap), touched.T @ touched, 0.0).astype(np.float32)
    share = together / np.maximum(np.diag(together), 1.0)[:, None]
    np.fill_diagonal(share, 1.0)  # a receptor that felt nothing yet stands for itself
    return share @ share


def _shared(sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`(S, S)` shared touches over touches of the rarer receptor, 0 on the diagonal; counts."""
    touched = (np.asarray(sensation) > 0).astype(np.float32)
    together = touched.T @ touched
    felt = np.diag(together).copy()
    np.fill_diagonal(together, 0.0)
    rarer = np.minimum(felt[:, None], felt)
    return together / np.maximum(rarer, 1.0), rarer, felt


def _receptor_parts(overlap: np.ndarray) -> np.ndarray:
    """`(S,)` the part of the body of each receptor: those connected by `(S, S)` overlaps."""
    return connected_components(overlap, directed=False)[1]


def _of_one_part(overlap: np.ndarray) -> np.ndarray:
    part = _receptor_parts(overlap)
    return part[:, None] == part


def kernel_parts(target_sensations: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(K,)` the part of the body that each kernel is on; 0 has the most kernels.

    The strongest receptor of each of `(K, S)` targets decides; `(S, S)` overlaps are as of
    `overlapping` or `receptors_together`.
    """
    of_receptor = _receptor_parts(overlap)[target_sensations.argmax(axis=1)]
    _, first, part, size = np.unique(
        of_receptor, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort((first, -size))
    return np.argsort(order)[part]


def apart(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(n,)` bool, `(n, S)` N sensations of several places at once, by `(S, S)` bool overlaps."""
    beyond = (sensation > 0) & ~overlap[sensation.argmax(axis=1)]
    # Receptors that overlap the strongest one feel the same touch, which settles most rows.
    several = beyond.any(axis=1)
    rows = np.flatnonzero(several)
    number, _ = separate_touches(sensation[rows], overlap, max_touches=1)
    several[rows] = number > 1
    return several


def of_several_parts(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(n,)` bool, sensations on several parts of the body; arguments as for `apart`."""
    part = _receptor_parts(overlap)
    if not part.any():
        return np.zeros(len(sensation), dtype=bool)
    strongest = part[sensation.argmax(axis=1)]
    return ((sensation > 0) & (part != strongest[:, None])).any(axis=1)


def ambiguous_touches(sensation: np.ndarray, near: np.ndarray, chance: bool) -> np.ndarray:
    """`(n,)` bool, `(n, S)` N sensations that are excluded from learning.

    Sensations on several parts of the body always are: they belong to no single part. Sensations
    at several places of one part are if they are coincidence; `near` and `chance` are of
    `receptors_together`.
    """
    return apart(sensation, near) if chance else of_several_parts(sensation, near)


def felt_kernels(representation: QuotientRepresentation, sensation: np.ndarray) -> np.ndarray:
    """`(n,)` the target sensations nearest to a sensation `(S,)` N, one for each place touched.

    That of the strongest receptor is first; there are none if nothing is felt. If the
    representation set touches of several places aside, the sensation is split into separate
    touches. Otherwise it is compared as a whole.
    """
    sensation = np.asarray(sensation)
    if not sensation.any():
        return np.empty(0, dtype=int)
    touches = sensation[None]
    if representation.num_set_aside:
        _, (parted,) = separate_touches(touches, representation.overlap)
        touches = parted[parted.any(axis=1)]
    return (touches @ representation.target_sensations.T).argmax(axis=1)


def separate_touches(
    sensation: np.ndarray, overlap: np.ndarray, max_touches: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """Splits each of `(n, S)` N sensations into touches that no `(S, S)` bool overlap connects.

    Returns `(n,)` their number, counted up to `max_touches + 1`, and `(n, max_touches, S)` N, that
    of the strongest receptor first; zero where there are fewer.
    """
    sensation = np.asarray(sensation, dtype=np.float32)
    joined = overlap.astype(np.float32)
    rest = sensation.copy()
    number = np.zeros(len(sensation), dtype=int)
    parts = np.zeros((len(sensation), max_touches, sensation.shape[1]), dtype=np.float32)
    for touch in range(max_touches):
        some = rest.max(axis=1) > 0
        number += some
        part = np.zeros(rest.shape, dtype=bool)
        part[np.flatnonzero(some), rest[some].argmax(axis=1)] = True
        size = -1
        while size != (size := int(part.sum())):
            part = (part.astype(np.float32) @ joined > 0) & (rest > 0)
        parts[:, touch] = np.where(part, rest, 0.0)
        rest = np.where(part, 0.0, rest)
    return number + (rest.max(axis=1) > 0), parts
