"""The diagram of the design card in a stranger's script: it babbles, feels, and follows a plan."""

import numpy as np

from selftouch_drake.experience.store import ExperienceReader

# As a stranger writes it; RUN is a run that has learned.
BABBLES = """
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run import load_motion
from selftouch_drake.systems import Babbler, MakeSelfTouchDiagram, PlanSource

def simulate(commander, seconds):
    builder = DiagramBuilder()
    robot = builder.AddSystem(MakeSelfTouchDiagram(experiment, commander))
    log = LogVectorOutput(robot.GetOutputPort("sensation"), builder, publish_period=0.01)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    return log.FindLog(simulator.get_context()).data().T

experiment = load_experiment("cube")
babbled = simulate(Babbler(experiment), 20.0)
motion = load_motion(RUN, START, GOAL)
followed = simulate(PlanSource(motion), motion.time_s[-1])
"""


def test_twenty_lines_babble_feel_and_follow_a_plan(finished_run):
    assert len([line for line in BABBLES.splitlines() if line.strip()]) <= 20
    (plan,) = (finished_run / "plans").glob("*.npz")
    start, goal = map(int, plan.stem.split("-"))
    names = {"RUN": str(finished_run), "START": start, "GOAL": goal}
    exec(compile(BABBLES, "a stranger's script", "exec"), names)
    babbled, followed, motion = names["babbled"], names["followed"], names["motion"]
    num_receptors = next(ExperienceReader(finished_run / "experience").batches("sensation")).shape[
        1
    ]
    assert babbled.shape == (2001, num_receptors)
    assert 0.005 < babbled.any(axis=1).mean() < 0.5
    felt = followed[: len(motion.time_s)].any(axis=1)
    assert felt[motion.touching[: len(felt)]].mean() > 0.9
    expected, there = motion.predicted[-1], followed[-1]
    assert np.dot(expected, there) / np.linalg.norm(there) > 0.8
