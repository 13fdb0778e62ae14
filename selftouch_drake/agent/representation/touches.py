"""Finds receptors that feel the same touches, and counts the places touched at once (naive).

The agent does not know where its receptors are. But receptors with overlapping fields feel the same
touches again and again, and distant ones do not. So receptors can be grouped into parts of the
body, and a sensation can be split into separate touches.

A hand with a skin feels what it presses, each time with other places: a skin that hardly ever feels
alone is such a hand, and its touches count for a place on either side.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.representation.pools import MOST_POOLS, pooled, pools_of
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.sensations import strength, unit

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

#: Receptors are of one skin if they share this many touches, over the geometric mean of theirs, as
#: a share of what either shares with its best partner: with fists that wear skin, two skins of an
#: infant share half as much as neighbours do. Two skins that a fist presses at once share up to
#: 0.48 of the touches of the rarer receptor. Less than `_FEWEST` receptors are a rim of a skin.
_OF_ONE_SKIN, _FEWEST = 0.6, 5

#: A skin presses others if it feels alone in fewer touches, and if what is felt elsewhere varies:
#: where one of its receptors is the strongest, the mean of the rest (unit length) is shorter. The
#: rest is spread over neighbours, so that it varies no more where receptors are fine: 0.5 to 0.6
#: for an infant's fists, 0.75 or more for what they press, with 300 receptors and with 3000.
_ALONE, _ELSEWHERE = 0.25, 0.66

#: Touches of two places at once count as coincidence up to this share. Random walks of the paper's
#: arm touch in at most 8 % of their steps, so two such arms touch together in at most 4 % of all
#: touches. Two fingers of one hand, a quarter turn apart on a sphere, do in 7.3 %.
_MOST_BY_CHANCE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Which receptors feel the same touch, and how touches of several places come about.

    Attributes:
        near: `(P, P)` bool, pairs of pools of one part that overlap, or nearly.
        chance: whether two places of a part are touched at once by coincidence only.
        double: whether skins press skins, so that a touch is felt on both sides.
        binary: whether all receptors that feel a touch read the same.
        pool: `(S,)` the pool of each receptor; where there are few, each is one of its own.
    """

    near: np.ndarray
    chance: bool
    double: bool
    binary: bool
    pool: np.ndarray

    @property
    def overlap(self) -> np.ndarray:
        """`(S, S)` bool, pairs of receptors of one part that overlap, or nearly."""
        return self.near[np.ix_(self.pool, self.pool)]

    def places(self, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Takes `(n, S)` N sensations apart into those of the places that are learned from.

        Returns `(m,)` the sensation that each is of, ascending; `(m, P)` N, what pools feel; and
        `(m,)` bool, those that are left out: coincidences, and touches of several parts that are
        not double.
        """
        felt, one_part = pooled(np.asarray(sensation), self.pool), _of_one_part(self.near)
        row = np.arange(len(felt))
        if self.double:
            row, felt = separate_touches(felt, one_part)
        number = np.bincount(separate_touches(felt, self.near if self.chance else one_part)[0])
        return row, felt, number > 1

    def receptors(self, sensation: np.ndarray, row: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """`(m, S)` N, what receptors feel of what pools feel at the `places` of a sensation."""
        if len(self.pool) <= MOST_POOLS:
            return felt
        return np.where(felt[:, self.pool] > 0, sensation[row], 0)


def overlapping(sensation: np.ndarray) -> tuple[np.ndarray, bool]:
    """`(S, S)` bool, symmetric, true on the diagonal: receptors that overlap.

    Touches that they share show it: `(n, S)` N sensations, unselected. They also show whether skins
    press skins; otherwise, most of them are at one place.
    """
    shared, rarer, felt = _shared(sensation)
    known = felt >= _LEAST_FELT
    skin, presses = _skins(np.asarray(sensation), shared * rarer, felt, known)
    # No touch joins two skins; where none presses, a receptor that felt little may be of either.
    cut = presses[:, None] | presses | np.logical_and.outer(known, known)
    shared[(skin[:, None] != skin) & cut] = 0.0
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
    overlap |= maybe & (shared > 0) & _of_one_part(overlap)
    return overlap, bool(presses.any())


def receptors_together(sensation: np.ndarray) -> Together:
    """Finds which receptors feel the same touch, by sensations as in `overlapping`.

    Two hands that move independently seldom touch at once: the share of such touches is about half
    the share of time that one hand touches. They are excluded, because any place of one hand occurs
    with any place of the other: these sensations have more dimensions than the body, and would take
    most targets. If they are the rule, as with two fingers of one hand, the quotient space is that
    of poses of the hand (paper, section II), and they are kept.
    """
    pool = pools_of(sensation)
    felt = pooled(sensation, pool)
    overlap, double = overlapping(felt)
    one_part = _of_one_part(overlap)
    near = overlap | ((_shared(felt)[0] >= _LEAST_NEAR) & one_part)
    binary = bool(((sensation == 0) | (sensation == np.max(sensation))).all())
    each = np.arange(len(overlap))
    several = Together(overlap, True, double, binary, each).places(felt)[2]
    of_parts = Together(overlap, False, double, binary, each).places(felt)[2]
    # Two hands with skin may touch so near to each other that no touch shows that there are two.
    chance = (double or several.any()) and np.mean(several & ~of_parts) < _MOST_BY_CHANCE
    return Together(near, bool(chance), double, binary, pool)


def expected_readings(felt: np.ndarray, together: Together) -> np.ndarray | None:
    """`(P, P)` by which what pools feel is multiplied before it is compared; None if it is not.

    If all receptors that feel a touch read the same, two sets of them are equal or not, and hardly
    more or less alike. So each receptor stands for what is felt on average when it feels something,
    twice over: over receptors two neighbours away. Pools of forces do so once: touches of
    neighbouring kernels may share no receptor. `(n, P)` N is what pools feel, unselected.
    """
    if not together.binary and len(together.pool) <= MOST_POOLS:
        return None
    touched = (felt > 0).astype(np.float32)
    shared = np.where(_of_one_part(together.near), touched.T @ touched, 0.0).astype(np.float32)
    share = shared / np.maximum(np.diag(shared), 1.0)[:, None]
    np.fill_diagonal(share, 1.0)  # a receptor that felt nothing yet stands for itself
    return share @ share if together.binary else share


def _shared(sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`(S, S)` shared touches over touches of the rarer receptor, 0 on the diagonal; counts."""
    touched = (np.asarray(sensation) > 0).astype(np.float32)
    together = touched.T @ touched
    felt = np.diag(together).copy()
    np.fill_diagonal(together, 0.0)
    rarer = np.minimum(felt[:, None], felt)
    return together / np.maximum(rarer, 1.0), rarer, felt


def _skins(
    sensation: np.ndarray, together: np.ndarray, felt: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`(S,)` the skin of each receptor, and `(S,)` bool, whether that skin presses others.

    The counts of touches are `(S, S)` and `(S,)`; `(S,)` bool says which receptors felt enough.
    """
    alike = together / np.maximum(np.sqrt(np.outer(felt, felt)), 1.0)
    best = np.where(known[:, None] & known, alike, 0.0).max(axis=1)
    joined = known[:, None] & known & (alike >= _OF_ONE_SKIN * np.maximum(best[:, None], best))
    while True:
        num_skins, skin = connected_components(joined, directed=False)
        beyond = np.where(skin[:, None] == skin, 0.0, alike)
        partner, most = beyond.argmax(axis=1), beyond.max(axis=1)
        order, leader = np.argsort(most, kind="stable"), np.zeros(num_skins, dtype=int)
        leader[skin[order]] = order
        leader = leader[(np.bincount(skin) < _FEWEST) & (most[leader] > 0)]
        if not len(leader):
            break
        joined[leader, partner[leader]] = True
    spread = np.where(skin[:, None] == skin, together, 0.0) / np.maximum(felt, 1.0)[:, None]
    np.fill_diagonal(spread, 1.0)
    on = (sensation > 0) @ np.eye(num_skins, dtype=np.float32)[skin] > 0
    presses, alone = np.zeros(len(skin), dtype=bool), on.sum(axis=1) == 1
    for one in np.flatnonzero(on[alone].sum(axis=0) < _ALONE * on.sum(axis=0)):
        here, touches = skin == one, sensation[on[:, one] & ~alone]
        place = np.where(here, touches, 0).argmax(axis=1)
        at = csr_array((np.ones(len(place)), (place, np.arange(len(place)))))
        elsewhere = strength(at @ unit(np.where(here, 0, touches) @ spread))
        presses[here] = elsewhere.sum() < _ELSEWHERE * len(place)
    return skin, presses


def _receptor_parts(overlap: np.ndarray) -> np.ndarray:
    """`(S,)` the part of the body of each receptor: those connected by `(S, S)` overlaps."""
    return connected_components(overlap, directed=False)[1]


def _of_one_part(overlap: np.ndarray) -> np.ndarray:
    part = _receptor_parts(overlap)
    return part[:, None] == part


def kernel_parts(target_sensations: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """`(K,)` the part of the body that each kernel is on; 0 has the most kernels.

    The strongest receptor of each of `(K, S)` targets decides; `(S, S)` overlaps are as in
    `overlapping` or `Together`.
    """
    of_receptor = _receptor_parts(overlap)[target_sensations.argmax(axis=1)]
    _, first, part, size = np.unique(
        of_receptor, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort((first, -size))
    return np.argsort(order)[part]


def felt_kernels(representation: QuotientRepresentation, sensation: np.ndarray) -> np.ndarray:
    """`(n,)` the target sensations nearest to a sensation `(S,)` N, one for each place touched.

    That of the strongest receptor is first; there are none if nothing is felt. If the
    representation has several parts, or set touches of several places aside, the sensation is split
    into separate touches. Otherwise it is compared as a whole.
    """
    if not np.any(sensation):
        return np.empty(0, dtype=np.intp)
    touches = np.asarray(sensation)[None]
    if representation.num_set_aside or representation.part.any():
        _, touches = separate_touches(touches, representation.overlap)
    return (touches @ representation.target_sensations.T).argmax(axis=1)


def kernel_of_receptor(representation: QuotientRepresentation, receptor: int) -> int:
    """The target sensation in which a receptor counts most.

    Raises:
        ValueError: there is no such receptor, or no target sensation has it.
    """
    targets = representation.target_sensations
    if not 0 <= receptor < targets.shape[1]:
        raise ValueError(f"receptor is {receptor}; give 0 to {targets.shape[1] - 1}")
    kernel = int(targets[:, receptor].argmax())
    if not targets[kernel, receptor] > 0:
        raise ValueError(f"receptor is {receptor}, which no target sensation has; give another")
    return kernel


def separate_touches(sensation: np.ndarray, overlap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Splits each of `(n, S)` N sensations into touches that no `(S, S)` bool overlap connects.

    Returns `(m,)` the sensation that each touch is of, ascending, and `(m, S)` N what is felt of
    it, that of the strongest receptor first; no sensation is null.
    """
    row, rest, joined = np.arange(len(sensation)), np.asarray(sensation), overlap.astype(np.float32)
    rows, touches = list[np.ndarray](), list[np.ndarray]()
    while len(rest) or not rows:
        # Receptors that overlap the strongest one feel the same touch, which settles most rows.
        touch = (rest > 0) & overlap[rest.argmax(axis=1)]
        more = np.flatnonzero(((rest > 0) & ~touch).any(axis=1))
        size, grown = -1, touch[more]
        while size != (size := int(grown.sum())):
            grown = (grown.astype(np.float32) @ joined > 0) & (rest[more] > 0)
        touch[more] = grown
        rows.append(row)
        touches.append(np.where(touch, rest, 0) if len(more) else rest)
        left = np.where(grown, 0, rest[more])
        some = left.any(axis=1)
        row, rest = row[more][some], left[some]
    order = np.argsort(np.concatenate(rows), kind="stable")
    return np.concatenate(rows)[order], np.concatenate(touches)[order]
