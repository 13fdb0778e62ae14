"""The interface through which this package reads a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.shape import Body
from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import Robot, Touches, World
from selftouch_drake.show.recovered import RecoveredSkin
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.skins import SkinSurface

#: The targets that name a plan, in order; the first is a text if it begins in any configuration.
Targets = tuple[int | str, ...]


class MissingError(ValueError):
    """Something to show is missing; the text says why, and what makes it."""


class NoSurfaceError(MissingError):
    """The recovered body is not a surface in space, so it has no picture."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchSample:
    """True places of some touches.

    Attributes:
        places: `(n, 3)` m, with the skins at home.
        num_drawn: number of touches in the sample; some have several places.
        num_touches: number of all touches.
    """

    places: np.ndarray
    num_drawn: int
    num_touches: int


class Reading(Protocol):
    """A metric of the run, as text."""

    @property
    def key(self) -> str:
        """Its name in `metrics.json`."""

    @property
    def value(self) -> str:
        """The number with its unit."""

    @property
    def meaning(self) -> str:
        """One line."""

    @property
    def target(self) -> str:
        """Which value is good; empty if no value is better than another."""


class Tile(Protocol):
    """One of the few metrics that summarise a run."""

    @property
    def name(self) -> str:
        """In a few words."""

    @property
    def value(self) -> str:
        """The number with its unit."""

    @property
    def explanation(self) -> str:
        """What it measures, and which value is good."""


class RunData(Protocol):
    """The data of a run; each part raises `MissingError` if it is missing."""

    @property
    def experiment(self) -> Experiment:
        """The experiment."""

    @property
    def metrics(self) -> dict[str, Any]:
        """The metrics of the run; empty before the first stage is done."""

    @property
    def readings(self) -> Mapping[str, Sequence[Reading]]:
        """The metrics by section of the report."""

    @property
    def headline(self) -> Sequence[Tile]:
        """The few metrics that summarise the run."""

    @property
    def world(self) -> World:
        """The world of the experiment."""

    @property
    def robot(self) -> Robot:
        """Its robot."""

    @property
    def shape(self) -> RobotShape:
        """The shape of the robot."""

    def touches_at(self, q: np.ndarray) -> Touches:
        """The touches at configurations `(N, J)`."""

    @property
    def skins(self) -> Sequence[SkinSurface]:
        """The skins, each in the frame of its link."""

    @property
    def home(self) -> np.ndarray:
        """`(skins, 3, 4)` poses of the skins' links in the posture in which they are drawn."""

    @property
    def touch_density(self) -> Sequence[np.ndarray]:
        """`(V,)` touches / cm² at the vertices of each skin."""

    def touch_sample(self, count: int) -> TouchSample:
        """About `count` of the touches."""

    @property
    def representation(self) -> QuotientRepresentation:
        """What the agent has learned; embedded in the recovered body."""

    @property
    def body(self) -> Body:
        """The body that the agent recovered."""

    @property
    def true_distances(self) -> np.ndarray:
        """`(K, K)` m between the true places of kernels; NaN between those on different skins."""

    @property
    def recovered(self) -> Sequence[RecoveredSkin]:
        """The recovered parts, each on its skins at home."""

    @property
    def kernel_places(self) -> np.ndarray:
        """`(K, 3)` m, each kernel where the recovered body has it; NaN in fragments."""

    @property
    def life(self) -> LifeCurves:
        """The life of the agent."""

    def skins_of(self, kernels: np.ndarray) -> Sequence[int]:
        """Numbers of the true skins of some kernels, the most frequent first."""

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Start and goal of all plans from one sensation to another, in order."""

    @property
    def shown_pair(self) -> tuple[int, int]:
        """The plan to show: the longest executed one, or the longest of all."""

    def motion(self, *targets: int | str) -> Motion:
        """A plan, executed or not; the targets name it, in order."""

    def execution(self, *targets: int | str) -> Execution:
        """A plan that was executed."""
