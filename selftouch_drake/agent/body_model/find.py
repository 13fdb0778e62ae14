"""Finds the body: joints, their order, touchers and skin, from configurations and their labels."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model import few, grow, structure
from selftouch_drake.agent.body_model.alike import Alike
from selftouch_drake.agent.body_model.assemble import Found, assembled, normalizing
from selftouch_drake.agent.body_model.blunt import for_all, with_more_points
from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.density import limbs
from selftouch_drake.agent.body_model.fit import Bodies, Each, Group
from selftouch_drake.agent.body_model.forest import Mechanism
from selftouch_drake.agent.body_model.judge import (
    ACCEPTED,
    ACCEPTED_BY_SEVERAL,
    ACCEPTED_OF_PROVED,
    ACCEPTED_OF_PROVED_BY_SEVERAL,
    CHOICE,
    VERDICT,
    Judgement,
    Sample,
    held_out,
    judged,
)
from selftouch_drake.agent.body_model.model import BodyModel, JointKind, rejected
from selftouch_drake.agent.body_model.one_limb import Moved, moved_together, of_limbs
from selftouch_drake.agent.body_model.planes import in_a_plane
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import (
    Scene,
    Solution,
    kernel_sums,
    solution_places,
)
from selftouch_drake.agent.body_model.several_limbs import MOST as MOST_OF_SEVERAL
from selftouch_drake.agent.body_model.several_limbs import neighbourhoods_of_parts, of_several_limbs
from selftouch_drake.agent.body_model.sizes import carried_over, with_sizes
from selftouch_drake.agent.body_model.standard_errors import covariance
from selftouch_drake.agent.body_model.standard_readings import StandardReadings
from selftouch_drake.agent.body_model.structure import (
    Search,
    found_chains,
    pair_statistic,
    swap_costs,
)
from selftouch_drake.agent.body_model.torn_parts import torn_apart
from selftouch_drake.agent.body_model.touchers import with_more
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.untold_orders import untold_neighbours
from selftouch_drake.agent.body_model.who_touched import settled, started

# Touches that a search and a finish look at: more give nothing but time. A cube's places have an
# error of 0.597 % with 30,000 touches and of 0.588 with 100,000.
_SEARCHED, _REFINED = 25_000, 40_000
# Touchers on one link, at most.
_MOST_TOUCHERS = 4
# Points of a hand that is no point, once the tree stands.
_POINTS = 8
# Neighbours may change places if that costs less.
_SWAPS = 0.02
# Chains that began apart and whose criteria differ by less agree.
_SAME = 0.1
# Chains that explain no more than this share of the touches do not end the search, agree or not:
# of twelve searches in a recording of seven joints three had ended so, before the right chain. A
# search is made so often at most if it finds nothing else.
_MOSTLY, _SEARCHES = 0.5, 2
# Searches for limbs that moved one at a time, while parts are left over: one of two may be wrong.
_ANEW = 2
# Few touches get labels of so many that feel alike: growing counts touches of labels, and the
# finish is the sharper the fewer there are.
_TO_GROW, _TO_FINISH = 8, 5
# Above this share of inliers one limb made all touches.
_ONE_LIMB = 0.9
# A flat chain is taken unless it explains less than the same chain in space, by this share.
_FLATTER = 0.01
# More touchers are tried where a single one explains at least this share of held-out touches.
_HOPE = 0.2
# Above this share of inliers there is no other toucher to look for.
_ALL = 0.97
# With more moving joints than this, several hands are looked for before a single chain.
_MANY = 16
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
    sequence: np.ndarray | None = None,
    along: int = 0,
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
        sequence: `(R,)` numbers that rise from touch to touch; their order by default.
        along: the last so many of the J say where on its skin a hand was met: of another unit.
        seed: of all randomness.
        progress: called with the fraction done, 0 to 1, and what is done.
        each: maps a function over items, in threads for instance; the model does not depend on it.

    Returns:
        The body model, with its judgement: rejected where held-out touches do not agree.
    """
    touches = StandardTouches.of(q, target, part, double)

    def none(reason: str) -> BodyModel:
        return rejected(
            reason,
            joint_names=joint_names,
            kernel_part=np.asarray(part),
            num_rows=len(q),
            num_receptors=0 if sensation is None else sensation.shape[1],
            seed=seed,
        )

    def model_of(found: Found) -> BodyModel:
        tick.say(0.97, "skin")
        model = assembled(found, joint_names=joint_names, num_rows=len(q), sensation=sensation)
        tick.say(1.0, "judged")
        return model

    number = len(touches.rows)
    few_enough = sensation is not None and number <= few.MOST and len(set(part[target])) == 1
    least = few.FEWEST if few_enough else structure.FEWEST
    if number < least or len(touches.moving) == 0:
        return none(
            f"{number} touches of {len(touches.moving)} moving joints are too few to look for a "
            f"body ({least} needed)."
        )
    tick = _Ticks(progress)
    unit = touches.scale.copy()
    unit[len(unit) - along :] = np.nan
    felt = None if sensation is None else csr_array(sensation)[touches.rows]
    random = np.random.default_rng(seed)
    search = Search(touches.single(), random, each, tick, unit, felt)
    if felt is not None and number <= few.MOST:
        when = touches.when(sequence)
        moved = moved_together(touches.q[when])
        if len(moved.sets) > 1:
            moved = moved.at(when)
            found = _find_by_limbs(search, touches, felt, moved, seed)
            if found is None:
                return none("No part has enough touches of two limbs, each moved alone.")
            return model_of(found)
    found = None
    if few_enough and felt is not None:
        found = _find_by_sensation(search, touches, felt, seed)
    if felt is not None and number <= MOST_OF_SEVERAL and not _any_accepted(found):
        found = _find_several_limbs(search, touches, felt, seed) or found
    if found is None:
        found = _find(search, touches, seed)
    if found is None:
        return none("No chain of joints explains the touches.")
    return model_of(found)


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
class StandardTouches:
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
    def of(q, target, part, double) -> "StandardTouches":
        """Leaves out double touches and what is not finite, and standardises."""
        q, target = np.asarray(q, dtype=float), np.asarray(target)
        kept = np.isfinite(q).all(axis=1)
        if double is not None:
            kept &= ~np.asarray(double, dtype=bool)
        rows = np.flatnonzero(kept)
        q, target = q[rows], target[rows]
        if len(rows) == 0:
            width = q.shape[1]
            return StandardTouches(
                q, target, np.asarray(part), rows, np.zeros(width), np.ones(width), []
            )
        standard, center, scale, moving = StandardReadings.of(q)
        return StandardTouches(standard, target, np.asarray(part), rows, center, scale, moving)

    def when(self, sequence: np.ndarray | None) -> np.ndarray:
        """`(n,)` its touches, one after the other."""
        if sequence is None:
            return np.arange(len(self.rows))
        return np.argsort(np.asarray(sequence)[self.rows], kind="stable")

    def single(self) -> np.ndarray:
        """`(J, n)` float32 readings, as a search wants them."""
        return np.ascontiguousarray(self.q.T.astype(np.float32))

    def scene(self, ways) -> Scene:
        """All of them, with ways."""
        return Scene(self.q, self.target, self.part, ways)


