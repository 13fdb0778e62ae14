"""Contact, goals and forces with and without the touch servo.

    python benchmarks/accuracy/servo.py --pairs 20

The same practised plans are executed under dynamics on the body that was learned, after the joints
slipped (one by 0.02 rad, a different one for each pair; or all, by 0.02 rad in the standard
deviation), and with a skin that lost 5 mm on its outer side. Runs that are missing are made. The
table stands in docs/planning.md.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh

from selftouch_drake.agent.pilot import executed
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.agent.tries import reached
from selftouch_drake.bodies.drake import DrakeDynamicBody
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.robot import SkinModel
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.systems.simulation import Simulation

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import learned
from benchmarks.shared.results import add_update_option, results

#: rad; m.
SLIP, LOST = 0.02, 0.005

#: s: a servo cannot hold a touch that is not there when the motion starts; then it finds it.
_START = 0.3


def worn(skin: SkinModel) -> SkinModel:
    """The skin with 5 mm less on its outer side; its receptors keep their places."""
    wall = skin.wall
    lost = hollow_skin(trimesh.Trimesh(wall.vertices, wall.faces, process=False), LOST)
    left = trimesh.Trimesh(lost.inner_vertices, wall.faces, process=False)
    return dataclasses.replace(skin, wall=hollow_skin(left, wall.thickness - LOST))


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


def rows(run: RunDirectory, num_pairs: int) -> Iterator[dict[str, str | float]]:
    """Rows of the table for a run that has learned."""
    serves = dataclasses.replace(run.experiment.execution, touch_servo=True)
    experiment = dataclasses.replace(run.experiment, execution=serves)
    agent, world = load_agent(run), stages.make_world(run)
    pilot, motions = pilot_in(stages.run_bodies(run), agent, experiment), []
    for pair in random_pairs(experiment, agent.representation, num_pairs):
        with contextlib.suppress(NoWayError):
            motions.append(pilot.plan(*pair).motion)
    felt_beside = [pilot.beside(motion) for motion in motions]
    cases = bodies(experiment, world.skins, world.robot.num_joints, len(motions))
    for body, (skins, slips) in cases.items():
        robot = DrakeDynamicBody(world, Simulation(experiment, skins))
        for servo in (False, True):
            contact, later, arrived, force = [], [], [], []
            for motion, beside, slip in zip(motions, felt_beside, slips, strict=True):
                how = motion.time_s, motion.q - slip
                followed = robot.follow_beside(*how, beside) if servo else robot.follow(*how)
                felt = executed(motion, followed).felt
                contact.append(motion.contact(felt))
                expected = motion.touching & (motion.time_s >= _START)
                later.append(felt.any(axis=1)[expected].mean())
                arrived.append(reached(motion, felt, agent.representation))
                force.append(felt.sum(axis=1))
            yield {
                "run": run.experiment.name,
                "body": body,
                "servo": "on" if servo else "off",
                "contact_mean": round(float(np.mean(contact)), 4),
                "contact_worst": round(min(contact), 4),
                "contact_after_start_mean": round(float(np.mean(later)), 4),
                "contact_after_start_worst": round(float(min(later)), 4),
                "reached": round(float(np.mean(arrived)), 4),
                "force_mean_N": round(float(np.mean([each.mean() for each in force])), 2),
                "force_largest_N": round(float(max(each.max() for each in force)), 2),
            }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", nargs="*", default=["sphere", "cube", "torus"])
    parser.add_argument("--out", type=Path, default=Path("runs/servo"), help="where runs are kept")
    parser.add_argument("--touches", type=int, default=400_000)
    parser.add_argument("--targets", type=int, default=500)
    parser.add_argument("--pairs", type=int, default=20, help="of start and goal, in each run")
    add_update_option(parser, "servo")
    arguments = parser.parse_args()
    size = {
        "babbling": {"num_samples": arguments.touches},
        # The shape is not needed.
        "representation": {"num_targets": arguments.targets, "metric": "sensorimotor"},
    }
    with results("servo", update=arguments.update) as add:
        for name in arguments.experiments:
            run = learned(arguments.out / name, load_experiment(name, size))
            for row in rows(run, arguments.pairs):
                add(row)
                print(" | ".join(map(str, row.values())), flush=True)


if __name__ == "__main__":
    main()
