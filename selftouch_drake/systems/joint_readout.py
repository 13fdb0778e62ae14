"""The system that reads joints like real encoders: with noise, and after they slipped."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.imperfections import remembered


class JointReadout(LeafSystem):
    """Turns true joint positions into those that the joints read.

    .. pydrake_system::

        name: JointReadout
        input_ports:
        - q
        output_ports:
        - reading

    ============= ====== ==== ======== ====================================
    port          type   size unit     what
    ============= ====== ==== ======== ====================================
    q (in)        vector J    rad or m where the joints truly are
    reading (out) vector J    rad or m where they read that they are
    ============= ====== ==== ======== ====================================

    It has no state: noise follows from the seed of the experiment and from the configuration.

    Args:
        experiment: of the robot, with `joints.noise`.
        slip: `(J,)` rad or m, by how much joints read more than their true position.
    """

    def __init__(self, experiment: Experiment, slip: np.ndarray):
        super().__init__()
        self._experiment, self._slip = experiment, slip
        self._q = self.DeclareVectorInputPort("q", len(slip))
        self.DeclareVectorOutputPort("reading", len(slip), self._calc_reading)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        experiment: Experiment,
        slip: np.ndarray,
        q: OutputPort,
        *,
        name: str = "joint_readout",
    ) -> "JointReadout":
        """Adds a readout to a diagram and connects it to `(J,)` true positions."""
        readout = JointReadout(experiment, slip)
        builder.AddNamedSystem(name, readout)
        builder.Connect(q, readout.GetInputPort("q"))
        return readout

    def _calc_reading(self, context, output):
        q = self._q.Eval(context) + self._slip
        output.SetFromVector(remembered(self._experiment, q[None])[0])
