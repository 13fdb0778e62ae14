"""Hands that are no points: several points of one link, and the order of joints that these tell."""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.cluster.vq import kmeans2

from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.forest import dense_rows, explained
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import BLUNT, Scene, Solution
from selftouch_drake.agent.body_model.structure import Search, neighbours_swapped
from selftouch_drake.agent.body_model.touchers import in_hand
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.who_touched import expected, started

# Where a point of a hand must have been, it was not if it is so many times farther from the middle
# of all such places than half of them are.
_FAR = 4.0
# The same once a tree stands: a few kernels at wrong places have all of their touches there.
_OUTSIDE = 2.5
# Steps of least squares for points that clusters tell, and for joints that changed places.
_STEPS = 6
# Touches by which orders are compared; by so much the criterion must fall, and touches that are
# explained must not.
_COMPARED, _BETTER = 4000, 0.03
# Share of touches that hands made, before touches say it.
_OF_HANDS = 0.95


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
    cloud = _near(in_hand(scene, solution, scene.rows(part), way))
    points = kmeans2(cloud, number, minit="++", rng=random)[0]
    wider = replace(scene, ways={(part, toucher): way for toucher in range(number)})
    begun = started(wider, solution.twists, points)
    return wider, refined(wider, begun, steps=_STEPS)


def with_more_points(
    tree: Tree, scene: Scene, solution: Solution, number: int, random: np.random.Generator
) -> tuple[Tree, Scene, Solution]:
    """The tree whose hands of several points have more of them, where their touches are.

    A few points are enough to find a tree; more say better where on a hand it touches. Kernels stay
    where they are at first: of many points of several hands some place fits any kernel.

    Args:
        tree: of the body.
        scene: touches of all parts.
        solution: of these.
        number: points of each hand that has three or more.
        random: where clusters begin.
    """
    points, toucher = list[np.ndarray](), dict[int, int]()
    ways = dict[tuple[int, int], Way]()
    for joint in sorted(set(tree.toucher.values())):
        hand = [u for u, its in tree.toucher.items() if its == joint]
        own = solution.points[hand]
        if len(hand) >= BLUNT:
            own = kmeans2(_touching(scene, solution, hand), number, minit="++", rng=random)[0]
        new = range(len(toucher), len(toucher) + len(own))
        points.append(own)
        toucher.update(dict.fromkeys(new, joint))
        ways.update(
            {(part, u): way for (part, v), way in scene.ways.items() if v in hand for u in new}
        )
    wider = replace(scene, ways=ways)
    begun = started(wider, solution.twists, np.concatenate(points))
    even = np.zeros_like(begun.frequency)
    for part in wider.parts:
        even[part, wider.touchers(part)] = _OF_HANDS / len(wider.touchers(part))
    known = replace(_known(begun, solution), frequency=even)
    return replace(tree, toucher=toucher), wider, expected(wider, known, rounds=4)


def for_all(scene: Scene, solution: Solution) -> Solution:
    """The solution for other touches of a body whose hands have many points.

    Kernels begin where they are known to be: of many points of several hands some place fits any.

    Args:
        scene: the other touches.
        solution: of some.
    """
    begun = started(scene, solution.twists, solution.points)
    return expected(scene, replace(_known(begun, solution), frequency=solution.frequency))


def _known(begun: Solution, solution: Solution) -> Solution:
    """What began anew, with the places, normals and noise that a solution knows."""
    met = np.isfinite(solution.place).all(axis=1)[:, None]
    return replace(
        begun,
        place=np.where(met, solution.place, begun.place),
        normal=np.where(met, solution.normal, begun.normal),
        sigma=solution.sigma,
    )


def _touching(scene: Scene, solution: Solution, hand: list[int]) -> np.ndarray:
    """`(n, 3)` where in a hand its touches of all parts were, but for those far away."""
    clouds = []
    for part in scene.parts:
        own = [u for u in hand if (part, u) in scene.ways]
        if own:
            rows = scene.rows(part)
            rows = rows[solution.share[np.ix_(rows, np.array(own))].sum(axis=1) > 0.5]
            clouds.append(in_hand(scene, solution, rows, scene.ways[part, own[0]]))
    return _near(np.concatenate(clouds), _OUTSIDE)


def _near(cloud: np.ndarray, far: float = _FAR) -> np.ndarray:
    """Known places that are not far from the middle of all."""
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    away = np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1)
    return cloud[away <= far * np.median(away)]


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
