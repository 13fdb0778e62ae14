from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.robot import MakeDynamicStation, PlanSource


class MovingAgent:
    """An agent under dynamics that follows trajectories; every plant step is logged."""

    def __init__(self, world):
        builder = DiagramBuilder()
        self.station = MakeDynamicStation(world.experiment, world.skin, world.fields)
        station = builder.AddSystem(self.station.diagram)
        self._source = builder.AddSystem(PlanSource(PiecewisePolynomial(np.zeros((6, 1)))))
        builder.Connect(self._source.get_output_port(), station.GetInputPort("desired_state"))
        self._logs = {
            name: LogVectorOutput(
                station.GetOutputPort(name), builder, world.experiment.execution.time_step
            )
            for name in ("state", "sensation", "torque")
        }
        self._diagram = builder.Build()

    def follow(self, trajectory, *, start, duration):
        """Starts at rest at `start` and returns `q`, `sensation` and `torque`, row by row."""
        self._source.set_trajectory(trajectory)
        simulator = Simulator(self._diagram)
        context = simulator.get_mutable_context()
        plant = self.station.agent.plant
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), start)
        simulator.AdvanceTo(duration)
        rows = {name: log.FindLog(context).data().T for name, log in self._logs.items()}
        return SimpleNamespace(
            q=rows["state"][:, :6].copy(),
            sensation=rows["sensation"].copy(),
            torque=rows["torque"].copy(),
        )


@pytest.fixture(scope="session")
def moving_agent(world):
    """The agent of `world` under dynamics."""
    return MovingAgent(world)