def _find(search: Search, touches: StandardTouches, seed: int) -> Found | None:
    """The body of one part by one hand, or else of any tree."""
    purpose = held_out(touches.q, search.random)
    parts = sorted(set(touches.part[touches.target].tolist()))
    if len(parts) > 1:
        return _grown(search, touches, purpose, seed, hands=False)
    of_part = touches.part[touches.target] == parts[0]
    train, choice = (np.flatnonzero(of_part & (purpose == use)) for use in (0, CHOICE))
    some = np.sort(search.random.permutation(train)[:_SEARCHED])
    group = Group.of(some, touches.target[some])

    def several() -> bool:
        return len(limbs(*pair_statistic(search.q, group, least=20))) > 1

    found, hands_first = None, len(touches.moving) > _MANY and several()
    if hands_first:
        # Hardly any chain is as long, and the search for one takes minutes.
        found = _grown(search, touches, purpose, seed, hands=True)
        if _any_accepted(found):
            return found
    chain = _chain_of_part(search, touches, group, (train, choice), parts[0])
    if chain is None:
        return found if hands_first else _grown(search, touches, purpose, seed, hands=False)
    # One limb has one chain, which has been looked for; and what one chain does not explain of two
    # limbs are outliers.
    verdict = chain.judgement
    rejected_one = not verdict.accepted and not verdict.inliers > _ONE_LIMB
    if rejected_one and not hands_first and several():
        found = _grown(search, touches, purpose, seed, hands=True)
        if _any_accepted(found):
            return found
    return _finished(search, touches, chain, purpose, seed)


