"""All data of a run for pictures and pages; each part is loaded at its first use."""

import contextlib
from functools import cached_property

import numpy as np

from selftouch_drake.agent.body_model.growth import Growth
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.motions import Execution
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.shape.recovery import RecoveredBody
from selftouch_drake.evaluation.coverage import touch_density
from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.evaluation.parts import TouchCounts
from selftouch_drake.evaluation.shape import KernelTruth, kernel_truth
from selftouch_drake.experience.collect import require_complete
from selftouch_drake.experience.store import ExperienceReader, StoreError
from selftouch_drake.experiment import ExperimentError
from selftouch_drake.files import load_arrays
from selftouch_drake.robot import World
from selftouch_drake.run.artifacts import (
    load_body,
    load_body_model,
    load_execution,
    load_motion,
    load_representation,
    stored_pairs,
    was_executed,
)
from selftouch_drake.run.directory import MissingError, RunDirectory
from selftouch_drake.run.stages import make_world
from selftouch_drake.run.worlds import require_robot
from selftouch_drake.show.recovered import RecoveredSkin, laid_on_skins, laid_out
from selftouch_drake.show.skins import SkinSurface, all_moved, surfaces_of

#: The targets that name a plan, in order; the first is a text if it begins in any configuration.
Targets = tuple[int | str, ...]


class NoSurfaceError(MissingError):
    """The recovered body is not a surface in space, so it has no picture."""


class RunData:
    """The data of a run behind figures, report, recording and live play.

    Raises:
        MissingError: by every part whose stage has not run.
    """

    def __init__(self, run: RunDirectory):
        self.run = run

    def require_sound(self) -> None:
        """Reads all files, before anything is drawn.

        Raises:
            ValueError: one is damaged, or of another experiment.
        """
        self.run.metrics()
        for name in ("skins", "representation", "body", "model", "kernel_truth"):
            with contextlib.suppress(MissingError):
                getattr(self, name)
        with contextlib.suppress(MissingError):
            self._truth.num_rows  # noqa: B018 - refuses damaged shards
        for pair in stored_pairs(self.run):
            load_motion(self.run, *pair)

    @cached_property
    def world(self) -> World:
        """The world of the experiment."""
        require_robot(self.run.experiment)
        try:
            return make_world(self.run)
        except ExperimentError as error:
            raise MissingError(str(error)) from None

    @cached_property
    def skins(self) -> tuple[SkinSurface, ...]:
        """The skins, each in the frame of its link."""
        return surfaces_of(self.world.skins)

    @cached_property
    def home(self) -> np.ndarray:
        """`(skins, 3, 4)` poses of the skins' links in the default posture of the model."""
        robot = self.world.robot
        q = robot.plant.GetPositions(robot.plant.CreateDefaultContext())
        return robot.skin_positions(q[None])[0]

    @property
    def skins_at_home(self) -> list[SkinSurface]:
        """The skins where they are drawn."""
        return all_moved(self.skins, self.home)

    @cached_property
    def touch_density(self) -> list[np.ndarray]:
        """`(V,)` touches / cm² at the vertices of each skin."""
        counted = TouchCounts([skin.fields for skin in self.world.skins], self._truth.contacts())
        return [
            touch_density(skin.vertices, skin.faces, counts)
            for skin, counts in zip(self.skins, counted.counts, strict=True)
        ]

    @cached_property
    def representation(self) -> EmbeddedRepresentation:
        """What the agent has learned."""
        return load_representation(self.run)

    @cached_property
    def body(self) -> RecoveredBody:
        """The body that the agent recovered."""
        return load_body(self.run, self.representation)

    @cached_property
    def model(self) -> BodyModel:
        """What the agent found out about the mechanics of its body, accepted or not."""
        return load_body_model(self.run)

    @property
    def accepted_model(self) -> BodyModel:
        """The same, if the agent accepted it on some part."""
        if not self.model.accepted_by_part.any():
            raise MissingError(f"the agent has no model of its body: {self.model.reason}")
        return self.model

    @cached_property
    def kernel_truth(self) -> KernelTruth:
        """The true places of the kernels."""
        require_robot(self.run.experiment)
        representation, run = self.representation, self.run
        try:
            require_complete(run.experiment, run.path, fingerprint=run.fingerprint(), truth=True)
        except StoreError as error:
            raise MissingError(str(error)) from None
        contacts = self._truth.take_contacts(representation.kernel_row)
        return kernel_truth(representation, contacts, self.world.receptor_skin)

    @cached_property
    def recovered(self) -> tuple[RecoveredSkin, ...]:
        """The recovered parts, each on its skins at home; side by side if these are unknown."""
        if not self.run.experiment.has_truth:
            if parts := laid_out(self.body):
                return parts
            raise MissingError("no surface goes through the recovered body; record more touches")
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
        return LifeCurves.from_arrays(self._life_arrays)

    @cached_property
    def growth(self) -> Growth:
        """How the model of its body grew in the life of the agent."""
        arrays = self._life_arrays
        if Growth.prefix + "touches" not in arrays:
            raise MissingError(
                "the life of the agent has no body model: set representation.body_model to auto, "
                f"and run `selftouch live {self.run.path}`"
            )
        return Growth.from_arrays(arrays)

    @cached_property
    def _life_arrays(self) -> dict[str, np.ndarray]:
        remedy = f"run `selftouch live {self.run.path}`"
        if not self.run.life.exists():
            raise MissingError(f"the life of the agent is missing; {remedy}")
        arrays = load_arrays(self.run.life)
        self.run.require_stamp(self.run.life, arrays, remedy=remedy)
        return arrays

    @cached_property
    def shown_pair(self) -> tuple[int, int]:
        """The plan to show: the longest executed one, or the longest of all."""
        run = self.run
        lengths = {pair: len(load_motion(run, *pair).plan.nodes) for pair in stored_pairs(run)}
        if not lengths:
            raise MissingError("nothing has been planned yet; run `selftouch plan`")
        return max(lengths, key=lambda pair: (was_executed(run, *pair), lengths[pair]))

    def execution(self, *targets: int | str) -> Execution:
        """A plan that was executed."""
        require_robot(self.run.experiment)
        return load_execution(self.run, *targets)

    @property
    def _truth(self) -> ExperienceReader:
        """The true places of the touches."""
        require_robot(self.run.experiment)
        if not any(self.run.truth.glob("part-*.parquet")):
            raise MissingError("the truth is missing; run `selftouch babble`")
        return ExperienceReader(self.run.truth)
