"""Hands that are no points: several points of one link, and the order of joints that these tell."""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.cluster.vq import kmeans2

from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.forest import dense_rows, explained
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene, Solution
from selftouch_drake.agent.body_model.structure import Search, neighbours_swapped
from selftouch_drake.agent.body_model.touchers import in_hand
from selftouch_drake.agent.body_model.who_touched import started

# Where a point of a hand must have been, it was not if it is so many times farther from the middle
# of all such places than half of them are.
_FAR = 4.0
# Steps of least squares for points that clusters tell, and for joints that changed places.
_STEPS = 6
# Touches by which orders are compared; by so much the criterion must fall, and touches that are
# explained must not.
_COMPARED, _BETTER = 4000, 0.03


def spread(
    scene: Scene, solution: Solution, part: int, number: int, random: np.random.Generator
) -> tuple[Scene, Solution]:
    """Several points instead of the one of a link that touches a part: a hand is no point.

    Args:
        scene: touches of the part by one toucher.
        solution: of these.
        part: which part.
        number: of points.
        random: where clusters begin.
    """
    way = scene.ways[part, 0]
    cloud = in_hand(scene, solution, scene.rows(part), way)
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    away = np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1)
    cloud = cloud[away <= _FAR * np.median(away)]
    points = kmeans2(cloud, number, minit="++", rng=random)[0]
    wider = replace(scene, ways={(part, toucher): way for toucher in range(number)})
    begun = started(wider, solution.twists, points)
    return wider, refined(wider, begun, steps=_STEPS)


def in_better_order(
    search: Search, scene: Scene, solution: Solution, part: int
) -> tuple[Scene, Solution]:
    """Neighbours along the way of a hand change places as long as that makes kernels sharper.

    A chain was found by one point of its hand, to which an order with two joints at wrong places
    may be as good.

    Args:
        search: what to work on.
        scene: touches of the part by points of one link.
        solution: of these.
        part: which part.
    """
    some = scene.some(dense_rows(scene.target, scene.rows(part), search.random, _COMPARED))

    def trial(way: Way, begin: Solution) -> tuple[Scene, Solution]:
        own = replace(some, ways=dict.fromkeys(some.ways, way))
        return own, refined(own, started(own, begin.twists, begin.points), steps=_STEPS)

    best = trial(scene.ways[part, 0], solution)
    while True:
        search.tick()
        way, begin = best[0].ways[part, 0], best[1]
        # The criterion alone also falls where most touches become outliers.
        least = explained(best[0], begin, part) - _BETTER
        trials = [
            (own, found)
            for own, found in search.each(partial(trial, begin=begin), neighbours_swapped(way))
            if explained(own, found, part) > least
        ]
        sharpest = min([best, *trials], key=lambda one: float(one[1].criterion[part]))
        if sharpest[1].criterion[part] > begin.criterion[part] - _BETTER:
            break
        best = sharpest
    whole = replace(scene, ways=best[0].ways)
    begun = started(whole, best[1].twists, best[1].points)
    return whole, refined(whole, begun, steps=_STEPS)