def _grown(
    search: Search, touches: StandardTouches, purpose: np.ndarray, seed: int, *, hands: bool
) -> Found | None:
    """The body of any tree; None if no part gives a chain."""
    scene, tested = touches.scene({}), purpose > 0
    body = grow.grown(search, scene, tested, touches.moving, hands=hands)
    if body is None:
        return None
    part, body = torn_apart(body, search, scene, tested, touches.moving)
    return _finished_tree(search, replace(touches, part=part), body, purpose, seed)


def _any_accepted(found: Found | None) -> bool:
    """Whether held-out touches agree on any part."""
    return found is not None and any(one.accepted for one in found.judgements.values())


def _find_by_sensation(
    search: Search, touches: StandardTouches, felt: csr_array, seed: int
) -> Found | None:
    """The body of one part by one toucher, from few touches and what these felt like."""
    chain = few.found_by_sensation(search, touches.q, felt, touches.moving)
    if chain is None:
        return None
    part = int(touches.part[touches.target[0]])
    tree = Tree.chain(chain.order, part, 1)
    whole = touches.scene(tree.ways([(part, 0)]))
    solution = carried_over(whole, started(whole, chain.twists, chain.point[None]))
    # Kernels of few touches lie where the sensations of these say.
    number = np.bincount(touches.target, minlength=len(touches.part))[:, None]
    with np.errstate(invalid="ignore"):
        place = kernel_sums(chain.place, touches.target, len(number)) / number
    return Found(
        tree=tree, scene=whole, rows=touches.rows, solution=replace(solution, place=place),
        center=touches.center, scale=touches.scale, kind=chain.kind,
        order_group=order_groups(chain.order, chain.swaps, len(touches.center)),
        judgements={part: chain.judgement}, seed=seed, spread=chain.spread,
    )  # fmt: skip


def _find_by_limbs(
    search: Search, touches: StandardTouches, felt: csr_array, moved: Moved, seed: int
) -> Found | None:
    """The body of few touches that were made with one limb at a time."""
    part = touches.part[touches.target]

    def of_part() -> Mechanism | None:
        return of_limbs(search, touches.q, felt, part, moved)

    purpose = held_out(touches.q, search.random)
    body = _grown_best(search, touches, of_part, purpose)
    return None if body is None else _finished_tree(search, touches, body, purpose, seed)


def _find_several_limbs(
    search: Search, touches: StandardTouches, felt: csr_array, seed: int
) -> Found | None:
    """The body of few touches, of which nobody says which limb made them."""
    part = touches.part[touches.target]

    def of_part() -> Mechanism | None:
        return of_several_limbs(search, touches.q, felt, part, purpose == 0)

    purpose = held_out(touches.q, search.random)

    def labelled(each: int) -> StandardTouches:
        # Target sensations are finer than so few touches can fill.
        target, of_label = neighbourhoods_of_parts(felt, part, each, search.random)
        return replace(touches, target=target, part=of_label)

    body = _grown_best(search, labelled(_TO_GROW), of_part, purpose, patient=True)
    if body is None:
        return None
    found = _finished_tree(search, labelled(_TO_FINISH), body, purpose, seed)
    # Touches that gave a toucher its surface do not judge.
    judges = purpose > 0 if found.solution.sizes is None else purpose == VERDICT
    verdicts = judge_parts_by_sensation(found.scene, found.solution, felt, judges, search.random)
    # Who touched is known better than kernels of one or two touches could tell.
    whole, known = touches.scene(found.scene.ways), found.solution
    begun = started(whole, known.twists, known.points)
    begun = replace(begun, share=known.share)
    solution = settled(whole, begun, solution_places(whole, begun), fresh_normals=True)
    return replace(found, scene=whole, solution=solution, judgements=verdicts)


