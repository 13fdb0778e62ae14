"""Executing timed paths in the dynamic world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import HollowSkin, ReceptiveFields
from selftouch_drake.robot.joints import slip
from selftouch_drake.robot.plan_source import PlanSource
from selftouch_drake.robot.station import MakeDynamicStation

# s, between two entries of the log: five tactile readings in the time of a human's reaction to one.
LOG_PERIOD = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Execution:
    """What happened along an executed trajectory, sampled every `log_period` of its world.

    Attributes:
        time_s: `(T,)` s.
        q_measured: `(T, J)` rad.
        v_measured: `(T, J)` rad/s.
        torque: `(N, J)` N·m, of the actuators, at every step of the plant.
        felt: `(T, S)` N, sensations.
    """

    time_s: np.ndarray
    q_measured: np.ndarray
    v_measured: np.ndarray
    torque: np.ndarray
    felt: np.ndarray


class DynamicWorld:
    """The agent under dynamics, with a plan source; built once, used for many executions.

    Args:
        experiment: the experiment whose agent acts.
        skin: its hollow skin.
        fields: its receptive fields.
        meshcat: where to show it.
        log_period: s, between two entries of the log.
    """

    def __init__(
        self,
        experiment: Experiment,
        skin: HollowSkin,
        fields: ReceptiveFields,
        meshcat: Meshcat | None = None,
        *,
        log_period: float = LOG_PERIOD,
    ):
        builder = DiagramBuilder()
        self._station = MakeDynamicStation(experiment, skin, fields, meshcat)
        station = builder.AddNamedSystem("station", self._station.diagram)
        num_joints = self._station.agent.plant.num_positions()
        self._slip = slip(experiment, num_joints)
        still = PiecewisePolynomial(np.zeros((num_joints, 1)))
        self._source = builder.AddNamedSystem("plan_source", PlanSource(still))
        builder.Connect(self._source.get_output_port(), station.GetInputPort("desired_state"))
        self._logs = {
            name: LogVectorOutput(station.GetOutputPort(name), builder, publish_period=period)
            for name, period in (
                ("state", log_period),
                ("torque", experiment.execution.time_step),
                ("sensation", log_period),
            )
        }
        self.diagram = builder.Build()

    def execute(self, time_s: np.ndarray, q: np.ndarray, v: np.ndarray) -> Execution:
        """Puts the arm at rest where the motion starts, and lets it follow.

        Args:
            time_s: `(T,)` s, from 0, every `LOG_PERIOD` but for the last, which may be earlier.
            q: `(T, J)` rad.
            v: `(T, J)` rad/s.

        Returns:
            What happened until the end of the period in which the motion ends: T entries, if the
            world logs every `LOG_PERIOD`.
        """
        # Where the arm truly goes, if its joints read too much.
        q = q - self._slip
        self._source.set_trajectory(PiecewisePolynomial.CubicHermite(time_s, q.T, v.T))
        simulator = Simulator(self.diagram)
        context = simulator.get_mutable_context()
        plant = self._station.agent.plant
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), q[0])
        simulator.Initialize()
        simulator.AdvanceTo(LOG_PERIOD * (len(time_s) - 1))
        logs = {name: log.FindLog(context) for name, log in self._logs.items()}
        num_joints = plant.num_positions()
        state = logs["state"].data().T
        return Execution(
            time_s=logs["state"].sample_times().copy(),
            q_measured=state[:, :num_joints],
            v_measured=state[:, num_joints:],
            torque=logs["torque"].data().T.copy(),
            felt=logs["sensation"].data().T.copy(),
        )
