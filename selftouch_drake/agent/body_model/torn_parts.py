"""Parts of the graph that are skins of two links: a tree of joints tells them apart.

Touches that press two skins at once join them in the graph of the paper. No link explains such a
part as a whole, but each explains kernels of its own.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body_model import grow
from selftouch_drake.agent.body_model.forest import (
    Mechanism,
    dense_rows,
    hung,
    near_own,
)
from selftouch_drake.agent.body_model.scene import Scene
from selftouch_drake.agent.body_model.structure import Search
from selftouch_drake.agent.body_model.who_touched import started

# Touches of each kernel that are looked at, and the share of these that a link must explain. Of a
# torso and an upper arm that were one part of an infant, it told 135 of 139 kernels right.
_OF_KERNEL, _MOSTLY = 25, 0.5
# Kernels that make a part.
_FEWEST = 8


def torn_apart(
    body: Mechanism, search: Search, scene: Scene, tested: np.ndarray, moving: list[int]
) -> tuple[np.ndarray, Mechanism]:
    """A body with more parts, where some that had no place in it are skins of several links.

    Args:
        body: the tree so far.
        search: what to work on.
        scene: all touches; its ways are not read.
        tested: `(R,)` bool, held-out touches: not used.
        moving: joints that move.

    Returns:
        `(K,)` part of each target sensation, new ones numbered after all others, and the body.
    """
    waiting = [part for part in np.unique(scene.part).tolist() if part not in body.links.part]
    for part in waiting:
        rows = np.flatnonzero(~tested & (scene.part[scene.target] == part))
        pieces = _pieces(scene.some(rows), body, search)
        if len(pieces) < 2:
            continue
        # What no link explains stays with the largest.
        numbers = [part, *range(scene.part.max() + 1, scene.part.max() + len(pieces))]
        of_kernel = scene.part.copy()
        for number, own in zip(numbers, pieces, strict=True):
            of_kernel[own] = number
        torn, bigger = replace(scene, part=of_kernel), body
        for number in numbers:
            share, found = hung(torn.some(rows), bigger, number, search.random) or (0.0, bigger)
            bigger = found if share > grow.JOINS else bigger
        links = {bigger.links.part.get(number) for number in numbers} - {None}
        # On one link they would be one skin.
        if len(links) > 1:
            body, scene = grow.full(bigger, search, torn, tested, moving), torn
    return scene.part, body


def _pieces(touches: Scene, body: Mechanism, search: Search) -> list[np.ndarray]:
    """Kernels of a part, of which touches are given, by the link that explains them.

    First those of the link that explains most touches.
    """
    part = int(touches.part[touches.target[0]])
    number = _OF_KERNEL * len(np.unique(touches.target))
    some = dense_rows(touches.target, np.arange(len(touches.q)), search.random, number)
    left, pieces = touches.some(some), list[np.ndarray]()
    while len(left.q):
        own = max(_explained_by_links(left, body, part), key=lambda one: one[0])[1]
        if len(own) < _FEWEST:
            break
        pieces.append(own)
        left = left.some(np.flatnonzero(~np.isin(left.target, own)))
    return pieces


def _explained_by_links(
    touches: Scene, body: Mechanism, part: int
) -> Iterator[tuple[float, np.ndarray]]:
    """For each link how many touches it explains, of the kernels that it explains, and these."""
    count = np.bincount(touches.target, minlength=len(touches.part))
    for link in range(body.links.number):
        touchers = body.links.reaching(link)
        if not touchers:
            continue
        tried = replace(touches, ways=body.links.ways_to(part, link, touchers))
        near, _ = near_own(tried, started(tried, body.twists, body.points), part)
        own = np.bincount(touches.target, weights=near, minlength=len(count))
        fits = np.flatnonzero(own > _MOSTLY * np.maximum(count, 1))
        yield own[fits].sum(), fits
