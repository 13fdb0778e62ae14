"""What there is to show of a run, as everything here takes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.experiment import Experiment
from selftouch_drake.show.paths import SkinPath
from selftouch_drake.show.skins import SkinSurface


class MissingError(ValueError):
    """What was asked for is not there; the text says why, and what makes it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredPart:
    """A part of the body that the agent recovered, laid on the skins that it stands for.

    Attributes:
        skins: numbers of the skins that it is on.
        kernels: `(n,)` the kernels on it.
        places: `(N, 3)` m, the kernels and then the pieces of wide ones, with the skins at home.
        faces: `(F, 3)` indices into `places`, the fitted surface, outward.
        closed: whether the surface has no rim.
    """

    skins: tuple[int, ...]
    kernels: np.ndarray
    places: np.ndarray
    faces: np.ndarray
    closed: bool

    @property
    def positions(self) -> np.ndarray:
        """`(n, 3)` m, the kernels."""
        return self.places[: len(self.kernels)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotFigure:
    """A robot in one posture, in the world.

    Attributes:
        links: vertices `(V, 3)` m and faces `(F, 3)` of what the model draws of each link.
        rods: `(n, 2, 3)` m, ends of the links that the model draws nothing of.
        joints: `(J, 3)` m, where the moving joints are.
        turns: `(J,)` bool, whether each turns or slides.
        balls: `(B, 3)` m, centres of the balls that touch.
        radii: `(B,)` m.
    """

    links: Sequence[tuple[np.ndarray, np.ndarray]]
    rods: np.ndarray
    joints: np.ndarray
    turns: np.ndarray
    balls: np.ndarray
    radii: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLine:
    """A joint as the report lists it.

    Attributes:
        name: in the robot's model.
        turns: whether it turns (rad) or slides (m).
        lower: rad or m; infinite if it turns without limits.
        upper: the same.
    """

    name: str
    turns: bool
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinLine:
    """A skin as the report lists it.

    Attributes:
        name: as the experiment calls it.
        link: that wears it.
        area_cm2: of its outer surface.
        thickness_cm: of its wall.
        num_receptors: on it.
        touchers: names of what may touch it.
    """

    name: str
    link: str
    area_cm2: float
    thickness_cm: float
    num_receptors: int
    touchers: tuple[str, ...]


class Material(Protocol):
    """What there is to show of a run; each part raises `MissingError` where it is not there."""

    @property
    def experiment(self) -> Experiment:
        """The experiment."""

    @property
    def metrics(self) -> dict:
        """The metrics of the run; empty before the first stage is done."""

    @property
    def joint_lines(self) -> Sequence[JointLine]:
        """The robot's joints."""

    @property
    def skin_lines(self) -> Sequence[SkinLine]:
        """The robot's skins."""

    @property
    def skins(self) -> Sequence[SkinSurface]:
        """The skins, each in the frame of its link."""

    @property
    def home(self) -> np.ndarray:
        """`(skins, 3, 4)` poses of the skins' links in the posture in which they are drawn."""

    @property
    def num_touches(self) -> int:
        """Touches in the experience, of which the truth is there."""

    def contacts(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """All contacts in batches: `(C,)` skin, and `(C, 3)` m in the frame of its link."""

    @property
    def representation(self) -> QuotientRepresentation:
        """What the agent has learned."""

    @property
    def embedding(self) -> np.ndarray:
        """`(K, 3)` each kernel in the pose and unit of its own part; NaN in fragments."""

    @property
    def diagrams(self) -> Sequence[Sequence[np.ndarray]]:
        """Of each part the births and deaths `(bars, 2)` of components, loops and voids."""

    @property
    def true_distances(self) -> np.ndarray:
        """`(K, K)` m between the true places of kernels; NaN between those on different skins."""

    @property
    def recovered(self) -> Sequence[RecoveredPart]:
        """The recovered parts, each on its skins at home."""

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Start and goal of all plans from one sensation to another, in order."""

    @property
    def shown_pair(self) -> tuple[int, int]:
        """The plan that is shown: the longest of those executed, else the longest of all."""

    def motion(self, *targets: int | str) -> Motion:
        """A plan, executed or not; the targets name it, in order."""

    def execution(self, *targets: int | str) -> Execution:
        """A plan that was executed."""

    def joint_positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, J, 3)` m, the joints in the world at `q` `(N, J)`."""

    def skin_poses(self, q: np.ndarray) -> np.ndarray:
        """`(N, skins, 3, 4)` poses of the skins' links in the world at `q` `(N, J)`."""

    def robot(self, q: np.ndarray) -> RobotFigure:
        """The robot at `(J,)` q."""

    def paths(self, q: np.ndarray, touching: np.ndarray | None = None) -> list[SkinPath]:
        """What touches, over the skins that it slides on, along a motion `(T, J)`.

        Args:
            q: motor configurations.
            touching: `(T,)` bool, where touch is expected; elsewhere there is no path.
        """
