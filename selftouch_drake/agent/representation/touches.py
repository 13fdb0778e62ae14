"""Which receptors feel the same touches, and how many places a sensation is of (naive).

The agent does not know where its receptors are. But those whose fields overlap feel the same
touches again and again, and those far apart do not. So receptors fall into parts of the body, and
a sensation falls into separate touches.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.representation.quantise import strength
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: Receptors overlap if they feel together in this share of the touches of the rarer of the two.
#: Measured on a sphere with 100 receptors, fingers a quarter turn apart: at 0.4 no touch of one
#: finger was parted, and 73 % of those of two were; at 0.2 it was 28 %, as receptors between two
#: fingers join them; at 0.5 some touches of one finger fell apart.
_LEAST_SHARED = 0.4

#: Receptors of one part that feel together in this share may feel one touch, though they lie on
#: either side of it. By chance, receptors far apart share 0.003 of their touches.
_LEAST_NEAR = 0.1

#: A receptor that felt fewer touches says nothing of its own: it goes with the receptor that it
#: felt most touches with. Else two of them that meet by chance would join two skins.
_LEAST_FELT = 20

#: Up to this share of touches, those of two places at once are chance. The random walks of the
#: paper's arm touch in at most 8 % of their steps: two such arms touch together in at most 4 % of
#: all touches. Two fingers of one hand, a quarter turn apart on a sphere, do in 7.3 %.
_MOST_BY_CHANCE = 0.05


def overlapping(sensation: np.ndarray, least_shared: float = _LEAST_SHARED) -> np.ndarray:
    """Finds the receptors that overlap, from what they feel together.

    Args:
        sensation: `(n, S)` N, of touches as they come, most of them of one place.
        least_shared: share of the touches of the rarer of two receptors that the other feels too.

    Returns:
        `(S, S)` bool, symmetric, true on the diagonal.
    """
    shared, rarer, felt = _shared(sensation)
    known = felt >= _LEAST_FELT
    overlap = (shared >= least_shared) & np.logical_and.outer(known, known)
    # A receptor that overlaps with none, or of which too little is known, goes with its best
    # partner: alone it would be a part of the body.
    best = np.where(known, shared, 0.0)
    partner, most = best.argmax(axis=1), best.max(axis=1)
    led = ~overlap.any(axis=1) & (most >= np.where(known, _LEAST_NEAR, np.finfo(float).tiny))
    overlap[np.flatnonzero(led), partner[led]] = True
    # Receptors of which nothing is known may be of one part: nothing speaks against it.
    unknown = ~known & ~led
    overlap |= (shared > 0) & np.logical_and.outer(unknown, unknown)
    overlap |= overlap.T | np.eye(len(overlap), dtype=bool)
    # Within a part a share that may be large enough counts: a touch must not fall apart because few
    # touches were counted.
    maybe = shared + 1.0 / np.sqrt(np.maximum(rarer, 1.0)) >= least_shared
    return overlap | (maybe & (shared > 0) & _of_one_part(overlap))


def nearby(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """Finds the receptors of one part that may feel one touch, overlapping or a little apart.

    Args:
        sensation: `(n, S)` N, as in `overlapping`.
        overlap: `(S, S)` bool, of `overlapping`.

    Returns:
        `(S, S)` bool; true where `overlap` is.
    """
    return overlap | ((_shared(sensation)[0] >= _LEAST_NEAR) & _of_one_part(overlap))


def _shared(sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of the touches of the rarer that two receptors feel, null on the diagonal; counts."""
    touched = (np.asarray(sensation) > 0).astype(np.float32)
    together = touched.T @ touched
    felt = np.diag(together).copy()
    np.fill_diagonal(together, 0.0)
    rarer = np.minimum(felt[:, None], felt)
    return together / np.maximum(rarer, 1.0), rarer, felt


def _of_one_part(overlap: np.ndarray) -> np.ndarray:
    part = receptor_parts(overlap)
    return part[:, None] == part


def receptor_parts(overlap: np.ndarray) -> np.ndarray:
    """`(S,)` the part of the body that each receptor is on: overlaps join the receptors of a part.

    Args:
        overlap: `(S, S)` bool, of `overlapping` or `nearby`.
    """
    return connected_components(overlap, directed=False)[1]


