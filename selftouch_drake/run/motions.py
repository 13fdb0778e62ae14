"""Motions of a run: planned, timed, executed and rehearsed, and kept in its `plans` folder."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from selftouch_drake.agent.planning import Plan, Planner, jerk_reduction, predict_sensation
from selftouch_drake.agent.rehearsal import RehearsalMemory, Try, best, judge, rehearse
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.geometry import HollowSkin, ReceptiveFields, build_body
from selftouch_drake.robot.agent import Agent
from selftouch_drake.robot.execution import LOG_PERIOD, DynamicWorld
from selftouch_drake.robot.limits import JointLimits
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.timing import TimedPath, time_path
from selftouch_drake.run.directory import RunDirectory, RunError

#: What the file of a plan holds, executed or not.
PLAN_ARRAYS = (
    "nodes",
    "links",
    "waypoints_q",
    "waypoint_s",
    "time_s",
    "s",
    "q",
    "v",
    "predicted",
    "predicted_spread",
)
# A motion is a dictionary of arrays, as the file of a plan holds them.
Motion = dict[str, np.ndarray]


class World:
    """The world of an experiment, each part built when first asked for."""

    def __init__(self, experiment: Experiment):
        self._experiment = experiment

    @cached_property
    def body(self) -> tuple[HollowSkin, ReceptiveFields]:
        """The hollow skin and its receptive fields."""
        return build_body(self._experiment)

    @cached_property
    def probe(self) -> ContactProbe:
        """What is felt at given configurations, without time."""
        return ContactProbe(self._experiment, *self.body)

    @cached_property
    def limits(self) -> JointLimits:
        """What the arm and its motions may do."""
        return JointLimits.of(self.probe.agent, self._experiment.execution)

    @cached_property
    def dynamic(self) -> DynamicWorld:
        """Where plans are executed."""
        return DynamicWorld(self._experiment, *self.body)


class Pilot:
    """Plans over a run's representation, with timing, and keeps the plans in the run.

    Args:
        run: a run that has learned.
        memory: what rehearsals have taught; by default what the run remembers of them.
    """

    def __init__(self, run: RunDirectory, memory: RehearsalMemory | None = None):
        self.run = run
        self.representation = load_representation(run)
        self.memory = load_memory(run, self.representation) if memory is None else memory
        self._planner = Planner(
            self.representation, knot_spacing=run.experiment.planning.knot_spacing
        )
        self._free: Planner | None = None
        self.query_s: list[float] = []
        self.jerk_reduction: list[float] = []

    def plan(self, *targets: int) -> Motion:
        """Plans through target sensations and stores the plan.

        Args:
            targets: two or more, in order. The motion starts at a configuration of the first,
                drawn from the seed.

        Raises:
            ValueError: as `Planner.plan_tour`.
        """
        require_targets(self.representation, *targets)
        motion = self._planned(self._planner, self._some_configuration(*targets), targets)
        save_arrays(self.run.plan(*targets), motion)
        return motion

    def plan_from(self, world: World, q_start: np.ndarray, goal: int) -> Motion:
        """Plans from any configuration, touching or not, and stores the plan as `free-GOAL`.

        Args:
            world: where the agent feels whether it touches at `q_start`.
            q_start: `(J,)` rad, where the arm is.
            goal: the target sensation to reach.

        Raises:
            ValueError: as `Planner.plan_tour`, or `q_start` is outside the joints' limits.
        """
        require_targets(self.representation, 0, goal)
        agent = world.probe.agent
        q_start = self._free_planner(agent).checked_configuration(q_start)
        (felt,) = world.probe.sensations(q_start[None])
        motion = self.motion_from(agent, q_start, felt, goal)
        save_arrays(self.run.plan("free", goal), motion)
        return motion

    def motion_from(self, agent: Agent, q_start: np.ndarray, felt: np.ndarray, goal: int) -> Motion:
        """Plans from any configuration, touching or not; nothing is stored.

        Args:
            agent: whose joints' limits hold.
            q_start: `(J,)` rad, where the arm is.
            felt: `(S,)` N, what is felt there.
            goal: the target sensation to reach.

        Raises:
            ValueError: as `Planner.plan_tour`, or `q_start` is outside the joints' limits.
        """
        planner = self._free_planner(agent)
        q_start = planner.checked_configuration(q_start)
        start = int(np.argmax(self.representation.target_sensations @ felt)) if felt.any() else None
        return self._planned(planner, q_start, (start, goal))

    def _free_planner(self, agent: Agent) -> Planner:
        """A planner that knows the joints' limits, as it may have to leave what it has felt."""
        if self._free is None:
            self._free = Planner(
                self.representation,
                knot_spacing=self.run.experiment.planning.knot_spacing,
                lower=agent.lower,
                upper=agent.upper,
            )
        return self._free

    def _planned(
        self, planner: Planner, q_start: np.ndarray, targets: Sequence[int | None]
    ) -> Motion:
        began = time.perf_counter()
        plan = planner.plan_tour(q_start, targets, link_penalty=self.memory.link_penalty)
        timed = self._timed(plan)
        self.query_s.append(time.perf_counter() - began)
        self.jerk_reduction.append(jerk_reduction(plan))
        return self._predicted(plan, timed)

    @cached_property
    def kernel_sensation(self) -> np.ndarray:
        """`(R, S)` unit L2 norm, what was felt at each configuration of the representation."""
        return kernel_sensation(self.run, self.representation)

    def _timed(self, plan: Plan) -> TimedPath:
        limits, num_joints = self.run.experiment.execution, plan.waypoints_q.shape[1]
        return time_path(
            plan.path,
            velocity_limit=np.full(num_joints, limits.max_velocity),
            acceleration_limit=np.full(num_joints, limits.max_acceleration),
            rate_hz=1 / LOG_PERIOD,
        )

    def _predicted(self, plan: Plan, timed: TimedPath) -> Motion:
        prediction = predict_sensation(self.representation, plan, timed.s, self.kernel_sensation)
        return {
            "nodes": plan.nodes,
            "links": plan.links,
            "waypoints_q": plan.waypoints_q,
            "waypoint_s": plan.waypoint_s,
            "time_s": timed.time_s,
            "s": timed.s,
            "q": timed.q,
            "v": timed.v,
            "predicted": prediction.sensation,
            "predicted_spread": prediction.spread,
            **self.run.stamp(),
        }

    def _some_configuration(self, *targets: int) -> np.ndarray:
        """Where the arm is when it is asked: any configuration of the first kernel."""
        members = self.representation.kernel_q[self.representation.members(targets[0])]
        stream = self.run.experiment.random_stream("start", *targets)
        return members[np.random.default_rng(stream).integers(len(members))].astype(float)


