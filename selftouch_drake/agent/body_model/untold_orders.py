"""Which neighbours in a tree may change places, as far as touches tell.

They may if a body with the two exchanged, fitted as well as it can be, leaves touches about as near
to their kernels: two turns of a wrist, whose readings range over little, of a hand that is no
point. Their order is printed, and said to be open.
"""

from dataclasses import replace

import numpy as np

from selftouch_drake.agent.body_model.forest import dense_rows
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene, Solution, kernel_sums, solution_places
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.who_touched import started

# Touches that compare two orders, at most and at least, and steps of least squares for each.
_COMPARED, _FEWEST, _STEPS = 4000, 50, 6
# The order is told if the exchange is worse by so many standard errors, over kernels. Of an iCub
# that had two joints of a wrist exchanged these had -2 and 0, and all right neighbours 6 and more.
_TOLD = 3.0
# An exchange that moves places by more than so many times the noise, before any fit, is not tried.
# That wrist had 0.04, the other one 0.12, and all other neighbours 0.66 and more.
_PLAIN = 0.5


def untold_neighbours(
    tree: Tree, scene: Scene, solution: Solution, random: np.random.Generator
) -> list[tuple[int, int]]:
    """Pairs of a joint and the one that carries it, whose order touches do not tell.

    Args:
        tree: of joints.
        scene: touches.
        solution: of these.
        random: which touches are compared.
    """
    carriers = [*tree.parent.values(), *tree.part.values(), *tree.toucher.values()]
    # Where something else sits between the two, their order matters to it.
    return [
        (joint, above)
        for joint, above in tree.parent.items()
        if above >= 0
        and carriers.count(above) == 1
        and not _told(scene, solution, (joint, above), random)
    ]


def _told(
    scene: Scene, solution: Solution, pair: tuple[int, int], random: np.random.Generator
) -> bool:
    """Whether touches that need both joints tell their order."""
    ways = {
        ends: way for ends, way in scene.ways.items() if set(pair) <= {joint for joint, _ in way}
    }
    parts = [part for part in scene.parts if any(part == one for one, _ in ways)]
    each = _COMPARED // max(len(parts), 1)
    rows = [dense_rows(scene.target, scene.rows(part), random, each) for part in parts]
    if sum(map(len, rows)) < _FEWEST:
        return False
    as_it_is = replace(scene.some(np.sort(np.concatenate(rows))), ways=ways)
    exchanged = replace(as_it_is, ways={ends: _swapped(way, pair) for ends, way in ways.items()})
    begun = started(as_it_is, solution.twists, solution.points)
    moved = solution_places(exchanged, begun) - solution_places(as_it_is, begun)
    noise = np.nanmean(begun.sigma[parts])
    if np.nanmedian(np.linalg.norm(moved, axis=2)) > _PLAIN * noise:
        return True
    begins = begun, started(exchanged, solution.twists, solution.points)
    one, other = (
        _scatter(scene, refined(scene, begin, steps=_STEPS))
        for scene, begin in zip((as_it_is, exchanged), begins, strict=True)
    )
    worse = np.log(other) - np.log(one)
    worse = worse[np.isfinite(worse)]
    error = worse.std() / np.sqrt(max(len(worse), 1))
    return bool(len(worse) > 1 and worse.mean() > _TOLD * error)


def _swapped(way, pair: tuple[int, int]):
    """The way with two neighbours exchanged."""
    signs = dict(way)
    other = {pair[0]: pair[1], pair[1]: pair[0]}
    return tuple((other.get(joint, joint), signs[other.get(joint, joint)]) for joint, _ in way)


def _scatter(scene: Scene, solution: Solution) -> np.ndarray:
    """`(K,)` mean squared distance of touches to their kernels, relative to that of the part."""
    number = len(scene.part)
    away = solution_places(scene, solution) - solution.place[scene.target]
    square = np.einsum("nu,un->n", solution.share, np.nan_to_num((away**2).sum(axis=2)))
    mass = kernel_sums(solution.share.sum(axis=1), scene.target, number)
    found = np.full(number, np.nan)
    for part in scene.parts:
        here = (scene.part == part) & (mass > 3)
        size = np.nanvar(solution.place[here], axis=0).sum()
        found[here] = kernel_sums(square, scene.target, number)[here] / mass[here] / size
    return found
