"""The world of an experiment; each part is built at its first use."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np

from selftouch_drake.experiment import Experiment, ExperimentError
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.robot import JointLimits, Robot
from selftouch_drake.robot.simulation import Simulation
from selftouch_drake.robot.skins import SkinModel, make_skins, receptor_skin

#: `make_skins`, or what knows its result.
MakeSkins = Callable[[Experiment], tuple[SkinModel, ...]]


class World:
    """Skins, contact without dynamics, and the simulation of one experiment.

    Args:
        experiment: the experiment.
        make_skins: makes its skins, or knows them from before.
    """

    def __init__(self, experiment: Experiment, make_skins: MakeSkins = make_skins):
        self.experiment = experiment
        self._make_skins = make_skins

    @cached_property
    def skins(self) -> tuple[SkinModel, ...]:
        """The skins, each in the frame of its link."""
        return self._make_skins(self.experiment)

    @property
    def receptor_skin(self) -> np.ndarray:
        """`(S,)` the number of the skin that each reading comes from."""
        return receptor_skin(self.skins)

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


@contextlib.contextmanager
def drakes_refusals() -> Iterator[None]:
    """Turns Drake's refusals of a robot into one-line errors.

    Raises:
        ExperimentError: the text is Drake's own.
    """
    try:
        yield
    # Some of Drake's checks log what is wrong and then raise SystemExit.
    except (RuntimeError, SystemExit) as error:
        reason = " ".join(str(error).split())[:500]
        raise ExperimentError(
            f"robot.directives holds a robot that Drake refuses: {reason}"
        ) from error
