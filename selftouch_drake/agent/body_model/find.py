"""Finds the body: joints, their order, touchers and skin, from configurations and their labels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model import grow, structure
from selftouch_drake.agent.body_model.assemble import Found, assembled, normalizing
from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.fit import Bodies, Each, Group
from selftouch_drake.agent.body_model.forest import Body
from selftouch_drake.agent.body_model.judge import Judgement, held_out, judged
from selftouch_drake.agent.body_model.model import BodyModel, JointKind, rejected
from selftouch_drake.agent.body_model.refine import (
    Scene,
    Solution,
    refined,
    solution_places,
    started,
)
from selftouch_drake.agent.body_model.sizes import carried_over, with_sizes
from selftouch_drake.agent.body_model.structure import Search, found_chains, swap_costs
from selftouch_drake.agent.body_model.touchers import with_more
from selftouch_drake.agent.body_model.tree import Tree

# Touches that a search and a finish look at: more give nothing but time. A cube's places have an
# error of 0.597 % with 30,000 touches and of 0.588 with 100,000.
_SEARCHED, _REFINED = 25_000, 40_000
# Touchers on one link, at most.
_MOST_TOUCHERS = 4
# A joint slides if it turns by less over its range, in radians, and if not to turn costs less.
_SLIDES, _SLIDE_COST = 0.2, 0.05
# Below this turn, in radians, turning and sliding look alike.
_OPEN = 0.6
# Neighbours may change places if that costs less.
_SWAPS = 0.02
# More touchers are tried where a single one explains at least this share of held-out touches.
_HOPE = 0.2
# Above this share of inliers there is no other toucher to look for.
_ALL = 0.97
# Neighbours commute if the bracket of their twists is so small, relative to their sizes.
_COMMUTE = 0.05


def find_body_model(
    q: np.ndarray,
    sensation: csr_array | None,
    target: np.ndarray,
    part: np.ndarray,
    *,
    joint_names: Sequence[str],
    double: np.ndarray | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
    each: Each = map,
) -> BodyModel:
    """Asks whether joints that turn or slide something rigid explain the touches.

    Args:
        q: `(R, J)` motor configurations of the stored touches, in any units.
        sensation: `(R, S)` readings of the receptors; None: receptors get no places.
        target: `(R,)` target sensation of each touch.
        part: `(K,)` part of each target sensation.
        joint_names: `(J,)` carried along.
        double: `(R,)` bool, touches that press two parts: the fit leaves them out.
        seed: of all randomness.
        progress: called with the fraction done, 0 to 1, and what is done.
        each: maps a function over items, in threads for instance; the model does not depend on it.

    Returns:
        The body model, with its judgement: rejected where held-out touches do not agree.
    """
    touches = Touches.of(q, target, part, double)

    def none(reason: str) -> BodyModel:
        return rejected(
            reason,
            joint_names=joint_names,
            kernel_part=np.asarray(part),
            num_rows=len(q),
            num_receptors=0 if sensation is None else sensation.shape[1],
            seed=seed,
        )

    if len(touches.rows) < structure.FEWEST or len(touches.moving) == 0:
        return none(
            f"{len(touches.rows)} touches of {len(touches.moving)} moving joints are too few to "
            f"look for a body ({structure.FEWEST} needed)."
        )
    tick = _Ticks(progress)
    search = Search(touches.single(), np.random.default_rng(seed), each, tick)
    found = _find(search, touches, seed)
    if found is None:
        return none("No chain of joints explains the touches.")
    tick.say(0.97, "skin")
    model = assembled(found, joint_names=joint_names, num_rows=len(q), sensation=sensation)
    tick.say(1.0, "judged")
    return model


class _Ticks:
    """Tells the progress of work whose length nobody knows: ever slower towards 0.95."""

    def __init__(self, progress: Callable[[float, str], None] | None):
        self._progress, self._left, self._what = progress, 0.95, "order of joints"

    def __call__(self, what: str = "") -> None:
        self._left *= 0.98
        self.say(0.95 - self._left, what or self._what)

    def say(self, fraction: float, what: str) -> None:
        self._what = what
        if self._progress is not None:
            self._progress(fraction, what)


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """The touches that may be explained, standardised.

    Attributes:
        q: `(n, J)` standardised readings; 0 for joints that never move.
        target: `(n,)`.
        part: `(K,)`.
        rows: `(n,)` indices among all touches.
        center: `(J,)` of the readings.
        scale: `(J,)` of the readings, 1 for joints that never move.
        moving: joints that move.
    """

    q: np.ndarray
    target: np.ndarray
    part: np.ndarray
    rows: np.ndarray
    center: np.ndarray
    scale: np.ndarray
    moving: list[int]

    @staticmethod
    def of(q, target, part, double) -> "Touches":
        """Leaves out double touches and what is not finite, and standardises."""
        q, target = np.asarray(q, dtype=float), np.asarray(target)
        kept = np.isfinite(q).all(axis=1)
        if double is not None:
            kept &= ~np.asarray(double, dtype=bool)
        rows = np.flatnonzero(kept)
        q, target = q[rows], target[rows]
        if len(rows) == 0:
            width = q.shape[1]
            return Touches(q, target, np.asarray(part), rows, np.zeros(width), np.ones(width), [])
        center, scale = q.mean(axis=0), q.std(axis=0)
        still = scale <= 1e-9 * np.maximum(np.abs(center), 1e-3)
        scale = np.where(still, 1.0, scale)
        standard = np.where(still, 0.0, (q - center) / scale)
        moving = np.flatnonzero(~still).tolist()
        return Touches(standard, target, np.asarray(part), rows, center, scale, moving)

    def single(self) -> np.ndarray:
        """`(J, n)` float32 readings, as a search wants them."""
        return np.ascontiguousarray(self.q.T.astype(np.float32))

    def scene(self, ways) -> Scene:
        """All of them, with ways."""
        return Scene(self.q, self.target, self.part, ways)


def _find(search: Search, touches: Touches, seed: int) -> Found | None:
    """The body of one part by one hand, or else of any tree."""
    tested = held_out(touches.q, search.random)
    parts = sorted(set(touches.part[touches.target].tolist()))
    chain = None
    if len(parts) == 1:
        chain = _chain_of_part(search, touches, *_split(touches, tested, parts[0]), parts[0])
        if chain is not None and chain.judgement.accepted:
            return _finished(search, touches, chain, tested, seed)
    body = grow.grown(search, touches.scene({}), tested, touches.moving)
    if body is not None:
        found = _finished_tree(search, touches, body, tested, seed)
        if chain is None or any(verdict.accepted for verdict in found.judgements.values()):
            return found
    return None if chain is None else _finished(search, touches, chain, tested, seed)


def _split(touches: Touches, tested: np.ndarray, part: int) -> tuple[np.ndarray, np.ndarray]:
    """Training touches and held-out touches of a part."""
    mine = touches.part[touches.target] == part
    return np.flatnonzero(mine & ~tested), np.flatnonzero(mine & tested)


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """A chain to one part, with its touchers.

    Attributes:
        part: that it reaches.
        order: of its joints.
        scene: training touches that were used.
        solution: of them.
        judgement: on held-out touches.
        swaps: `(L - 1,)` what it costs that neighbours change places.
    """

    part: int
    order: list[int]
    scene: Scene
    solution: Solution
    judgement: Judgement
    swaps: np.ndarray


def _better(one: _Chain, other: _Chain) -> bool:
    return np.nan_to_num(one.judgement.near) > np.nan_to_num(other.judgement.near)


def _chain_of_part(
    search: Search, touches: Touches, train: np.ndarray, test: np.ndarray, part: int
) -> _Chain | None:
    """The best chain of a part: the first one that held-out touches accept, else the nearest."""
    some = np.sort(search.random.permutation(train)[:_SEARCHED])
    group = Group.of(some, touches.target[some])
    if group.num_kernels < 8:
        return None
    best = None
    for body in found_chains(search, group, touches.moving):
        order = structure.order_of(body.ways[0][0])
        chain = _solved(search, touches, (train, test), body, part)
        if best is None or _better(chain, best):
            swaps = swap_costs(search, group, body)
            best = replace(chain, order=order, swaps=swaps)
        if best.judgement.accepted:
            break
    return best


def _solved(
    search: Search, touches: Touches, split: tuple[np.ndarray, np.ndarray], body: Bodies, part: int
) -> _Chain:
    """Least squares, further touchers, and the judgement of a chain."""
    train, test = split
    way = body.ways[0][0]
    all_of_it = touches.scene({(part, 0): way})
    used = np.sort(search.random.permutation(train)[:_REFINED])
    scene, tests = all_of_it.some(used), all_of_it.some(test)
    solution = refined(scene, started(scene, body.twists[0], body.points[0]), tick=search.tick)
    verdict = judge_part(scene, tests, solution, part)
    # A chain may be that of one finger, and take the touches of another for outliers.
    explains_all = verdict.accepted and verdict.inliers > _ALL
    if not explains_all and np.nan_to_num(verdict.near) > _HOPE:
        more, more_tests, grown = with_more(
            scene, tests, solution, part, _MOST_TOUCHERS, search.random
        )
        if len(grown.points) > 1:
            grown = refined(more, grown, tick=search.tick)
            scene, tests, solution = more, more_tests, grown
            verdict = judge_part(scene, tests, solution, part)
    order = structure.order_of(way)
    return _Chain(part, order, scene, solution, verdict, np.full(max(len(order) - 1, 0), np.inf))


def judge_part(scene: Scene, tests: Scene, solution: Solution, part: int) -> Judgement:
    """The judgement of one part.

    Args:
        scene: training touches.
        tests: held-out touches.
        solution: of the training touches.
        part: which part.
    """
    rows, test_rows = scene.rows(part), tests.rows(part)
    touchers = scene.touchers(part)
    Y = solution_places(scene, solution)
    own = Y[solution.share[rows].argmax(axis=1), rows]
    own[solution.share[rows].sum(axis=1) < 0.5] = np.nan
    joints = {joint for u in touchers for joint, _ in scene.ways[part, u]}
    there = solution_places(tests, solution)[touchers][:, test_rows]
    return judged(
        own, scene.target[rows], there.swapaxes(0, 1), tests.target[test_rows],
        parameters=6 * len(joints) + 3 * len(touchers), number=len(scene.part),
    )  # fmt: skip


def _finished(
    search: Search, touches: Touches, chain: _Chain, tested: np.ndarray, seed: int
) -> Found:
    """Kinds of joints, which of them may change places, and who made each touch of all."""
    solution, kind = _kinds(search, touches, chain.scene, chain.solution)
    number = len(touches.center)
    tree = Tree.chain(chain.order, chain.part, len(solution.points))
    whole = touches.scene(chain.scene.ways)
    test = whole.some(np.flatnonzero(tested))
    solution = with_sizes(
        chain.scene, test, solution, search.random, fixed=_straight(kind), tick=search.tick
    )
    verdict = judge_part(chain.scene, test, solution, chain.part)
    groups = order_groups(chain.order, chain.swaps, number)
    final = carried_over(whole, solution)
    return Found(
        tree=tree, scene=whole, rows=touches.rows, solution=final, center=touches.center,
        scale=touches.scale, kind=kind, order_group=groups, judgements={chain.part: verdict},
        seed=seed,
    )  # fmt: skip


def order_groups(order: list[int], swaps: np.ndarray, number: int) -> np.ndarray:
    """`(J,)` the same number for neighbours that may change places, else -1."""
    groups = np.full(number, -1)
    for index, cost in enumerate(swaps):
        if cost < _SWAPS:
            first, second = order[index], order[index + 1]
            groups[first] = groups[second] = max(groups[first], groups[second])
            if groups[first] < 0:
                groups[[first, second]] = groups.max() + 1
    return groups


def _kinds(
    search: Search, touches: Touches, scene: Scene, solution: Solution
) -> tuple[Solution, np.ndarray]:
    """Which joints slide; they then do not turn at all."""
    used = sorted({joint for way in scene.ways.values() for joint, _ in way})
    kind = np.full(len(touches.center), int(JointKind.UNUSED))
    kind[used] = JointKind.TURNS
    low, high = np.quantile(touches.q, [0.005, 0.995], axis=0)
    turn = np.linalg.norm(solution.twists[:, :3], axis=1) * (high - low)
    fixed = np.zeros(solution.twists.size + solution.points.size, dtype=bool)
    for joint in sorted(used, key=lambda joint: turn[joint]):
        if turn[joint] >= _OPEN:
            continue
        kind[joint] = JointKind.OPEN
        if turn[joint] < _SLIDES:
            trial_fixed = fixed.copy()
            trial_fixed[6 * joint : 6 * joint + 3] = True
            straight = solution.twists.copy()
            straight[joint, :3] = 0
            trial = started(scene, straight, solution.points)
            trial = refined(scene, trial, fixed=trial_fixed, tick=search.tick)
            cost = np.nanmean(trial.criterion) - np.nanmean(solution.criterion)
            if cost < _SLIDE_COST:
                kind[joint], solution, fixed = JointKind.SLIDES, trial, trial_fixed
    return solution, kind


def _straight(kind: np.ndarray) -> np.ndarray:
    """`(6 J,)` bool, the turning of joints that slide: it stays 0."""
    fixed = np.zeros((len(kind), 6), dtype=bool)
    fixed[kind == JointKind.SLIDES, :3] = True
    return fixed.ravel()


def _finished_tree(
    search: Search, touches: Touches, body: Body, tested: np.ndarray, seed: int
) -> Found:
    """The bundle of all parts, refined; kinds of joints, judgements, and who made each touch."""
    counts = np.bincount(touches.part[touches.target], minlength=len(touches.part))
    root = body.links.part[max(body.links.part, key=lambda part: counts[part])]
    tree = body.links.rooted(root)
    twists = body.twists.copy()
    twists[body.links.backwards(root)] *= -1
    whole = touches.scene(tree.ways(list(body.pairs)))
    train = search.random.permutation(np.flatnonzero(~tested))[:_REFINED]
    scene, tests = whole.some(np.sort(train)), whole.some(np.flatnonzero(tested))
    solution = refined(scene, started(scene, twists, body.points), tick=search.tick)
    solution, kind = _kinds(search, touches, scene, solution)
    solution = with_sizes(
        scene, tests, solution, search.random, fixed=_straight(kind), tick=search.tick
    )
    verdicts = {part: judge_part(scene, tests, solution, part) for part in scene.parts}
    final = carried_over(whole, solution)
    groups = _commuting(tree, adjoint(normalizing(final.place), solution.twists))
    return Found(
        tree=tree, scene=whole, rows=touches.rows, solution=final, center=touches.center,
        scale=touches.scale, kind=kind, order_group=groups,
        judgements=verdicts, seed=seed,
    )  # fmt: skip


def _commuting(tree: Tree, twists: np.ndarray) -> np.ndarray:
    """`(J,)` the same number for neighbours in a row whose order makes no difference.

    Args:
        tree: of joints.
        twists: `(J, 6)` in a frame whose unit and origin are those of the body.
    """
    groups = np.full(len(twists), -1)
    carriers = [*tree.parent.values(), *tree.part.values(), *tree.toucher.values()]
    for joint, above in tree.parent.items():
        # Where something else sits between the two, their order does matter.
        if above < 0 or carriers.count(above) > 1:
            continue
        (w, v), (x, y) = np.split(twists[joint], 2), np.split(twists[above], 2)
        bracket = np.r_[np.cross(w, x), np.cross(w, y) - np.cross(x, v)]
        if np.linalg.norm(bracket) < _COMMUTE * _amount(w, v) * _amount(x, y):
            group = max(groups[joint], groups[above])
            groups[[joint, above]] = group if group >= 0 else groups.max() + 1
    return groups


def _amount(w: np.ndarray, v: np.ndarray) -> float:
    """How much a joint turns, or slides if it does not turn, per unit of its reading."""
    turns = float(np.linalg.norm(w))
    return turns if turns > 0 else float(np.linalg.norm(v))
