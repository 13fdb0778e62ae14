"""Plans from imagination: ways over the skin that a body model knows, lifted to the joints.

With a body model the agent can imagine where a posture touches. So a motion from one sensation to
another is a short way over the imagined skin, and inverse kinematics; nobody has to follow it to
know that it keeps contact. The model assumes rigid links on joints that turn or slide, and plans
are made only on parts where held-out touches agree with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from selftouch_drake.agent.body_model.lift import Lifter, SkinWay
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.roadmap import Roadmap
from selftouch_drake.agent.body_model.surface import TouchedSurface, evenly, touched_surfaces
from selftouch_drake.agent.motions import NO_KERNEL, Plan
from selftouch_drake.agent.representation.quotient import NO_MODE, QuotientRepresentation
from selftouch_drake.quotient.firm import surely_felt
from selftouch_drake.quotient.plan import Limits
from selftouch_drake.quotient.smooth import path_length, smooth_path

# Knots of a way over the skin, and samples between two of them for the path.
_KNOTS, _BETWEEN = 50, 4
# Knots at the start that do not count: a light touch becomes firm there.
_BEGUN = 3
# Postures of the goal from which motions are tried, and motions of these that are smoothed.
_GOALS, _KEPT = 10, 2
# Tolerances of the toucher's place across and along the skin, in distances of kernels.
_ACROSS, _ALONG = 0.05, 0.2
# mu between knots of a way through touches, and most of these.
_SHORT, _MOST_KNOTS = 0.2, 150
# Rounds that ease a way through touches.
_EASED = 10
# A motion that is farther from its way across the skin than this may lose it.
_MISSED = 0.1
# A posture touches a part if its toucher is nearer to the surface than this, in distances of
# kernels.
_NEAR = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slide:
    """A motion over the skin: T knots.

    Attributes:
        surface: the skin and the toucher.
        lifter: its kinematics, in limits.
        x: `(T, J)` scaled postures.
        error: the farthest that the toucher is from its way across the skin, beyond the first
            knots, or from its end, in distances of kernels.
    """

    surface: TouchedSurface
    lifter: Lifter
    x: np.ndarray
    error: float


class ImaginedPlanner:
    """Plans over the skin that a body model knows; build it once and use it for many plans.

    Args:
        model: an accepted part at least.
        representation: what was learned.
        knot_spacing: as of `Planner`.
    """

    def __init__(
        self, model: BodyModel, representation: QuotientRepresentation, *, knot_spacing: float
    ) -> None:
        self.model = model
        self.representation = representation
        self.knot_spacing = knot_spacing
        self.surfaces = touched_surfaces(model, representation)
        kernel = np.repeat(
            np.arange(representation.num_targets), np.diff(representation.kernel_offsets)
        )
        self._kernel = kernel
        self._roadmaps: dict[tuple[int, int], Roadmap] = {}
        self._range = representation.kernel_q.min(axis=0), representation.kernel_q.max(axis=0)

    def plan(
        self,
        q_start: np.ndarray,
        targets: Sequence[int | None],
        *,
        limits: Limits | None = None,
    ) -> Plan | None:
        """Plans as `Planner.plan` does; None where the model does not know a way.

        Args:
            q_start: `(J,)` positions of the joints at the start, in the robot's units.
            targets: the target sensation felt at the start, None if nothing is felt; then the ones
                to feel, in order.
            limits: the motion stays within them; by default within the range of experience.
        """
        scale = self.representation.joint_scale
        lower, upper = (self.representation.scaled(limit) for limit in limits or self._range)
        x = self.representation.scaled(q_start)
        lower, upper = np.minimum(lower, x), np.maximum(upper, x)
        here, knots, in_air = targets[0], [x[None]], list[bool]()
        nodes = [NO_KERNEL if here is None else here]
        for goal in targets[1:]:
            if goal == here:
                continue
            slides = []
            for surface in self.surfaces:
                if surface.reach.part != self.model.kernel_part[goal]:
                    continue
                lifter = Lifter(reach=surface.reach, scale=scale, lower=lower, upper=upper)
                if here is not None and self._touches(lifter, surface, x):
                    slides += self.slides(lifter, surface, x, goal)
            if not slides:
                return None
            best = min(slides, key=self._cost)
            knots.append(best.x[1:])
            x, here = best.x[-1], goal
            nodes += self._felt(best)[1:-1].tolist() + [goal]
            in_air += [False] * (len(best.x) - 1)
        if len(knots) == 1:
            return None
        return self._through(q_start, np.concatenate(knots), nodes, in_air, (lower, upper))

    def slides(
        self, lifter: Lifter, surface: TouchedSurface, x: np.ndarray, goal: int
    ) -> list[Slide]:
        """Motions of one toucher over the skin from a posture to a target sensation."""
        ends = self._ends(surface, goal)
        if not len(ends):
            return []
        start, _ = self._at(lifter, surface, x)
        middle = np.median(surface.place[ends], axis=0)
        place = surface.way(start, surface.projected(middle[None])[0][0], _KNOTS)
        if place is None:
            return []
        way = SkinWay(
            place=place,
            normal=surface.projected(place)[1],
            across=_ACROSS * surface.spacing,
            along=_ALONG * surface.spacing,
        )
        joints = surface.reach.joints
        x_ends = self.representation.scaled(self.representation.kernel_q[surface.row[ends]])
        goals = np.tile(x, (len(ends), 1))
        goals[:, joints] = x_ends[:, joints]
        nearest = np.argsort(np.linalg.norm(goals - x, axis=1), kind="stable")[:_GOALS]
        rough = lifter.blended(x, goals[nearest], way)
        rough = np.concatenate([rough, lifter.followed(x, way)[None]])
        order = np.argsort([self._cost(self._slide(lifter, surface, x, way)) for x in rough])
        found = list[Slide]()
        for number in order:
            found.append(
                self._slide(lifter, surface, lifter.smoothed(rough[number], way), way)
            )
            if sum(slide.error <= _MISSED for slide in found) >= _KEPT:
                break
        if min(slide.error for slide in found) > _MISSED:
            found += self._round_about(lifter, surface, x, goals)
        return found

    def _round_about(
        self, lifter: Lifter, surface: TouchedSurface, x: np.ndarray, goals: np.ndarray
    ) -> list[Slide]:
        """A motion through firm touches, where the straight way asks too much of the joints."""
        passed = self._roadmap(lifter, surface).way(x, goals)
        if passed is None:
            return []
        joints, spacing = surface.reach.joints, surface.spacing
        place = surface.projected(lifter.centres(passed, surface))[0]
        keys = np.concatenate([place / spacing, passed[:, joints]], axis=1)
        length = np.linalg.norm(np.diff(keys, axis=0), axis=1).sum()
        keys = evenly(keys, int(np.clip(length / _SHORT, _KNOTS, _MOST_KNOTS)))
        for _ in range(_EASED):
            keys[1:-1] = 0.5 * keys[1:-1] + 0.25 * (keys[:-2] + keys[2:])
        on_it, normal = surface.projected(keys[:, :3] * spacing)
        way = SkinWay(
            place=on_it, normal=normal, across=_ACROSS * spacing, along=_ALONG * spacing
        )
        rough = np.repeat(x[None], len(keys), axis=0)
        rough[1:, joints] = keys[1:, 3:]
        rough[1:] = lifter.put(rough[1:], on_it[1:], normal[1:])
        return [self._slide(lifter, surface, lifter.smoothed(rough, way), way)]

    def _roadmap(self, lifter: Lifter, surface: TouchedSurface) -> Roadmap:
        """The roadmap of a surface, made when it is first needed."""
        name = surface.reach.part, surface.reach.toucher
        if name not in self._roadmaps:
            rows = surface.row[surface.firm]
            x = self.representation.scaled(self.representation.kernel_q[rows])
            random = np.random.default_rng(self.model.seed)
            self._roadmaps[name] = Roadmap(surface, lifter, x.astype(float), random)
        return self._roadmaps[name]

    def _slide(
        self, lifter: Lifter, surface: TouchedSurface, x: np.ndarray, way: SkinWay
    ) -> Slide:
        # Between knots as well: a wrist that turns over there leaves the skin.
        x_dense, place, normal = dense(x), dense(way.place), dense(way.normal)
        off = lifter.places(x_dense, normal)[0] - place
        across = np.abs(np.einsum("ta,ta->t", off, normal))[_BEGUN * _BETWEEN :]
        error = max(across.max(), np.linalg.norm(off[-1])) / surface.spacing
        return Slide(surface=surface, lifter=lifter, x=x, error=float(error))

    @staticmethod
    def _cost(slide: Slide) -> float:
        return path_length(slide.x)[-1] + 200.0 * max(0.0, slide.error - _MISSED)

    def _touches(self, lifter: Lifter, surface: TouchedSurface, x: np.ndarray) -> bool:
        place = self._at(lifter, surface, x)[1]
        return bool(surface.nodes.query(place)[0] < _NEAR * surface.spacing)

    @staticmethod
    def _at(
        lifter: Lifter, surface: TouchedSurface, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """`(3,)` the place of the surface that a posture touches, and the toucher's own."""
        place = lifter.centres(x[None], surface)
        return surface.projected(place)[0][0], place[0]

    def _ends(self, surface: TouchedSurface, goal: int) -> np.ndarray:
        """Touches of the surface at which motions to a goal end."""
        rows = np.flatnonzero(self._kernel[surface.row] == goal)
        if not len(rows):
            return rows
        stored = surface.row[rows]
        sure = surely_felt(
            self.representation.kernel_error[stored], self.representation.kernel_strength[stored]
        )
        return rows[sure]

    def _felt(self, slide: Slide) -> np.ndarray:
        """`(T,)` the target sensation at each knot: the kernel whose place is nearest."""
        surface = slide.surface
        own = np.unique(self._kernel[surface.row])
        own = own[np.isfinite(self.model.kernel_place[own]).all(axis=1)]
        place = slide.lifter.centres(slide.x, surface)
        apart = np.linalg.norm(place[:, None] - self.model.kernel_place[own], axis=2)
        return own[apart.argmin(axis=1)]

    def _through(
        self,
        q_start: np.ndarray,
        knots: np.ndarray,
        nodes: list[int],
        in_air: list[bool],
        limits: tuple[np.ndarray, np.ndarray],
    ) -> Plan:
        """The smooth plan through scaled knots `(T, J)`."""
        x = np.clip(dense(knots), *limits)
        path = smooth_path(x, knot_spacing=self.knot_spacing, limits=limits)
        path.c = path.c / self.representation.joint_scale
        path.c[0] = q_start
        at = path_length(x)[::_BETWEEN]
        # One waypoint for each target sensation on the way: the middle of its stretch.
        felt = np.array(nodes)
        change = np.flatnonzero(np.diff(felt)) + 1
        ends = np.concatenate([[0], change, [len(felt)]])
        rows = (ends[:-1] + ends[1:] - 1) // 2
        rows[0], rows[-1] = 0, len(felt) - 1
        waypoints_q = knots[rows] / self.representation.joint_scale
        waypoints_q[0] = q_start
        steps = len(rows) - 1
        imagined = np.ones(len(rows), dtype=bool)
        imagined[[0, -1]] = False
        return Plan(
            nodes=felt[rows],
            links=np.full(steps, -1),
            in_air=np.zeros(steps, dtype=bool),
            modes=np.full(steps, NO_MODE),
            imagined=imagined,
            waypoints_q=waypoints_q,
            waypoint_s=at[rows],
            path=path,
        )


def dense(knots: np.ndarray) -> np.ndarray:
    """`(n, D)` samples of the smooth curve through `(T, D)` knots, `_BETWEEN` for each step."""
    number = np.arange(len(knots), dtype=float)
    at = np.linspace(0.0, number[-1], _BETWEEN * (len(knots) - 1) + 1)
    samples = CubicSpline(number, knots)(at)
    samples[::_BETWEEN] = knots
    return samples