def execute(run: RunDirectory, world: World, *targets: int | str) -> Motion:
    """Executes a stored plan in the dynamic world and stores what was felt beside it.

    Args:
        run: a run that has planned.
        world: its world.
        targets: of the plan, in order; `"free", GOAL` for one of `Pilot.plan_from`.

    Raises:
        RunError: there is no such target sensation, or no such plan.
    """
    require_targets(load_representation(run), *(t for t in targets if isinstance(t, int)))
    motion = executed(world, load_plan(run, *targets))
    save_arrays(run.plan(*targets), motion)
    return motion


def load_plan(run: RunDirectory, *targets: int | str) -> Motion:
    """A stored plan, executed or not.

    Args:
        run: a run that has planned.
        targets: of the plan, in order; `"free", GOAL` for one of `Pilot.plan_from`.

    Raises:
        RunError: there is no such plan, or it was made of something else that was learned.
        ValueError: the file is damaged.
    """
    file, (what, options) = run.plan(*targets), _described(*targets)
    remedy = f"with `selftouch plan {run.path} {options}`"
    if not file.exists():
        raise RunError(f"{run.path} has no {what}; make one {remedy}")
    plan = load_arrays(file, PLAN_ARRAYS)
    run.require_stamp(file, plan, remedy=f"make it again {remedy}")
    if wrong := _misshapen(plan, run.experiment.skin.num_receptors):
        raise RunError(f"{file} is no plan: {wrong} does not fit the rest; make it again {remedy}")
    return plan


def _misshapen(plan: Motion, num_receptors: int) -> str:
    """The name of an array that cannot be of a plan with the others; empty if all can."""
    W, T, joints = plan["nodes"].size, plan["time_s"].size, plan["waypoints_q"].shape[1:2]
    expected: dict[str, tuple[int, ...]] = {
        "nodes": (W,),
        "links": (W - 1,),
        "waypoints_q": (W, *joints),
        "waypoint_s": (W,),
        **dict.fromkeys(("time_s", "s", "predicted_spread"), (T,)),
        **dict.fromkeys(("q", "v", "q_measured"), (T, *joints)),
        **dict.fromkeys(("predicted", "felt"), (T, num_receptors)),
    }
    for name, shape in expected.items():
        array = plan.get(name)
        if array is not None and (
            array.shape != shape or array.dtype.kind not in "if" or not np.isfinite(array).all()
        ):
            return name
    return ""


