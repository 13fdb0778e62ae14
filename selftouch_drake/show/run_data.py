"""All data of a run for pictures and pages; each part is loaded at its first use."""

from __future__ import annotations

import contextlib
from functools import cached_property
from typing import Any

import numpy as np

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.shape import Body
from selftouch_drake.evaluation import (
    KernelTruth,
    TouchCounts,
    kernel_truth,
    touch_density,
)
from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.experience import ExperienceReader, StoreError, require_complete
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import load_arrays
from selftouch_drake.robot import Robot, Touches, World
from selftouch_drake.robot.models import ModelError
from selftouch_drake.run.artifacts import (
    load_body,
    load_execution,
    load_motion,
    load_representation,
    stored_pairs,
    was_executed,
)
from selftouch_drake.run.directory import MissingError, RunDirectory
from selftouch_drake.run.stages import make_world
from selftouch_drake.run.worlds import require_robot
from selftouch_drake.show.recovered import RecoveredSkin, laid_on_skins, skins_of
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.skins import SkinSurface, surfaces_of

#: The targets that name a plan, in order; the first is a text if it begins in any configuration.
Targets = tuple[int | str, ...]


class NoSurfaceError(MissingError):
    """The recovered body is not a surface in space, so it has no picture."""


class RunData:
    """The data behind figures, report, recording and live play.

    Args:
        run: the run.
        world: its world, if it was built already.

    Raises:
        MissingError: by every part whose stage has not run.
    """

    def __init__(self, run: RunDirectory, world: World | None = None):
        self.run = run
        self._known_world = world

    def require_sound(self) -> None:
        """Reads all files, before anything is drawn.

        Raises:
            ValueError: one is damaged, or of another experiment.
        """
        for name in ("metrics", "skins", "representation", "body", "kernel_truth"):
            with contextlib.suppress(MissingError):
                getattr(self, name)
        with contextlib.suppress(MissingError):
            self._truth.num_rows  # noqa: B018 - refuses damaged shards
        for pair in self.pairs:
            self.motion(*pair)

    @property
    def experiment(self) -> Experiment:
        """The experiment of the run."""
        return self.run.experiment

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The metrics of the run; empty before the first stage is done."""
        return self.run.metrics()

    @cached_property
    def world(self) -> World:
        """The world of the experiment."""
        require_robot(self.experiment)
        if self._known_world is not None:
            return self._known_world
        try:
            return make_world(self.run)
        except ModelError as error:
            raise MissingError(str(error)) from None

    @property
    def robot(self) -> Robot:
        """The robot of its world."""
        return self.world.robot

    @cached_property
    def shape(self) -> RobotShape:
        """The shape of the robot, as it is drawn."""
        return RobotShape(self.robot, self.experiment.touching)

    def touches_at(self, q: np.ndarray) -> Touches:
        """The touches at configurations `(N, J)`."""
        return self.world.probe.touches(q)

    @cached_property
    def skins(self) -> tuple[SkinSurface, ...]:
        """The skins, each in the frame of its link."""
        return surfaces_of(self.world.skins)

    @cached_property
    def home(self) -> np.ndarray:
        """`(skins, 3, 4)` poses of the skins' links in the default posture of the model."""
        plant = self.robot.plant
        q = plant.GetPositions(plant.CreateDefaultContext())
        return self.robot.skin_positions(q[None])[0]

    @cached_property
    def touch_density(self) -> list[np.ndarray]:
        """`(V,)` touches / cm² at the vertices of each skin."""
        return [
            touch_density(skin.vertices, skin.faces, counts)
            for skin, counts in zip(self.skins, self._touch_counts.counts, strict=True)
        ]

    @cached_property
    def representation(self) -> QuotientRepresentation:
        """What the agent has learned."""
        return load_representation(self.run)

    @cached_property
    def body(self) -> Body:
        """The body that the agent recovered."""
        return load_body(self.run, self.representation)

    @cached_property
    def kernel_truth(self) -> KernelTruth:
        """The true places of the kernels."""
        require_robot(self.experiment)
        representation, run = self.representation, self.run
        try:
            require_complete(run.experiment, run.path, fingerprint=run.fingerprint(), truth=True)
        except StoreError as error:
            raise MissingError(str(error)) from None
        return kernel_truth(representation, self._truth.take_contacts(representation.kernel_row))

    @cached_property
    def recovered(self) -> tuple[RecoveredSkin, ...]:
        """The recovered parts, each on its skins at home."""
        truth = self.kernel_truth
        if not truth.is_surface:
            raise NoSurfaceError(
                f"{1 - truth.share_single:.0%} of the touches are at several places at once, so a "
                "kernel is a pose of the hand and not a place on the skin (paper, section IV)"
            )
        parts = laid_on_skins(self.body, truth, self.skins, self.home)
        if not parts:
            raise MissingError("no surface goes through the recovered body; babble longer")
        return parts

    @cached_property
    def kernel_places(self) -> np.ndarray:
        """`(K, 3)` m, each kernel where the recovered body has it; NaN in fragments."""
        places = np.full((self.representation.num_targets, 3), np.nan)
        for part in self.recovered:
            places[self.body.parts[part.part].kernels] = part.positions
        return places

    @cached_property
    def life(self) -> LifeCurves:
        """The life of the agent."""
        remedy = f"run `selftouch live {self.run.path}`"
        if not self.run.life.exists():
            raise MissingError(f"the life of the agent is missing; {remedy}")
        arrays = load_arrays(self.run.life)
        self.run.require_stamp(self.run.life, arrays, remedy=remedy)
        return LifeCurves.from_arrays(arrays)

    def skins_of(self, kernels: np.ndarray) -> tuple[int, ...]:
        """Numbers of the true skins of some kernels, the most frequent first."""
        return skins_of(kernels, self.kernel_truth)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Start and goal of all plans from one sensation to another, in order."""
        return stored_pairs(self.run)

    @cached_property
    def shown_pair(self) -> tuple[int, int]:
        """The plan to show: the longest executed one, or the longest of all."""
        if not self.pairs:
            raise MissingError("nothing has been planned yet; run `selftouch plan`")

        def length(pair: tuple[int, int]) -> tuple[bool, int]:
            return was_executed(self.run, *pair), len(self.motion(*pair).plan.nodes)

        return max(self.pairs, key=length)

    def motion(self, *targets: int | str) -> Motion:
        """A plan, executed or not; the targets name it, in order."""
        return load_motion(self.run, *targets)

    def execution(self, *targets: int | str) -> Execution:
        """A plan that was executed."""
        require_robot(self.experiment)
        return load_execution(self.run, *targets)

    @property
    def _truth(self) -> ExperienceReader:
        """The true places of the touches."""
        require_robot(self.experiment)
        if not any(self.run.truth.glob("part-*.parquet")):
            raise MissingError("the truth is missing; run `selftouch babble`")
        return ExperienceReader(self.run.truth)

    @cached_property
    def _touch_counts(self) -> TouchCounts:
        fields = [skin.fields for skin in self.world.skins]
        return TouchCounts(fields, self._truth.contacts())
