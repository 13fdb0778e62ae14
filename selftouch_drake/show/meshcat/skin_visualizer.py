"""A system that shows sensations in Meshcat, live and in recordings."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import ContactSurface, Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.robot import TactileSkin, WornSkin
from selftouch_drake.show.meshcat.skin_drawing import SkinDrawing, key_frames
from selftouch_drake.show.skins import surfaces_of
from selftouch_drake.show.style import FIRM, PRESSURE

# s between two frames.
PERIOD_S = 1 / 32
# m; a patch that moved less than this is not drawn again.
_STILL = 2e-4
# m, distance between a drawn patch and its rigid surface, so that neither hides the other.
_LIFT = 5e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """Contact surfaces as one mesh.

    Attributes:
        vertices: `(V, 3)` m, in the world.
        faces: `(F, 3)` indices; a triangle for each side of each.
        pressure: `(V,)` Pa.
    """

    vertices: np.ndarray
    faces: np.ndarray
    pressure: np.ndarray

    @staticmethod
    def of(surfaces: Sequence[ContactSurface]) -> Patch | None:
        """Joins contact surfaces; None if there are none."""
        if not surfaces:
            return None
        vertices: list[np.ndarray] = []
        faces: list[list[int]] = []
        pressure: list[float] = []
        for surface in surfaces:
            mesh = surface.tri_mesh_W() if surface.is_triangle() else surface.poly_mesh_W()
            field = surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()
            for number in range(mesh.num_faces()):
                face = mesh.element(number)
                corners = [face.vertex(i) for i in range(face.num_vertices())]
                normal = _LIFT * mesh.face_normal(number)
                for side in (1.0, -1.0):
                    first = len(vertices)
                    for b, c in itertools.pairwise(range(first + 1, first + len(corners))):
                        faces.append([first, b, c] if side > 0 else [first, c, b])
                    vertices += [mesh.vertex(v) + side * normal for v in corners]
                    pressure += [field.EvaluateAtVertex(v) for v in corners]
        return Patch(
            vertices=np.array(vertices), faces=np.array(faces), pressure=np.array(pressure)
        )

    def is_like(self, other: Patch) -> bool:
        """Whether the difference is too small to be seen."""
        return self.vertices.shape == other.vertices.shape and bool(
            np.abs(self.vertices - other.vertices).max() < _STILL
        )

    def draw(self, meshcat: Meshcat, path: str) -> None:
        """Draws it, the highest pressure in the strongest colour."""
        share = self.pressure / max(self.pressure.max(), 1e-12)
        colors = PRESSURE(share)[:, :3]
        meshcat.SetTriangleColorMesh(path, self.vertices.T, self.faces.T, colors.T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Frame:
    time_s: float
    poses: np.ndarray
    sensation: np.ndarray
    patch: Patch | None


class SkinVisualizer(LeafSystem):
    """Shows skins in Meshcat: colours on receptors, and the patches where they are pressed.

    Drake does not record what changes its shape (issues 19142 and 23206), nor play back colours
    that were set while it recorded. This system keeps its frames, and adds them to a recording when
    it is asked to: a patch is then an object of its own for each moment, which shows only then.

    .. pydrake_system::

        name: SkinVisualizer
        input_ports:
        - sensation
        - contact_results
        - body_poses

    - sensation: `(S,)` N, of a `TactileSkin`, or of a `SkinReadout` behind it.
    - contact_results: `ContactResults` of the plant.
    - body_poses: `list[RigidTransform]` of the plant.

    Like Drake's visualizers it shows, and keeps, what the last published context holds.

    Args:
        meshcat: where.
        worn: the skins, of `AddSkins`; with its `visible=False` they are not drawn twice.
        full: N, the reading that is shown in the strongest colour.
        period_s: s, from frame to frame.
        root: the path in Meshcat of all that is drawn.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        worn: Sequence[WornSkin],
        *,
        full: float = FIRM,
        period_s: float = PERIOD_S,
        root: str = "/tactile_skin",
    ):
        super().__init__()
        self._meshcat, self._full, self._root = meshcat, full, root
        self._links = [int(w.link.index()) for w in worn]
        self._skin_ids = frozenset(w.geometry_id for w in worn)
        surfaces = surfaces_of([w.model for w in worn])
        self._drawing = SkinDrawing(meshcat, f"{root}/skins", surfaces)
        self._sensation = self.DeclareVectorInputPort(
            "sensation", sum(len(surface.receptors) for surface in surfaces)
        )
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self._frames: list[_Frame] = []
        self.DeclarePeriodicPublishEvent(period_s, 0.0, self._publish)
        self.DeclareForcedPublishEvent(self._publish)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        worn: Sequence[WornSkin],
        touch: TactileSkin,
        meshcat: Meshcat,
        *,
        full: float = FIRM,
        period_s: float = PERIOD_S,
    ) -> SkinVisualizer:
        """Adds a visualizer to a diagram and connects it.

        Args:
            builder: of the diagram.
            plant: in the diagram.
            worn: of `AddSkins`.
            touch: of `AddTactileSkin`, for the same skins.
            meshcat: where.
            full: as in the constructor.
            period_s: as in the constructor.
        """
        show = SkinVisualizer(meshcat, worn, full=full, period_s=period_s)
        builder.AddNamedSystem("skin_visualizer", show)
        builder.Connect(touch.GetOutputPort("sensation"), show.GetInputPort("sensation"))
        contact = plant.get_contact_results_output_port()
        builder.Connect(contact, show.GetInputPort("contact_results"))
        builder.Connect(plant.get_body_poses_output_port(), show.GetInputPort("body_poses"))
        return show

    def AddToRecording(self) -> None:
        """Adds all frames to Meshcat's recording: call it before `PublishRecording`.

        Raises:
            ValueError: nothing was published yet.
        """
        if not self._frames:
            raise ValueError("nothing was published; simulate before AddToRecording")
        recording = self._meshcat.get_mutable_recording()
        time_s = [frame.time_s for frame in self._frames]
        frames_s = np.arange(recording.frame(time_s[-1]) + 1) / recording.frames_per_second()
        rows = np.searchsorted(time_s, frames_s + 1e-6, side="right") - 1
        shown = [self._frames[row] for row in rows.clip(0)]
        self._drawing.record(
            recording,
            np.array([frame.poses for frame in shown]),
            np.array([frame.sensation for frame in shown]) / self._full,
        )
        self._meshcat.Delete(self._patch_path)
        self._meshcat.Delete(f"{self._root}/patches")
        number = np.full(len(shown), -1)
        patches: list[Patch] = []
        for frame, each in enumerate(shown):
            if each.patch is None:
                continue
            if frame == 0 or number[frame - 1] < 0 or not each.patch.is_like(patches[-1]):
                patches.append(each.patch)
            number[frame] = len(patches) - 1
        for k, patch in enumerate(patches):
            path = f"{self._root}/patches/{k}"
            patch.draw(self._meshcat, path)
            self._meshcat.SetProperty(path, "visible", False)
            visible = number == k
            for frame in key_frames(visible):
                recording.SetProperty(frame, path, "visible", bool(visible[frame]))

    @property
    def _patch_path(self) -> str:
        return f"{self._root}/patch"

    def _publish(self, context):
        contact = self._contact.Eval(context)
        surfaces = [
            contact.hydroelastic_contact_info(i).contact_surface()
            for i in range(contact.num_hydroelastic_contacts())
        ]
        poses = self._poses.Eval(context)
        frame = _Frame(
            time_s=context.get_time(),
            poses=np.array([poses[link].GetAsMatrix34() for link in self._links]),
            sensation=self._sensation.Eval(context),
            patch=Patch.of([s for s in surfaces if {s.id_M(), s.id_N()} & self._skin_ids]),
        )
        # If time restarts, the frames restart.
        while self._frames and self._frames[-1].time_s >= frame.time_s:
            self._frames.pop()
        self._frames.append(frame)
        self._drawing.move(frame.poses)
        self._drawing.show(frame.sensation / self._full)
        if frame.patch is None:
            self._meshcat.Delete(self._patch_path)
        else:
            frame.patch.draw(self._meshcat, self._patch_path)