def _grown_best(
    search: Search,
    touches: StandardTouches,
    of_part: Callable[[], Mechanism | None],
    purpose: np.ndarray,
    *,
    patient: bool = False,
) -> Mechanism | None:
    """The body that grows best from the chains of all limbs that reach one part.

    Args:
        search: what to work on.
        touches: all of them, in labels.
        of_part: looks for these chains.
        purpose: `(n,)` of each touch, as of `held_out`.
        patient: whether that looked often, so that none are to be found if it found none.
    """
    of_each_part, best = np.bincount(touches.part[touches.target]), None
    number = int((of_each_part >= few.FEWEST).sum())
    for _ in range(_ANEW):
        first = of_part()
        if first is None:
            if patient:
                break
            continue
        body = grow.full(first, search, touches.scene({}), purpose > 0, touches.moving)
        if best is None or len(body.links.part) > len(best.links.part):
            best = body
        if len(best.links.part) >= number:
            break
    return best


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
        fixed: `(n,)` bool, parameters that the fit held: those across the plane of a flat chain.
    """

    part: int
    order: list[int]
    scene: Scene
    solution: Solution
    judgement: Judgement
    swaps: np.ndarray
    fixed: np.ndarray


def _score(judgement: Judgement) -> float:
    """How far held-out touches agree with a chain, 0 to 1."""
    return float(np.nan_to_num(judgement.near * min(1.0, 2 * judgement.inliers)))


def _chain_of_part(
    search: Search,
    touches: StandardTouches,
    group: Group,
    split: tuple[np.ndarray, np.ndarray],
    part: int,
) -> _Chain | None:
    """The best chain of a part: the first one that held-out touches accept, else the best.

    The search ends when two chains that began apart agree: nothing better was missed by chance.
    Chains that leave most touches out do not count, for they share false optima; if there are no
    others, it begins anew.
    """
    if group.num_kernels < 8:
        return None
    best = None
    costs: list[float] = []
    for _ in range(_SEARCHES):
        if costs:
            break
        for body in found_chains(search, group, touches.moving):
            chain = _solved(search, touches, split, body, part)
            cost = float(body.loss.sum())
            if chain.judgement.inliers > _MOSTLY:
                costs.append(cost)
            value = _score(chain.judgement), -cost
            if best is None or value > best[0]:
                best = value, chain, body
            if chain.judgement.accepted or _settled(costs):
                break
    if best is None:
        return None
    _, chain, body = best
    swaps = swap_costs(search, group, body) if chain.judgement.accepted else chain.swaps
    return replace(chain, swaps=swaps)


def _settled(costs: list[float]) -> bool:
    """Whether the two best chains so far, which began apart, reached the same criterion."""
    best = sorted(costs)[:2]
    return len(best) == 2 and best[1] - best[0] < _SAME


def _solved(
    search: Search,
    touches: StandardTouches,
    split: tuple[np.ndarray, np.ndarray],
    body: Bodies,
    part: int,
) -> _Chain:
    """Least squares, further touchers, and the judgement of a chain."""
    train, choice = split
    way = body.ways[0][0]
    all_of_it = touches.scene({(part, 0): way})
    used = np.sort(search.random.permutation(train)[:_REFINED])
    scene, tests = all_of_it.some(used), all_of_it.some(choice)
    solution = refined(scene, started(scene, body.twists[0], body.points[0]), tick=search.tick)
    verdict = judge_part(scene, tests, solution, part)
    fixed = np.zeros(solution.twists.size + 3, dtype=bool)
    flat = in_a_plane(scene, solution)
    if flat is not None:
        of_flat = judge_part(scene, tests, flat[0], part)
        # Without a test of both the general chain stays.
        tested = np.isfinite([of_flat.near, verdict.near]).all()
        if tested and _score(of_flat) > _score(verdict) - _FLATTER:
            (solution, fixed), verdict = flat, of_flat
    # A chain may be that of one finger, and take the touches of another for outliers.
    explains_all = verdict.accepted and verdict.inliers > _ALL
    if not explains_all and not fixed.any() and np.nan_to_num(verdict.near) > _HOPE:
        more, more_tests, grown = with_more(
            scene, tests, solution, part, _MOST_TOUCHERS, search.random
        )
        if len(grown.points) > 1:
            grown = refined(more, grown, tick=search.tick)
            scene, tests, solution = more, more_tests, grown
            verdict = judge_part(scene, tests, solution, part)
            fixed = np.zeros(solution.twists.size + solution.points.size, dtype=bool)
    order = structure.order_of(way)
    swaps = np.full(max(len(order) - 1, 0), np.inf)
    return _Chain(part, order, scene, solution, verdict, swaps, fixed)


def judge_part(
    scene: Scene, tests: Scene, solution: Solution, part: int, *, proved: bool = False
) -> Judgement:
    """The judgement of one part.

    Args:
        scene: training touches.
        tests: held-out touches.
        solution: of the training touches.
        part: which part.
        proved: whether other parts have proved all of its joints.
    """
    touchers = scene.touchers(part)
    joints = np.array(sorted(_joints_to(scene, part)))

    def sample(some: Scene, toucher: np.ndarray) -> Sample:
        rows = some.rows(part)
        there = solution_places(some, solution)[touchers][:, rows]
        return Sample(
            q=some.q[np.ix_(rows, joints)], target=some.target[rows],
            places=there.swapaxes(0, 1), toucher=toucher,
        )  # fmt: skip

    share = solution.share[np.ix_(scene.rows(part), touchers)]
    who = np.where(share.sum(axis=1) >= 0.5, share.argmax(axis=1), -1)
    parameters = 6 * len(joints) + 3 * len(touchers)
    if solution.sizes is not None:
        parameters += solution.sizes.shape.shape[1] * int(solution.sizes.sized[touchers].sum())
    needed = ACCEPTED_OF_PROVED if proved else ACCEPTED
    if scene.blunt:
        needed = ACCEPTED_OF_PROVED_BY_SEVERAL if proved else ACCEPTED_BY_SEVERAL
    return judged(
        sample(scene, who), sample(tests, np.full(len(tests.rows(part)), -1)),
        parameters=0 if proved else parameters, number=len(scene.part),
        needed=needed,
    )  # fmt: skip


def judge_parts(scene: Scene, tests: Scene, solution: Solution) -> dict[int, Judgement]:
    """The judgement of each part; one whose joints others have proved is asked less."""
    verdicts = {part: judge_part(scene, tests, solution, part) for part in scene.parts}
    accepted = [part for part, verdict in verdicts.items() if verdict.accepted]
    proved = set[int]().union(*(_joints_to(scene, part) for part in accepted))
    for part, verdict in verdicts.items():
        if not verdict.accepted and _joints_to(scene, part) <= proved:
            verdicts[part] = judge_part(scene, tests, solution, part, proved=True)
    return verdicts


def judge_parts_by_sensation(
    scene: Scene,
    solution: Solution,
    felt: csr_array,
    tested: np.ndarray,
    random: np.random.Generator,
) -> dict[int, Judgement]:
    """The judgement of each part of a tree that few touches led to, by the rule of few touches.

    Of a part all of whose joints others have proved only the link is open, which hardly any touch
    decides: all of its touches judge it, left out in turn of what says where sensations are. But
    where those that no fit has seen clearly say no, that holds.

    Args:
        scene: all touches.
        solution: of these.
        felt: `(n, S)` readings of the receptors.
        tested: `(n,)` bool, touches that no fit has seen.
        random: where neighbourhoods begin.
    """
    verdicts, proved = dict[int, Judgement](), set[int]()
    everywhere = solution_places(scene, solution)

    def judged_so(part: int, judges: np.ndarray) -> Judgement:
        rows, touchers = scene.rows(part), scene.touchers(part)
        there = everywhere[touchers][:, rows]
        share = solution.share[np.ix_(rows, touchers)]
        own = there[share.argmax(axis=1), np.arange(len(rows))]
        own[share.sum(axis=1) < 0.5] = np.nan
        q = scene.q[np.ix_(rows, np.array(sorted(_joints_to(scene, part))))]
        return few.judged_in_turn(felt[rows], q, own, there, judges[rows], random)

    for part in scene.parts:
        verdicts[part] = judged_so(part, tested)
        if verdicts[part].accepted:
            proved |= _joints_to(scene, part)
    for part, verdict in verdicts.items():
        unsure = not verdict.accepted and not few.clearly_off(verdict)
        if unsure and _joints_to(scene, part) <= proved:
            of_all = judged_so(part, np.ones_like(tested))
            said = f"{of_all.reason}; touches of the fit judged, too, as its joints are proved"
            verdicts[part] = replace(of_all, reason=said)
    return verdicts


def _joints_to(scene: Scene, part: int) -> set[int]:
    """The joints between a part and all of its touchers."""
    return {joint for u in scene.touchers(part) for joint, _ in scene.ways[part, u]}


def _finished(
    search: Search, touches: StandardTouches, chain: _Chain, purpose: np.ndarray, seed: int
) -> Found:
    """Kinds of joints, which of them may change places, and who made each touch of all."""
    solution, kind, fixed = _kinds(search, touches, chain.scene, chain.solution, chain.fixed)
    number = len(touches.center)
    tree = Tree.chain(chain.order, chain.part, len(solution.points))
    whole = touches.scene(chain.scene.ways)
    choice, test = (whole.some(np.flatnonzero(purpose == use)) for use in (CHOICE, VERDICT))
    if not chain.fixed.any():
        # A surface would bulge out of the plane of a flat chain.
        solution = with_sizes(
            chain.scene, choice, solution, search.random, fixed=fixed, tick=search.tick
        )
    verdict = judge_part(chain.scene, test, solution, chain.part)
    groups = order_groups(chain.order, chain.swaps, number)
    final = carried_over(whole, solution)
    return Found(
        tree=tree, scene=whole, rows=touches.rows, solution=final, center=touches.center,
        scale=touches.scale, kind=kind, order_group=groups, judgements={chain.part: verdict},
        seed=seed, spread=covariance(whole, final, fixed=fixed),
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
    search: Search, touches: StandardTouches, scene: Scene, solution: Solution, fixed: np.ndarray
) -> tuple[Solution, np.ndarray, np.ndarray]:
    """Which joints slide, which then do not turn at all; and which parameters are held."""
    used = sorted({joint for way in scene.ways.values() for joint, _ in way})
    kind = np.full(len(touches.center), int(JointKind.UNUSED))
    kind[used] = JointKind.TURNS
    low, high = np.quantile(touches.q, [0.005, 0.995], axis=0)
    turn = np.linalg.norm(solution.twists[:, :3], axis=1) * (high - low)
    for joint in sorted(used, key=lambda joint: turn[joint]):
        if turn[joint] >= few.OPEN:
            continue
        kind[joint] = JointKind.OPEN
        if turn[joint] < few.SLIDES:
            trial_fixed = fixed.copy()
            trial_fixed[6 * joint : 6 * joint + 3] = True
            straight = solution.twists.copy()
            straight[joint, :3] = 0
            trial = started(scene, straight, solution.points)
            trial = refined(scene, trial, fixed=trial_fixed, tick=search.tick)
            cost = np.nanmean(trial.criterion) - np.nanmean(solution.criterion)
            if cost < few.SLIDE_COST:
                kind[joint], solution, fixed = JointKind.SLIDES, trial, trial_fixed
    return solution, kind, fixed


def _finished_tree(
    search: Search,
    touches: StandardTouches,
    body: Mechanism,
    purpose: np.ndarray,
    seed: int,
) -> Found:
    """The bundle of all parts, refined; kinds of joints, judgements, and who made each touch."""
    counts = np.bincount(touches.part[touches.target], minlength=len(touches.part))
    root = body.links.part[max(body.links.part, key=lambda part: counts[part])]
    tree = body.links.rooted(root)
    twists = body.twists.copy()
    twists[body.links.backwards(root)] *= -1
    whole = touches.scene(tree.ways(list(body.pairs)))
    train = search.random.permutation(np.flatnonzero(purpose == 0))[:_REFINED]
    scene = whole.some(np.sort(train))
    choice, tests = (whole.some(np.flatnonzero(purpose == use)) for use in (CHOICE, VERDICT))
    solution = refined(scene, started(scene, twists, body.points), tick=search.tick)
    alike = None
    if scene.blunt:
        alike = Alike.of(search.sensation, touches.target, touches.part)
        tree, scene, solution = _of_finer_hands(search, alike, tree, scene, solution)
        whole, choice, tests = (replace(one, ways=scene.ways) for one in (whole, choice, tests))
    free = np.zeros(solution.twists.size + solution.points.size, dtype=bool)
    solution, kind, fixed = _kinds(search, touches, scene, solution, free)
    if not scene.blunt:
        # Several points of a hand are its surface.
        solution = with_sizes(scene, choice, solution, search.random, fixed=fixed, tick=search.tick)
    if solution.sizes is None:
        # Nothing of a tree of points was chosen by held-out touches: all of them judge it.
        tests = whole.some(np.flatnonzero(purpose > 0))
    verdicts = judge_parts(scene, tests, solution)
    if alike is None:
        final = carried_over(whole, solution)
    else:
        final = alike.without_misplaced(whole, for_all(whole, solution))
    groups = _commuting(tree, adjoint(normalizing(final.place), solution.twists))
    for pair in untold_neighbours(tree, scene, solution, search.random):
        _may_change(groups, *pair)
    return Found(
        tree=tree, scene=whole, rows=touches.rows, solution=final, center=touches.center,
        scale=touches.scale, kind=kind, order_group=groups,
        judgements=verdicts, seed=seed,
        spread=covariance(whole, final, fixed=fixed),
    )  # fmt: skip


def _of_finer_hands(
    search: Search, alike: Alike, tree: Tree, scene: Scene, solution: Solution
) -> tuple[Tree, Scene, Solution]:
    """The tree whose hands have more points, and no kernel far from those that feel like it."""
    solution = alike.mended(scene, solution)
    tree, scene, solution = with_more_points(tree, scene, solution, _POINTS, search.random)
    solution = refined(scene, solution, tick=search.tick)
    if alike.misplaced(solution.place).any():
        solution = refined(scene, alike.mended(scene, solution), tick=search.tick)
    return tree, scene, alike.without_misplaced(scene, solution)


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
            _may_change(groups, joint, above)
    return groups


def _may_change(groups: np.ndarray, joint: int, other: int) -> None:
    """Two joints may change places, with all that either may change with."""
    old = {groups[joint], groups[other]} - {-1}
    group = min(old, default=groups.max() + 1)
    groups[np.isin(groups, list(old))] = group
    groups[[joint, other]] = group


def _amount(w: np.ndarray, v: np.ndarray) -> float:
    """How much a joint turns, or slides if it does not turn, per unit of its reading."""
    turns = float(np.linalg.norm(w))
    return turns if turns > 0 else float(np.linalg.norm(v))
