"""The world of an experiment; each part is built at its first use."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.robot import JointLimits, Robot
from selftouch_drake.robot.simulation import Simulation
from selftouch_drake.robot.skins import SkinModel, make_skins


class World:
    """Skins, contact without dynamics, and the simulation of one experiment.

    Args:
        experiment: the experiment.
    """

    def __init__(self, experiment: Experiment):
        self.experiment = experiment

    @cached_property
    def skins(self) -> tuple[SkinModel, ...]:
        """The skins, each in the frame of its link; may be set to those that are known."""
        return make_skins(self.experiment)

    @property
    def receptor_skin(self) -> np.ndarray:
        """`(S,)` int8, the number of the skin that each reading comes from."""
        sizes = [skin.fields.num_receptors for skin in self.skins]
        return np.repeat(np.arange(len(sizes), dtype=np.int8), sizes)

    @cached_property
    def probe(self) -> ContactProbe:
        """Sensations at given configurations, without dynamics."""
        return ContactProbe(self.experiment, self.skins)

    @property
    def robot(self) -> Robot:
        """The robot, as the probe has it."""
        return self.probe.robot

    @cached_property
    def limits(self) -> JointLimits:
        """Limits of the robot and of its motions."""
        return JointLimits.of(self.robot, self.experiment.execution)

    @cached_property
    def simulation(self) -> Simulation:
        """The simulation in which plans are executed."""
        return Simulation(self.experiment, self.skins)
