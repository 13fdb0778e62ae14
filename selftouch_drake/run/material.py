"""What there is to show of a run: each part read when first asked for, or missing with a reason."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.shape import fitted_surface, topology
from selftouch_drake.evaluation import align, kernel_positions
from selftouch_drake.experience import ExperienceReader, StoreError, require_complete
from selftouch_drake.files import load_arrays
from selftouch_drake.geometry import HollowSkin, ReceptiveFields, build_body
from selftouch_drake.robot.agent import Agent, MakeAgent
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.motions import load_plan


class MissingError(RunError):
    """What was asked for was not made yet; the text says what, and what makes it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BodySurface:
    """The outer surface of the body.

    Attributes:
        p_BS: `(S, 3)` m, receptors.
        vertices: `(V, 3)` m.
        faces: `(F, 3)` indices, outward.
    """

    p_BS: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray


class Material:
    """Everything that figures, report and playback are made of.

    Args:
        run: the run.

    Raises:
        MissingError: by every property whose stage has not run.
    """

    def __init__(self, run: RunDirectory):
        self.run = run

    def require_sound(self) -> None:
        """Reads every file that there is, before anything is made of any.

        Raises:
            ValueError: one is damaged, or of another experiment.
        """
        for name in ("metrics", "skin", "representation", "diagrams", "truth", "kernel_p_WF"):
            with contextlib.suppress(MissingError):
                getattr(self, name)
        for pair in self.pairs:
            self.plan(*pair)

    @cached_property
    def metrics(self) -> dict:
        """The figures of the run."""
        return self.run.metrics()

    @cached_property
    def skin(self) -> BodySurface:
        """The outer surface and its receptors."""
        names = ("p_BS", "vertices", "faces")
        arrays = self._arrays(self.run.skin, names, "the skin", "babble")
        # Runs of before the stamp have none.
        stamp = self.run.body_stamp()
        if str((stamp | arrays)["made_for"]) != str(stamp["made_for"]):
            raise RunError(
                f"{self.run.skin} is of another experiment or version; run `selftouch babble "
                f"{self.run.path / 'experiment.yaml'} --out {self.run.path}`"
            )
        return BodySurface(**{name: arrays[name] for name in names})

    @cached_property
    def body(self) -> tuple[HollowSkin, ReceptiveFields]:
        """The hollow skin and its receptive fields, built anew from the experiment."""
        return build_body(self.run.experiment)

    @property
    def truth(self) -> ExperienceReader:
        """The true fingertip positions `p_WF` of the experience."""
        if not any(self.run.truth.glob("part-*.parquet")):
            raise MissingError("the truth is not there; run `selftouch babble`")
        reader = ExperienceReader(self.run.truth)
        reader.num_rows  # noqa: B018 - refuses damaged shards
        return reader

    @cached_property
    def representation(self) -> QuotientRepresentation:
        """What the agent has learned."""
        if not self.run.representation.exists():
            raise MissingError("nothing was learned yet; run `selftouch learn`")
        representation = QuotientRepresentation.load(self.run.representation)
        self.run.require_stamp(self.run.representation)
        return representation

    @cached_property
    def diagrams(self) -> list[np.ndarray]:
        """Births and deaths `(bars, 2)` of components, loops and voids."""
        names = [f"diagram_{dimension}" for dimension in range(3)]
        arrays = self._arrays(self.run.topology, names, "the persistence of holes", "learn")
        self.run.require_stamp(self.run.topology, arrays)
        return [arrays[name] for name in names]

    @cached_property
    def kernel_p_WF(self) -> np.ndarray:
        """`(R, 3 * fingers)` m, true fingertip positions in each configuration of the kernels."""
        try:
            require_complete(self.run, truth=True)
        except StoreError as error:
            raise MissingError(str(error)) from None
        return self.truth.take("p_WF", self.representation.kernel_row)

    @cached_property
    def kernel_positions(self) -> np.ndarray:
        """`(K, 3)` m, where each kernel truly puts the first fingertip."""
        return kernel_positions(self.representation, self.kernel_p_WF)

    @cached_property
    def embedding(self) -> np.ndarray:
        """`(K, 3)` the kernels as the agent lays them out, any unit."""
        embedding = self.representation.embedding
        if not np.isfinite(embedding).all():
            raise MissingError("the representation is not embedded; run `selftouch learn`")
        return embedding

    @cached_property
    def recovered(self) -> tuple[np.ndarray, np.ndarray]:
        """The recovered body, aligned with the real one: where it is, and its fitted surface.

        `(N, 3)` m, the kernels and then the parts of wide ones, and `(F, 3)` corners.
        """
        if self.run.experiment.num_fingers > 1:
            raise MissingError(
                "with two fingers the quotient space is not the body's surface (paper, section IV)"
            )
        parts = self._arrays(self.run.topology, ["parts"], "the persistence of holes", "learn")
        places = np.concatenate([self.embedding, parts["parts"]])
        faces = fitted_surface(places, topology(places).scale)
        if not len(faces):
            raise MissingError("no closed surface goes through the recovered body; babble longer")
        aligned = align(self.embedding, self.kernel_positions, places)
        a, b, c = aligned[faces].transpose(1, 0, 2)
        mirrored = np.einsum("fi,fi->", np.cross(a, b), c) < 0
        return aligned, faces[:, ::-1] if mirrored else faces

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Start and goal of all plans, in order."""
        names = (path.stem.split("-") for path in (self.run.path / "plans").glob("*-*.npz"))
        return sorted((int(n[0]), int(n[1])) for n in names if len(n) == 2 and all(map(_digits, n)))

    def plan(self, *targets: int | str) -> dict[str, np.ndarray]:
        """The arrays of a plan, executed or not; the targets name it, in order."""
        if not (file := self.run.plan(*targets)).exists():
            raise MissingError(f"plan {file.stem} is not there; run `selftouch plan`")
        return load_plan(self.run, *targets)

    def executed(self, *targets: int | str) -> dict[str, np.ndarray]:
        """The arrays of a plan that was executed."""
        plan = self.plan(*targets)
        if not {"felt", "q_measured"} <= plan.keys():
            name = self.run.plan(*targets).stem
            raise MissingError(f"plan {name} was not executed; run `selftouch execute`")
        return plan

    @cached_property
    def shown_pair(self) -> tuple[int, int]:
        """The plan that is shown: the longest of those executed, else the longest of all."""
        if not self.pairs:
            raise MissingError("nothing was planned yet; run `selftouch plan`")

        def length(pair: tuple[int, int]) -> tuple[bool, int]:
            plan = self.plan(*pair)
            return "felt" in plan, len(plan["nodes"])

        return max(self.pairs, key=length)

    def fingertips(self, q: np.ndarray) -> np.ndarray:
        """`(N, fingers, 3)` m, fingertips in the world at `q` `(N, J)` rad."""
        return self._frames(q)[:, self._num_joints :]

    def joints(self, q: np.ndarray) -> np.ndarray:
        """`(N, J, 3)` m, joints in the world at `q` `(N, J)` rad, from the shoulder on."""
        return self._frames(q)[:, : self._num_joints]

    @property
    def _num_joints(self) -> int:
        return self._agent.plant.num_positions()

    @cached_property
    def _agent(self) -> Agent:
        return MakeAgent(self.run.experiment, self.body[0], SceneGraph())

    def _frames(self, q: np.ndarray) -> np.ndarray:
        plant, context = self._agent.plant, self._agent.plant.CreateDefaultContext()
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(self._agent.arm)]
        frames = [joint.frame_on_parent() for joint in joints if joint.num_positions() == 1]
        frames += self._agent.fingertips
        positions = np.empty((len(q), len(frames), 3))
        for row, configuration in enumerate(q):
            plant.SetPositions(context, configuration)
            positions[row] = [frame.CalcPoseInWorld(context).translation() for frame in frames]
        return positions

    def _arrays(self, path: Path, names, what: str, verb: str) -> dict[str, np.ndarray]:
        try:
            return load_arrays(path, names)
        except FileNotFoundError:
            raise MissingError(f"{what} is not there; run `selftouch {verb}`") from None


def _digits(text: str) -> bool:
    return text.isascii() and text.isdigit()
