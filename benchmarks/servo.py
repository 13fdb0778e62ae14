"""Contact, goals and forces with and without the touch servo.

    python benchmarks/servo.py RUN... --pairs 20

The same plans are executed under dynamics on the body that was learned, after the joints slipped
(one by 0.02 rad, a different one for each pair; or all, by 0.02 rad in the standard deviation),
and with a skin that lost 5 mm on its outer side. The runs must have learned; nothing is written
into them. The table stands in docs/planning.md.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh

from selftouch_drake.agent.motions import Execution
from selftouch_drake.agent.rehearsal import RehearsalMemory
from selftouch_drake.evaluation import random_pairs
from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import hollow_skin
from selftouch_drake.robot import Simulation, SkinModel
from selftouch_drake.run import stages
from selftouch_drake.run.acting import NoWayError, Pilot
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory

#: rad; m.
SLIP, LOST = 0.02, 0.005

#: s: a servo cannot hold a touch that is not there when the motion starts; then it finds it.
_START = 0.3


def worn(skin: SkinModel) -> SkinModel:
    """The skin with 5 mm less on its outer side; its receptors keep their places."""
    wall = skin.wall
    lost = hollow_skin(trimesh.Trimesh(wall.vertices, wall.faces, process=False), LOST, None)
    left = trimesh.Trimesh(lost.inner_vertices, wall.faces, process=False)
    return dataclasses.replace(skin, wall=hollow_skin(left, wall.thickness - LOST, None))


def bodies(
    experiment: Experiment, skins: Sequence[SkinModel], num_joints: int, num_pairs: int
) -> dict[str, tuple[Sequence[SkinModel], np.ndarray]]:
    """By name: the skins, and `(pairs, J)` rad, slip of the joints."""
    rng = np.random.default_rng(experiment.seed)
    pair = np.arange(num_pairs)
    one = np.zeros((num_pairs, num_joints))
    one[pair, pair % num_joints] = SLIP * rng.choice([-1, 1], num_pairs)
    unslipped = np.zeros_like(one)
    return {
        "unchanged": (skins, unslipped),
        "one joint slipped": (skins, one),
        "thinner skin": ([worn(skin) for skin in skins], unslipped),
        "all joints slipped": (skins, SLIP * rng.standard_normal(one.shape)),
    }


def measured(path: Path, num_pairs: int) -> Iterator[str]:
    """Lines of the table for a run."""
    run = RunDirectory.open(path)
    experiment = dataclasses.replace(
        run.experiment,
        execution=dataclasses.replace(run.experiment.execution, touch_servo=True),
        evaluation=dataclasses.replace(run.experiment.evaluation, num_pairs=num_pairs),
    )
    agent, world = load_agent(run), stages.make_world(run)
    agent = agent.recalling(RehearsalMemory.blank(agent.representation))
    pilot, motions = Pilot(agent, world), []
    for pair in random_pairs(experiment, agent.representation):
        try:
            motions.append(pilot.plan(*pair).motion)
        except NoWayError:
            continue
    felt_beside = [pilot.beside(motion) for motion in motions]
    cases = bodies(experiment, world.skins, world.robot.num_joints, len(motions))
    for name, (skins, slips) in cases.items():
        simulation = Simulation(experiment, skins)
        for servo in (False, True):
            tries, later = [], []
            for motion, beside, slip in zip(motions, felt_beside, slips, strict=True):
                log = simulation.execute(
                    motion.time_s, motion.q - slip, motion.v, beside if servo else None
                )
                execution = Execution(
                    motion=motion,
                    felt=log.felt,
                    q_measured=log.q,
                    v_measured=log.v,
                    torque=log.torque,
                )
                tries.append(agent.judge(execution))
                expected = motion.touching & (motion.time_s >= _START)
                later.append(log.felt.any(axis=1)[expected].mean())
            contact = [one.contact for one in tries]
            force = [one.execution.felt.sum(axis=1) for one in tries]
            yield (
                f"| {path.name} | {name} | {'on' if servo else 'off'} "
                f"| {np.mean(contact):.2%} / {np.min(contact):.1%} "
                f"| {np.mean(later):.2%} / {np.min(later):.1%} "
                f"| {np.mean([one.reached for one in tries]):.0%} "
                f"| {np.mean([each.mean() for each in force]):.1f} / "
                f"{np.max([each.max() for each in force]):.1f} |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=20, help="of start and goal, in each run")
    arguments = parser.parse_args()
    print(
        "| run | body | servo | contact, mean / worst | after 0.3 s | goal reached "
        "| force, mean / largest (N) |"
    )
    print("|---|---|---|---|---|---|---|")
    for path in arguments.runs:
        for line in measured(path, arguments.pairs):
            print(line, flush=True)


if __name__ == "__main__":
    main()
