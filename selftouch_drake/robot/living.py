"""The agent in a world that goes on: each motion begins where the one before has left the arm."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import HollowSkin, ReceptiveFields
from selftouch_drake.robot.joints import slip
from selftouch_drake.robot.plan_source import PlanSource
from selftouch_drake.robot.station import MakeDynamicStation


class LivingAgent:
    """The agent under dynamics, advanced in small steps.

    Args:
        experiment: the experiment whose agent lives.
        skin: its hollow skin.
        fields: its receptive fields.
        q: `(J,)` rad, where the arm is at rest at first, as its joints read.
        meshcat: where to show it.
    """

    def __init__(
        self,
        experiment: Experiment,
        skin: HollowSkin,
        fields: ReceptiveFields,
        q: np.ndarray,
        meshcat: Meshcat | None = None,
    ):
        builder = DiagramBuilder()
        station = MakeDynamicStation(experiment, skin, fields, meshcat)
        builder.AddNamedSystem("station", station.diagram)
        self.agent = station.agent
        # As in `DynamicWorld`: joints that have slipped read more than they are.
        self._slip = slip(experiment, len(q))
        q_true = np.asarray(q, dtype=float) - self._slip
        self._path = PiecewisePolynomial(q_true[:, None])
        self._source = builder.AddNamedSystem("plan_source", PlanSource(self._path))
        builder.Connect(
            self._source.get_output_port(), station.diagram.GetInputPort("desired_state")
        )
        self._simulator = Simulator(builder.Build())
        context = self._simulator.get_mutable_context()
        self._context = station.diagram.GetMyContextFromRoot(context)
        self._state = station.diagram.GetOutputPort("state")
        self._sensation = station.diagram.GetOutputPort("sensation")
        plant = self.agent.plant
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), q_true)
        self._simulator.Initialize()

    @property
    def time_s(self) -> float:
        """s, since the last motion began."""
        return self._simulator.get_context().get_time()

    @property
    def q(self) -> np.ndarray:
        """`(J,)` rad, where the arm truly is."""
        return self._state.Eval(self._context)[: self.agent.plant.num_positions()]

    @property
    def q_commanded(self) -> np.ndarray:
        """`(J,)` rad, where the arm is told to be, as its joints read.

        It is beyond `q` by what presses the finger on the skin.
        """
        path = self._path
        return path.value(min(self.time_s, path.end_time())).ravel() + self._slip

    @property
    def felt(self) -> np.ndarray:
        """`(S,)` N, the sensation."""
        return self._sensation.Eval(self._context)

    def set_rate(self, rate: float) -> None:
        """Lets the world go on `rate` times as fast as the clock, if it can; 0 is as it can."""
        self._simulator.set_target_realtime_rate(rate)
        self._simulator.ResetStatistics()

    def follow(self, time_s: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Begins a motion, from where the arm is commanded to be.

        Args:
            time_s: `(T,)` s, from 0.
            q: `(T, J)` rad, as the joints read.
            v: `(T, J)` rad/s.
        """
        self._path = PiecewisePolynomial.CubicHermite(time_s, (q - self._slip).T, v.T)
        self._source.set_trajectory(self._path)
        self._simulator.get_mutable_context().SetTime(0.0)
        self._simulator.Initialize()

    def advance(self, duration: float) -> None:
        """Lets the world go on for `duration` s, in step with the clock."""
        self._simulator.AdvanceTo(self.time_s + duration)