def _described(start: int | str, *goals: int | str) -> tuple[str, str]:
    """A plan in words, and the options that ask for it."""
    if start == "free":
        return f"free plan to {goals[-1]}", f"--from-q Q --to {goals[-1]}"
    if len(goals) > 1:
        through = ",".join(map(str, (start, *goals)))
        return f"plan through {through}", f"--through {through}"
    return f"plan from {start} to {goals[0]}", f"--from {start} --to {goals[0]}"


def executed(world: World, plan: Motion) -> Motion:
    """A timed plan with what became of it in the dynamic world."""
    done = world.dynamic.execute(plan["time_s"], plan["q"], plan["v"])
    kinematics = world.probe.kinematics
    return plan | {
        "felt": done.felt,
        "q_measured": done.q_measured,
        "v_measured": done.v_measured,
        "torque": done.torque,
        "p_WF_planned": kinematics.positions(plan["q"]).reshape(len(plan["q"]), -1),
        "p_WF_measured": kinematics.positions(done.q_measured).reshape(len(done.q_measured), -1),
    }


def tracking_rms(motion: Motion) -> float:
    """Rad, root mean square angle between the commanded and the measured joints."""
    return float(np.sqrt(np.mean(np.square(motion["q_measured"] - motion["q"]))))


def rehearse_motion(
    pilot: Pilot,
    world: World,
    start: int,
    goal: int,
    *,
    max_tries: int,
    known: Try[Motion] | None = None,
) -> list[Try[Motion]]:
    """Plans and executes until contact is never lost; the pilot remembers what it learned.

    Args:
        pilot: its memory grows with every try.
        world: where plans are executed.
        start: the target sensation to leave.
        goal: the target sensation to reach.
        max_tries: most executions.
        known: a try from before; the same plan is not executed again.

    Returns:
        The tries, in order; the plan of the best is stored in the run.
    """

    def attempt(memory: RehearsalMemory) -> Try[Motion]:
        pilot.memory = memory
        plan = pilot.plan(start, goal)
        if known is not None and np.array_equal(plan["q"], known.motion["q"]):
            return known
        return judged(executed(world, plan), goal, pilot.representation)

    tries, pilot.memory = rehearse(attempt, pilot.memory, max_tries=max_tries)
    save_arrays(pilot.run.plan(start, goal), best(tries).motion)
    return tries


def judged(motion: Motion, goal: int, representation: QuotientRepresentation) -> Try[Motion]:
    """An executed motion, as the agent itself judges it."""
    return judge(
        motion,
        felt=motion["felt"],
        s=motion["s"],
        waypoint_s=motion["waypoint_s"],
        links=motion["links"],
        goal=goal,
        target_sensations=representation.target_sensations,
    )


def load_representation(run: RunDirectory) -> QuotientRepresentation:
    """The representation of a run that has learned.

    Raises:
        RunError: there is none, or it is of another experiment.
    """
    if not run.representation.exists():
        raise RunError(f"{run.path} has learned nothing yet; run `selftouch learn {run.path}`")
    representation = QuotientRepresentation.load(run.representation)
    found = representation.target_sensations.shape
    wanted = (run.experiment.representation.num_targets, run.experiment.skin.num_receptors)
    if found != wanted:
        raise RunError(
            f"{run.representation} has {found[0]} targets over {found[1]} receptors, the "
            f"experiment {wanted[0]} over {wanted[1]}; run `selftouch learn {run.path}`"
        )
    run.require_stamp(run.representation)
    return representation


def kernel_sensation(run: RunDirectory, representation: QuotientRepresentation) -> np.ndarray:
    """`(R, S)` unit L2 norm, what was felt at each row of the representation's `kernel_q`."""
    num_receptors = representation.target_sensations.shape[1]
    felt = np.zeros((len(representation.kernel_row), num_receptors), dtype=np.float32)
    first = 0
    for batch in ExperienceReader(run.experience).batches("sensation"):
        here = representation.kernel_row - first
        inside = (here >= 0) & (here < len(batch))
        # In double precision: the square of a graze vanishes in single.
        rows = batch[here[inside]].astype(float)
        felt[inside] = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        first += len(batch)
    return felt


def load_memory(run: RunDirectory, representation: QuotientRepresentation) -> RehearsalMemory:
    """What a run remembers of its rehearsals; blank if there were none."""
    if not run.rehearsal.exists():
        return RehearsalMemory.blank(representation)
    return RehearsalMemory.load(run.rehearsal, representation)


def require_targets(representation: QuotientRepresentation, *targets: int) -> None:
    """Refuses target sensations that a run does not have."""
    num_targets = representation.num_targets
    names = ("--from", "--to") if len(targets) == 2 else ("--through",) * len(targets)
    for name, target in zip(names, targets, strict=True):
        if not 0 <= target < num_targets:
            raise RunError(
                f"{name} is {target}; this run has target sensations 0 to {num_targets - 1}"
            )