def kernel_parts(target_sensations: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(K,)` the part of the body that each kernel is on; 0 has the most kernels.

    Args:
        target_sensations: `(K, S)`; that of the strongest receptor decides.
        overlap: `(S, S)` bool, of `overlapping` or `nearby`.
    """
    of_receptor = receptor_parts(overlap)[target_sensations.argmax(axis=1)]
    _, first, part, size = np.unique(
        of_receptor, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort((first, -size))
    return np.argsort(order)[part]


def apart(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(n,)` bool, sensations that touch several places at once.

    Args:
        sensation: `(n, S)` N.
        overlap: `(S, S)` bool, of `overlapping`.
    """
    sensation = np.asarray(sensation)
    beyond = (sensation > 0) & ~overlap[sensation.argmax(axis=1)]
    # All that overlaps with the strongest receptor is one touch: most need no closer look.
    several = beyond.any(axis=1)
    rows = np.flatnonzero(several)
    number, _ = separate_touches(sensation[rows], overlap, max_touches=1)
    several[rows] = number > 1
    return several


def of_several_parts(sensation: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(n,)` bool, sensations that touch several parts of the body; arguments as `apart`."""
    part = receptor_parts(overlap)
    felt = np.asarray(sensation) > 0
    strongest = part[np.asarray(sensation).argmax(axis=1)]
    return (felt & (part != strongest[:, None])).any(axis=1)


def by_chance(sensation: np.ndarray, overlap: np.ndarray) -> bool:
    """Whether touches of two places of one part come together by chance.

    Two hands that move independently sometimes touch at once, seldom: the share of such touches is
    about half of the share of time that a hand touches. They are left out, because any place of one
    hand goes with any of the other: what they feel has more dimensions than the body, and would
    take most targets. If they are the rule, as with two fingers of one hand, the quotient space is
    that of poses of the hand (paper, section II), and they are kept.

    Args:
        sensation: `(n, S)` N, a sample of the experience.
        overlap: `(S, S)` bool, of `overlapping`.
    """
    share = np.mean(apart(sensation, overlap) & ~of_several_parts(sensation, overlap))
    return bool(0.0 < share < _MOST_BY_CHANCE)


def set_aside(sensation: np.ndarray, near: np.ndarray, chance: bool) -> np.ndarray:
    """`(n,)` bool, sensations that nothing is learned from.

    Those of several parts of the body are, always: they have no place on one part. Those of
    several places of one part are, if they come by chance.

    Args:
        sensation: `(n, S)` N.
        near: `(S, S)` bool, of `nearby`: a touch where receptors are sparse is not set aside.
        chance: what `by_chance` said of a sample.
    """
    return apart(sensation, near) if chance else of_several_parts(sensation, near)


def felt_kernels(representation: QuotientRepresentation, sensation: np.ndarray) -> np.ndarray:
    """The target sensations nearest to what is felt, one for each place that is touched.

    A representation that set several touches aside knows one place at a time, and takes the touches
    of a sensation one by one. Else a sensation is taken whole.

    Args:
        representation: what the agent has learned.
        sensation: `(S,)` N.

    Returns:
        `(n,)` kernels, that of the strongest receptor first; none if nothing is felt.
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
    """Parts each sensation into the touches that no overlap joins.

    Args:
        sensation: `(n, S)` N.
        overlap: `(S, S)` bool, receptors that feel one touch together.
        max_touches: touches that are returned.

    Returns:
        `(n,)` number of touches, counted up to `max_touches + 1`, and `(n, max_touches, S)` N the
        touches, that of the strongest receptor first; zero where there are fewer.
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


def equal_touches(parts: np.ndarray) -> np.ndarray:
    """Divides each touch by its own L2 norm, and adds them up: how hard each presses is left out.

    Args:
        parts: `(n, touches, S)` N, of `separate_touches`.

    Returns:
        `(n, S)` without unit.
    """
    felt = strength(parts.reshape(-1, parts.shape[2])).reshape(parts.shape[:2])
    return np.einsum("nts,nt->ns", parts, 1.0 / np.where(felt > 0, felt, np.inf)).astype(np.float32)
