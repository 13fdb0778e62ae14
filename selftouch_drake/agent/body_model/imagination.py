"""Plans from imagination: ways over the skin that a body model knows, lifted to the joints.

With a body model the agent can imagine where a posture touches. So a motion from one sensation to
another is a short way over the imagined skin, and inverse kinematics: it keeps contact before
anybody followed it. The model assumes rigid links on joints that turn or slide; plans are imagined
on those parts alone where held-out touches agree with it.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.asking import kernel_of_rows
from selftouch_drake.agent.body_model.hands import Hand
from selftouch_drake.agent.body_model.lift import Lifter, SkinWay
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.own_parts import OwnParts
from selftouch_drake.agent.body_model.roadmap import Roadmap
from selftouch_drake.agent.body_model.surface import TouchedSurface, evenly, touched_surfaces
from selftouch_drake.agent.body_model.taut import pulled_taut
from selftouch_drake.agent.motions import NO_KERNEL, Plan, steps
from selftouch_drake.agent.planning.prediction import Prediction
from selftouch_drake.agent.representation.quotient import NO_MODE, QuotientRepresentation
from selftouch_drake.quotient.firm import surely_felt
from selftouch_drake.quotient.plan import Limits
from selftouch_drake.quotient.smooth import path_length, smooth_path

# Knots of a way over the skin, and samples between two of them for the path.
_KNOTS, _BETWEEN = 50, 4
# Knots at the start that do not count: a light touch becomes firm there.
_BEGUN = 3
# Postures of the goal from which motions are begun, and those that are made smooth, until one is
# good, if one of them keeps contact; else all are.
_GOALS, _TRIED = 10, 5
# Places at which a motion may end, and touches about each that tell what is felt there.
_PLACES, _AMONG = 60, 20
# A motion that is farther from its way across the skin than this may lose it; one of that much
# more counts as so many mu longer.
_MISSED, _WORSE = 0.1, 200.0
# Rounds in which a hand of several points settles in the skin, and how much higher than in touches
# in like poses it may be, in distances of kernels.
_SETTLED, _HIGH = 3, 0.1
# A rough motion that is farther from it is not made smooth: it stays as far.
_HOPELESS = 0.5
# Own parts come no nearer to their limit than the first, in distances of kernels; a motion on which
# they come as near as the second is made smooth once more, so that they keep away.
_MARGIN, _NEAR = 0.1, 0.2
# If they are then still in each other, but by less, they are driven farther apart by as much.
_SLIGHTLY = 0.1
# Parts that are in each other deeper than ever by one distance of kernels count as so many mu.
_WORSE_DEEP = 50.0
# What is pressed beside the goal counts as so many mu.
_WORSE_BESIDE = 5.0
# Detours through the air that are tried: of so many past postures, those that lengthen them least;
# and samples of each.
_DETOURS, _PAST_POSTURES, _AIR_SAMPLES = 40, 2000, 40
# mu between knots of a way through touches, and most of these; rounds that ease it.
_SHORT, _MOST_KNOTS, _EASED = 0.2, 150, 10
# Touches that tell what a place feels like, how far each counts, in distances of kernels, and the
# least scale of an expected error.
_ALIKE, _BLUR, _LEAST_SPREAD = 12, 0.1, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leg:
    """A stretch of an imagined plan: T knots.

    Attributes:
        x: `(T, J)` scaled postures.
        node: `(T,)` the target sensation at each; `NO_KERNEL` where nothing is felt.
        in_air: whether the touch is lost on purpose.
        error: the farthest that the toucher is from its way across the skin, beyond the first
            knots, from its end, or beyond an edge of what is known of the skin, in distances of
            kernels; 0 in the air.
        deep: how much deeper than ever own parts are in each other on it, in distances of kernels;
            0 if they are not.
        beside: whether something else is pressed at its end.
        by_hand: whether a hand of several points slides, which is known but roughly.
    """

    x: np.ndarray
    node: np.ndarray
    in_air: bool = False
    error: float = 0.0
    deep: float = 0.0
    beside: bool = False
    by_hand: bool = False

    @property
    def doubts(self) -> tuple[str, ...]:
        """What may go wrong on it, as the agent imagines."""
        may_be = {
            "contact may be lost": self.error > _MISSED,
            "own parts may run into each other": self.deep > 0.0,
            "something else may be felt beside the goal": self.beside,
            "a hand that is no point may be too deep, or too high": self.by_hand,
        }
        return tuple(what for what, is_likely in may_be.items() if is_likely)

    @property
    def good(self) -> bool:
        """Whether it keeps contact, own parts apart and feels its goal, as the agent imagines."""
        return self.error <= _MISSED and self.deep <= 0.0 and not self.beside

    @property
    def cost(self) -> float:
        """Length of the motion in mu, and more where it may lose contact or run into own parts."""
        worse = _WORSE_DEEP * self.deep + _WORSE_BESIDE * self.beside
        return _cost(self.x, self.error) + worse


class Imagination:
    """Plans over the skin that a body model knows; build it once and use it for many plans.

    Args:
        model: accepted for one part at least.
        representation: what was learned.
        knot_spacing: as of `Planner`.
        kernel_sensation: `(R, S)` unit L2 norm, the sensation at each stored touch; without it
            nothing is predicted.

    Attributes:
        surfaces: what each toucher knows of each part.
        own_parts: how deep parts may be in each other.
    """

    def __init__(
        self,
        model: BodyModel,
        representation: QuotientRepresentation,
        *,
        knot_spacing: float,
        kernel_sensation: csr_array | None = None,
    ) -> None:
        self.model = model
        self.representation = representation
        self._kernel_sensation = kernel_sensation
        self.surfaces = touched_surfaces(model, representation)
        self.own_parts = OwnParts.of(model, representation, self.surfaces)
        self._knot_spacing = knot_spacing
        self._kernel = kernel_of_rows(representation)
        self._range = representation.kernel_q.min(axis=0), representation.kernel_q.max(axis=0)
        self._roadmaps: dict[int, Roadmap] = {}
        self._known_hands: dict[tuple[int, int], Hand | None] = {}

    def plan(
        self,
        q_start: np.ndarray,
        here: int | None,
        goals: Sequence[int],
        *,
        pressure: float = 0.0,
        apart: float = 0.0,
        limits: Limits | None = None,
    ) -> Plan | None:
        """Plans a motion as `Planner.plan` does; None where the model knows no good way.

        Args:
            q_start: `(J,)` positions of the joints at the start, in the robot's units.
            here: the target sensation felt at the start; None if nothing is felt.
            goals: the target sensations to feel, in order.
            pressure: how much deeper than firm touches it presses, in distances of kernels.
            apart: how much farther than in past postures own parts stay from each other, likewise.
            limits: the motion stays within them; by default within the range of experience.
        """
        if apart > self.own_parts.apart:
            careful = copy(self)
            careful.own_parts = replace(self.own_parts, apart=apart)
            return careful.plan(q_start, here, goals, pressure=pressure, apart=apart, limits=limits)
        x = self.representation.scaled(q_start)
        lower, upper = (self.representation.scaled(limit) for limit in limits or self._range)
        lower, upper = np.minimum(lower, x), np.maximum(upper, x)
        skins = [
            replace(self._lifter(surface), lower=lower, upper=upper, pressure=pressure)
            for surface in self.surfaces
        ]
        legs = list[Leg]()
        for goal in goals:
            if goal == here:
                continue
            found = self._legs(skins, x, here, goal)
            if found is None:
                return None
            legs += found
            x, here = found[-1].x[-1], goal
        return self._through(q_start, legs, (lower, upper)) if legs else None

    @property
    def feels(self) -> bool:
        """Whether it can say what a posture feels like."""
        return self._kernel_sensation is not None

    def predict(self, plan: Plan, s: np.ndarray) -> Prediction:
        """The sensation expected along an imagined plan: that of touches at the same places.

        Places tell how deep a touch is as well.

        Args:
            plan: that it made.
            s: `(T,)` path lengths, mu.
        """
        if self._kernel_sensation is None:
            raise ValueError("kernel_sensation is missing: it says what touches feel like")
        num = len(s)
        x = self.representation.scaled(plan.path(s))
        part = self.model.kernel_part[plan.nodes[1:]][steps(plan.waypoint_s, s)]
        nearest = np.full(num, np.inf)
        rows, far = np.zeros((num, _ALIKE), dtype=int), np.ones((num, _ALIKE))
        for surface in self.surfaces:
            here = np.flatnonzero(plan.touching(s) & (part == surface.reach.part))
            if not len(here):
                continue
            at = self._lifter(surface).centres(x[here])
            off, near = surface.touches.query(at, k=_ALIKE)
            better = off[:, 0] < nearest[here]
            here = here[better]
            nearest[here] = off[better, 0]
            rows[here], far[here] = surface.row[near[better]], off[better] / surface.spacing
        weight = np.exp(-0.5 * np.square(far / (_BLUR + far[:, :1])))
        weight[~np.isfinite(nearest)] = 0.0
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        mixing = csr_array(
            (weight.ravel(), rows.ravel(), np.arange(0, rows.size + 1, _ALIKE)),
            shape=(num, self._kernel_sensation.shape[0]),
        )
        mean = (mixing @ self._kernel_sensation).toarray()
        size = np.linalg.norm(mean, axis=1)
        # Touches that disagree tell how sure it is.
        spread = np.where(size > 0, 1.0 - size, 0.0) + _LEAST_SPREAD
        return Prediction(
            sensation=mean / np.where(size > 0, size, 1.0)[:, None],
            spread=spread,
        )

    def _legs(
        self, skins: Sequence[Lifter], x: np.ndarray, here: int | None, goal: int
    ) -> list[Leg] | None:
        """From a posture to a goal: over the skin, or through the air and then over the skin."""
        part = self.model.kernel_part[goal]
        skins = [skin for skin in skins if skin.reach.part == part]
        touching = [skin for skin in skins if here is not None and skin.touches(x)]
        best = _best([self._slide_of_one(hand, x, goal) for hand in self._of_each_hand(touching)])
        if best is not None and best.good:
            return [best]
        ways = [] if best is None else [[best]]
        for hand in self._of_each_hand(skins):
            # Of a hand's points the one that knows the goal best.
            skin = max(hand, key=lambda one: len(self._ends(one.surface, goal)))
            ends = self._ends(skin.surface, goal)
            if not len(ends):
                continue
            holding = any(_hold_still(skin, other) for other in touching)
            # Down to the nearest firm touch and over the skin from there, else to the goal itself.
            for rows in (np.flatnonzero(skin.surface.firm), ends):
                landing = self._landing(skin, x, here, rows, holding=holding)
                if landing[-1].node[-1] == goal:
                    ways.append(landing)
                    break
                if ways and (landing[-1].x[-1] == x).all():
                    continue  # it lands where it is, from where it slid
                best = _best([self._slide(skin, landing[-1].x[-1], goal)])
                if best is not None:
                    ways.append([*landing, best])
                    break
        return min(ways, key=lambda legs: sum(leg.cost for leg in legs), default=None)

    def _of_each_hand(self, skins: Sequence[Lifter]) -> list[list[Lifter]]:
        """The points of each hand together."""
        of_toucher, hands = self.model.hand_of_toucher, dict[int, list[Lifter]]()
        for skin in skins:
            hands.setdefault(int(of_toucher[skin.reach.toucher]), []).append(skin)
        return list(hands.values())

    def _slide_of_one(self, hand: Sequence[Lifter], x: np.ndarray, goal: int) -> Leg | None:
        """The first good motion of a point of a hand, the deepest first, else the best one."""
        legs = list[Leg | None]()
        for skin in sorted(hand, key=lambda one: one.above(x)):
            legs.append(self._slide(skin, x, goal))
            if legs[-1] is not None and legs[-1].good:
                break
        return _best(legs)

    def _landing(
        self, skin: Lifter, x: np.ndarray, here: int | None, rows: np.ndarray, *, holding: bool
    ) -> list[Leg]:
        """Straight to the nearest of some touches, of which `rows` are those of the surface.

        If other joints make the touch that is felt, they may hold still until the new one is made;
        then they leave.
        """
        joints, stored = skin.reach.joints, skin.surface.row[rows]
        x_rows = self._x(stored)
        row = int(np.square(x_rows - x).sum(axis=1).argmin())
        kernel = int(self._kernel[stored[row]])
        start = NO_KERNEL if here is None else here
        landed = x_rows[row]
        if not holding:
            return [self._through_air(x, landed, start, kernel)]
        both = x.copy()
        both[joints] = landed[joints]
        return [
            Leg(x=np.stack([x, both]), node=np.array([start, kernel])),
            Leg(x=np.stack([both, landed]), node=np.array([kernel, kernel])),
        ]

    def _through_air(self, x: np.ndarray, landed: np.ndarray, start: int, kernel: int) -> Leg:
        """Straight through the air, or by way of a past posture if own parts are in the way."""

        def leg(*via: np.ndarray) -> Leg:
            knots = np.stack([x, *via, landed])
            node = np.array([start, *[kernel] * len(via), kernel])
            deep = self._deep(evenly(dense(knots), _AIR_SAMPLES))
            return Leg(x=knots, node=node, in_air=True, deep=deep)

        straight = leg()
        if straight.good:
            return straight
        every = max(1, self.representation.num_rows // _PAST_POSTURES)
        past = self._x(np.arange(0, self.representation.num_rows, every))
        longer = np.linalg.norm(past - x, axis=1) + np.linalg.norm(past - landed, axis=1)
        vias = past[np.argsort(longer, kind="stable")[:_DETOURS]]
        return min([straight, *map(leg, vias)], key=lambda one: one.cost)

    def _slide(self, skin: Lifter, x: np.ndarray, goal: int) -> Leg | None:
        """The best motion of one toucher over the skin to a goal; None if there is no way."""
        surface, joints = skin.surface, skin.reach.joints
        ends = self._ends(surface, goal)
        if not len(ends):
            return None
        hand = self._hand(skin)
        if hand is not None:
            return self._slide_of_hand(hand, skin, x, ends, goal)
        start = surface.projected(skin.centres(x[None]))[0][0]
        place = surface.way(start, self._goal_place(surface, ends, goal), _KNOTS)
        if place is None:
            return None
        way = skin.over(place)
        lived = self._x(surface.row[ends])
        near = lived.copy()
        near[:, np.delete(np.arange(len(x)), joints)] = np.delete(x, joints)
        near = near[np.argsort(np.linalg.norm(near - x, axis=1), kind="stable")[:_GOALS]]
        lived = lived[np.argsort(np.linalg.norm(lived - x, axis=1), kind="stable")[:_GOALS]]
        rough = np.concatenate([skin.blended(x, near, way), skin.followed(x, way)[None]])
        found = self._best_smooth(skin, rough, way, goal)
        if found[0].beside:
            # Something else is felt beside the goal: all joints go where they were when it was not.
            found += self._best_smooth(skin, skin.blended(x, lived, way), way, goal)
        best = min(found, key=lambda leg: leg.cost)
        if not best.good:
            about = self._round_about(skin, x, near, place[-1], goal)
            if about is not None and about.cost < best.cost:
                return about
        return best

    def _slide_of_hand(
        self, hand: Hand, skin: Lifter, x: np.ndarray, ends: np.ndarray, goal: int
    ) -> Leg | None:
        """As `_slide`, by one point of a hand of several: to postures in which the goal was felt.

        On the way the hand settles in the skin as in touches in like poses.
        """
        surface, spacing = skin.surface, skin.surface.spacing
        lived = self._x(surface.row[ends])
        nearest = np.argsort(np.linalg.norm(lived - x, axis=1), kind="stable")[:_TRIED]
        first = surface.projected(skin.centres(x[None]))[0][0]
        found = list[Leg]()
        for end in nearest.tolist():
            place = surface.way(first, surface.place[ends[end]], _KNOTS)
            if place is None:
                continue
            way = skin.over(place)
            rough = skin.blended(x, lived[end][None], way)[0]
            rough[-1] = lived[end]
            smooth = skin.smoothed(rough, way, held=True)
            for _ in range(_SETTLED):
                way = way.higher(-spacing * (hand.above(smooth)[0] + skin.pressure))
                smooth = skin.smoothed(smooth, way, held=True)
            near = self._near(smooth)
            if near is not None:
                smooth = skin.smoothed(smooth, way, near, held=True)
            high, above_deep = hand.above(dense(smooth)[_BEGUN * _BETWEEN :])
            leg = Leg(
                x=smooth,
                node=_felt_on(skin, smooth, goal),
                error=max(0.0, high.max() - _HIGH),
                deep=max(self._deep(smooth), -above_deep.min() - skin.pressure),
                by_hand=True,
            )
            if leg.good:
                return leg
            found.append(leg)
        return min(found, key=lambda leg: leg.cost, default=None)

    def _best_smooth(self, skin: Lifter, rough: np.ndarray, way: SkinWay, goal: int) -> list[Leg]:
        """Some of `(n, T, J)` rough motions made smooth, the best first."""
        missed = _missed(skin, rough, way)
        order = np.argsort([_cost(*one) for one in zip(rough, missed, strict=True)])
        found = list[Leg]()
        for number in order:
            if found and missed[number] > _HOPELESS:
                break
            found.append(self._smooth(skin, rough[number], way, goal))
            keeps = len(found) >= _TRIED and any(leg.error <= _MISSED for leg in found)
            if keeps or found[-1].good:
                break
        return sorted(found, key=lambda leg: leg.cost)

    def _round_about(
        self, skin: Lifter, x: np.ndarray, goals: np.ndarray, end: np.ndarray, goal: int
    ) -> Leg | None:
        """A motion through firm touches, where the straight way asks too much of the joints.

        Touches of the goal that are cheap to reach may be at its border: it is led to its end.
        """
        most = _most_deep(self._excess(x[None]))

        def too_deep(x: np.ndarray) -> np.ndarray:
            return self._excess(x) > most

        passed = self._roadmap(skin.surface).way(x, goals, too_deep)
        if passed is None:
            return None
        way, loose = _evenly_over(skin, passed, eased=_EASED)
        # Where the joints turn fast it needs more knots.
        over, taut = _evenly_over(skin, pulled_taut(skin, loose, end))
        leg = self._smooth(skin, taut, over.ending(end), goal)
        if leg.good:
            return leg
        return min(leg, self._smooth(skin, loose, way.ending(end), goal), key=lambda leg: leg.cost)

    def _smooth(self, skin: Lifter, rough: np.ndarray, way: SkinWay, goal: int) -> Leg:
        """A rough motion `(T, J)` made smooth, and own parts kept apart where they would meet."""
        x = skin.smoothed(rough, way)
        near = self._near(x)
        if near is None:
            return self._leg(skin, x, way, goal)
        leg = self._leg(skin, skin.smoothed(x, way, near), way, goal)
        if 0.0 < leg.deep < _SLIGHTLY:
            apart = replace(near, apart=near.apart + _SLIGHTLY)
            leg = self._leg(skin, skin.smoothed(leg.x, way, apart), way, goal)
        return leg

    def _leg(self, skin: Lifter, x: np.ndarray, way: SkinWay, goal: int) -> Leg:
        """A motion `(T, J)` over the skin, and what may go wrong on it."""
        beside = any(
            self._lifter(other).presses(x[-1])
            for other in self.surfaces
            if (other.reach.part, other.reach.toucher) != (skin.reach.part, skin.reach.toucher)
        )
        return Leg(
            x=x,
            node=_felt_on(skin, x, goal),
            error=max(float(_missed(skin, x[None], way)[0]), _beyond(skin, x)),
            deep=self._deep(x),
            beside=beside,
        )

    def _deep(self, x: np.ndarray) -> float:
        """How much deeper than they may own parts are in each other in a motion `(n, J)`."""
        excess = self._excess(x)
        return max(0.0, float(excess.max()) - _most_deep(excess))

    def _excess(self, x: np.ndarray) -> np.ndarray:
        """As of `OwnParts.excess`, in scaled postures `(n, J)`."""
        return self.own_parts.excess(x / self.representation.joint_scale)

    def _near(self, x: np.ndarray) -> OwnParts | None:
        """Own parts that come near each other on a motion `(n, J)`; None if none comes too near."""
        q = x / self.representation.joint_scale
        near = self.own_parts.near(q)
        return near if near.excess(q).max() > -_NEAR else None

    def _lifter(self, surface: TouchedSurface) -> Lifter:
        """The lifter of a surface within the range of experience."""
        lower, upper = (self.representation.scaled(limit) for limit in self._range)
        scale = self.representation.joint_scale
        return Lifter(surface=surface, scale=scale, lower=lower, upper=upper)

    def _hand(self, skin: Lifter) -> Hand | None:
        """The hand of a toucher on a part, if it has several points there."""
        of_toucher, part = self.model.hand_of_toucher, skin.reach.part
        hand = int(of_toucher[skin.reach.toucher])
        if (part, hand) not in self._known_hands:
            own = [
                surface
                for surface in self.surfaces
                if surface.reach.part == part and of_toucher[surface.reach.toucher] == hand
            ]
            found = None
            if len(own) > 1:
                rows = np.sort(np.concatenate([surface.row for surface in own]))
                strength = self.representation.kernel_strength[rows]
                found = Hand([self._lifter(surface) for surface in own], self._x(rows), strength)
            self._known_hands[part, hand] = found
        return self._known_hands[part, hand]

    def _roadmap(self, surface: TouchedSurface) -> Roadmap:
        """The roadmap of a surface, made when it is first needed."""
        number = self.surfaces.index(surface)
        if number not in self._roadmaps:
            random = np.random.default_rng(self.model.seed)
            firm = self._x(surface.row[surface.firm])
            self._roadmaps[number] = Roadmap(self._lifter(surface), firm, random)
        return self._roadmaps[number]

    def _goal_place(self, surface: TouchedSurface, ends: np.ndarray, goal: int) -> np.ndarray:
        """`(3,)` where on the surface the goal is felt most surely: most touches about are its own.

        Args:
            surface: of the toucher.
            ends: touches of the surface at which motions may end.
            goal: the target sensation.
        """
        own = surface.place[ends[:: max(1, len(ends) // _PLACES)]]
        some = np.concatenate([np.median(surface.place[ends], axis=0, keepdims=True), own])
        some = surface.projected(some)[0]
        near = surface.touches.query(some, k=min(_AMONG, len(surface.place)))[1]
        surest = (self._kernel[surface.row[near]] == goal).mean(axis=1).argmax()
        return some[surest]

    def _ends(self, surface: TouchedSurface, goal: int) -> np.ndarray:
        """Touches of the surface, by number, at which motions to a goal end."""
        numbers = np.flatnonzero(self._kernel[surface.row] == goal)
        if not len(numbers):
            return numbers
        rows = surface.row[numbers]
        error, strength = self.representation.kernel_error, self.representation.kernel_strength
        return numbers[surely_felt(error[rows], strength[rows])]

    def _x(self, rows: np.ndarray) -> np.ndarray:
        """`(n, J)` scaled stored configurations."""
        return self.representation.scaled(self.representation.kernel_q[rows]).astype(float)

    def _through(
        self, q_start: np.ndarray, legs: Sequence[Leg], limits: tuple[np.ndarray, np.ndarray]
    ) -> Plan:
        """The smooth plan through all legs; each target sensation on them is one waypoint."""
        scale = self.representation.joint_scale
        x, node, at, in_air = [legs[0].x[:1]], [int(legs[0].node[0])], [0], list[bool]()
        for leg in legs:
            count = sum(map(len, x)) - 1
            x.append(np.clip(dense(leg.x), *limits)[1:])
            for row in _stretches(leg.node):
                node.append(int(leg.node[row]))
                at.append(count + _BETWEEN * row)
                in_air.append(leg.in_air)
        passed = np.concatenate(x)
        path = smooth_path(passed, knot_spacing=self._knot_spacing, limits=limits)
        path.c = path.c / scale
        waypoints_q = passed[at] / scale
        waypoints_q[0] = path.c[0] = q_start
        imagined = np.ones(len(node), dtype=bool)
        imagined[[0, -1]] = False
        return Plan(
            nodes=np.array(node),
            links=np.full(len(in_air), -1),
            in_air=np.array(in_air),
            modes=np.full(len(in_air), NO_MODE),
            imagined=imagined,
            waypoints_q=waypoints_q,
            waypoint_s=path_length(passed)[at],
            path=path,
            doubts=tuple(dict.fromkeys(doubt for leg in legs for doubt in leg.doubts)),
        )


def _evenly_over(skin: Lifter, x: np.ndarray, *, eased: int = 0) -> tuple[SkinWay, np.ndarray]:
    """A motion `(n, J)` over the skin, with knots at equal distances on it and in the joints.

    Args:
        skin: the toucher and the skin.
        x: the motion.
        eased: rounds in which each knot moves towards its neighbours.

    Returns:
        Its way over the skin, and `(T, J)` the motion, put onto it.
    """
    surface, joints = skin.surface, skin.reach.joints
    place = surface.projected(skin.centres(x))[0]
    keys = np.concatenate([place / surface.spacing, x[:, joints]], axis=1)
    length = np.linalg.norm(np.diff(keys, axis=0), axis=1).sum()
    keys = evenly(keys, int(np.clip(length / _SHORT, _KNOTS, _MOST_KNOTS)))
    for _ in range(eased):
        keys[1:-1] = 0.5 * keys[1:-1] + 0.25 * (keys[:-2] + keys[2:])
    way = skin.over(surface.projected(keys[:, :3] * surface.spacing)[0])
    put = np.repeat(x[:1], len(keys), axis=0)
    put[1:, joints] = keys[1:, 3:]
    put[1:] = skin.put(put[1:], way.place[1:], way.normal[1:])
    return way, put


def _most_deep(excess: np.ndarray) -> float:
    """How deep own parts may be on a motion: as in its first posture, which is given."""
    return max(float(excess[0]), -_MARGIN)


def _felt_on(skin: Lifter, x: np.ndarray, goal: int) -> np.ndarray:
    """`(T,)` the target sensation at each posture of a motion `(T, J)` over the skin to a goal."""
    node = skin.surface.kernel_at(skin.centres(x))
    node[-1] = goal
    return node


def _missed(skin: Lifter, x: np.ndarray, way: SkinWay) -> np.ndarray:
    """`(n,)` how far motions `(n, T, J)` are from their way, as `Leg.error` says."""
    # Between knots as well: a wrist that turns over there leaves the skin.
    place, normal, x = dense(way.place), dense(way.normal), dense(x)
    at = skin.places(x.reshape(-1, x.shape[-1]), np.tile(normal, (len(x), 1)))[0]
    off = at.reshape(*x.shape[:2], 3) - place
    across = np.abs(np.einsum("nta,ta->nt", off, normal))[:, _BEGUN * _BETWEEN :]
    end = np.linalg.norm(off[:, -1], axis=1)
    return np.maximum(across.max(axis=1), end) / skin.surface.spacing


def _beyond(skin: Lifter, x: np.ndarray) -> float:
    """How far a motion `(T, J)` leads beyond the skin that is known, in distances of kernels."""
    at = skin.centres(dense(x)[_BEGUN * _BETWEEN :])
    return float(skin.surface.beyond(at).max())


def _cost(x: np.ndarray, error: float) -> float:
    """Length of a motion in mu, and more where it may lose contact."""
    return float(path_length(x)[-1]) + _WORSE * max(0.0, error - _MISSED)


def dense(knots: np.ndarray) -> np.ndarray:
    """`(…, n, D)` samples of smooth curves through `(…, T, D)` knots, `_BETWEEN` for each step."""
    samples = _between(knots.shape[-2]) @ knots
    samples[..., ::_BETWEEN, :] = knots
    return samples


@lru_cache(maxsize=64)
def _between(num: int) -> np.ndarray:
    """`(n, T)` how much each of so many knots counts for each sample of the curve through them."""
    number = np.arange(num, dtype=float)
    at = np.linspace(0.0, number[-1], _BETWEEN * (num - 1) + 1)
    return CubicSpline(number, np.eye(num))(at)


def _hold_still(skin: Lifter, other: Lifter) -> bool:
    """Whether a touch can be made while another one lasts: they have no joint in common."""
    return not np.isin(skin.reach.joints, other.reach.joints).any()


def _best(legs: Sequence[Leg | None]) -> Leg | None:
    """The best of some motions, if it keeps to its way."""
    good = [leg for leg in legs if leg is not None and leg.error <= _MISSED]
    return min(good, key=lambda leg: leg.cost, default=None)


def _stretches(node: np.ndarray) -> list[int]:
    """The middle of each stretch of one target sensation beyond the first, and the last knot."""
    starts = np.flatnonzero(np.diff(node)) + 1
    ends = np.append(starts[1:], len(node))
    middles = ((starts + ends - 1) // 2).tolist()
    return [*middles[:-1], len(node) - 1]
