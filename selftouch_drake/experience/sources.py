"""Two ways to babble: at given configurations, or under dynamics."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import HollowSkin, ReceptiveFields
from selftouch_drake.robot.agent import Agent
from selftouch_drake.robot.babbler import Babbler
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.station import MakeDynamicStation

# Steps in one batch: large enough for numpy, small in memory.
BATCH = 4096
# s, between two samples of a dynamic walk: a fingertip moves by a few millimetres.
SAMPLE_PERIOD = 0.02
# Samples in one batch of a dynamic walk.
DYNAMIC_BATCH = 500


class Source(Protocol):
    """A way to walk: gives configurations and what is felt in them."""

    agent: Agent

    def begin(self, walk: RandomWalk) -> None:
        """Starts at the beginning of `walk`."""

    def next_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """The next `(N, J)` rad float32 configurations and `(N, S)` N sensations, null or not."""


class KinematicSource:
    """Sets each step of the walk and evaluates contact there: the paper's S = phi(f(M))."""

    def __init__(self, experiment: Experiment, skin: HollowSkin, fields: ReceptiveFields):
        self._probe = ContactProbe(experiment, skin, fields)
        self.agent = self._probe.agent

    def begin(self, walk: RandomWalk) -> None:
        """Starts at the beginning of `walk`."""
        self._walk = walk

    def next_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """The next steps of the walk, and what is felt there."""
        # What is stored is what was felt: float32 configurations are the ones that are probed.
        q = self._walk.steps(BATCH).astype(np.float32)
        return q, self._probe.sensations(q)


class DynamicSource:
    """Lets joint controllers follow the walk in a simulation, and samples state and sensation.

    Babbler -> joint controllers -> plant -> contact results -> TactileSkin -> log, in one diagram.
    """

    def __init__(self, experiment: Experiment, skin: HollowSkin, fields: ReceptiveFields):
        builder = DiagramBuilder()
        station = MakeDynamicStation(experiment, skin, fields)
        self.agent = station.agent
        num_joints = self.agent.plant.num_positions()
        builder.AddNamedSystem("station", station.diagram)
        self._babbler = builder.AddNamedSystem(
            "babbler",
            Babbler(num_joints=num_joints, period_s=experiment.babbling.step_duration),
        )
        builder.Connect(
            self._babbler.GetOutputPort("desired_state"),
            station.diagram.GetInputPort("desired_state"),
        )
        self._state, self._sensation = (
            LogVectorOutput(
                station.diagram.GetOutputPort(name), builder, publish_period=SAMPLE_PERIOD
            )
            for name in ("state", "sensation")
        )
        self._diagram = builder.Build()

    def begin(self, walk: RandomWalk) -> None:
        """Puts the arm at rest where the walk begins."""
        self._babbler.set_walk(walk)
        self._simulator = Simulator(self._diagram)
        self._simulator.Initialize()
        context, plant = self._simulator.get_mutable_context(), self.agent.plant
        start = self._babbler.GetOutputPort("q").Eval(self._babbler.GetMyContextFromRoot(context))
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), start)
        self._clear_logs()

    def next_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """The next samples: the measured configuration and the sensation of the same instant."""
        context = self._simulator.get_mutable_context()
        self._simulator.AdvanceTo(context.get_time() + DYNAMIC_BATCH * SAMPLE_PERIOD)
        state = self._state.FindLog(context).data().T
        sensation = self._sensation.FindLog(context).data().T.copy()
        q = state[:, : self.agent.plant.num_positions()].astype(np.float32)
        self._clear_logs()
        return q, sensation

    def _clear_logs(self) -> None:
        context = self._simulator.get_mutable_context()
        for log in (self._state, self._sensation):
            log.FindMutableLog(context).Clear()
