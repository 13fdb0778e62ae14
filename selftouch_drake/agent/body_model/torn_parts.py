"""Parts of the graph that are skins of two links: a tree of joints tells them apart.

Touches that press two skins at once join them in the graph of the paper. Neither link explains such
a part as a whole, but each explains kernels of its own, and all that the other one does not.
"""

from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body_model import grow
from selftouch_drake.agent.body_model.forest import (
    Mechanism,
    dense_rows,
    hung,
    near_own,
    places_of_parts,
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
    for part in np.unique(scene.part).tolist():
        if part in body.links.part:
            continue
        rows = np.flatnonzero(~tested & (scene.part[scene.target] == part))
        own = _kernels_of_one_link(scene.some(rows), body, part, search)
        rest = np.setdiff1d(np.flatnonzero(scene.part == part), own)
        if len(own) < _FEWEST or len(rest) < _FEWEST:
            continue
        of_kernel = scene.part.copy()
        of_kernel[rest] = new = int(scene.part.max()) + 1
        torn = replace(scene, part=of_kernel)
        bigger = body
        for one in (part, new):
            share, found = hung(torn.some(rows), bigger, one, search.random) or (0.0, bigger)
            bigger = found if share > grow.JOINS else bigger
        # On one link both would be one skin.
        links = [bigger.links.part.get(one) for one in (part, new)]
        if None not in links and links[0] != links[1]:
            body, scene = grow.full(bigger, search, torn, tested, moving), torn
    return scene.part, body


def _kernels_of_one_link(touches: Scene, body: Mechanism, part: int, search: Search) -> np.ndarray:
    """The kernels that the link explains that explains most touches of a part."""
    rows = np.arange(len(touches.q))
    number = _OF_KERNEL * len(np.unique(touches.target))
    some = touches.some(dense_rows(touches.target, rows, search.random, number))
    count = np.bincount(some.target, minlength=len(some.part))
    best, most = np.zeros(0, dtype=int), 0
    for link, one in places_of_parts(body):
        touchers = one.links.reaching(link)
        if not touchers:
            continue
        tried = replace(some, ways=one.links.ways_to(part, link, touchers))
        near, _ = near_own(tried, started(tried, one.twists, one.points), part)
        own = np.bincount(some.target, weights=near, minlength=len(count))
        fits = np.flatnonzero(own > _MOSTLY * np.maximum(count, 1))
        if own[fits].sum() > most:
            best, most = fits, own[fits].sum()
    return best
