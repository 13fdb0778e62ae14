"""A system that shows sensations in Meshcat, live and in recordings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatAnimation, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.colors import FIRM, VERMILION
from selftouch_drake.robot.pairs import WornSkin
from selftouch_drake.robot.skin_surface import surfaces_of
from selftouch_drake.systems.skin_drawing import SkinDrawing, rgba
from selftouch_drake.systems.tactile_skin import TactileSkin

# s between two frames.
_PERIOD_S = 1 / 32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ball:
    """A ball that touches, on a link.

    Attributes:
        link: number of the link.
        p_LB: `(3,)` m, its centre in the frame of the link.
        radius: m.
    """

    link: int
    p_LB: np.ndarray
    radius: float


class SkinVisualizer(LeafSystem):
    """Shows skins in Meshcat, with colours on their receptors.

    Drake does not play back colours that were set while it recorded. This system keeps its frames,
    and adds them to a recording when it is asked to. Drake's own `ContactVisualizer` draws the
    patches where skins are pressed.

    .. pydrake_system::

        name: SkinVisualizer
        input_ports:
        - sensation
        - body_poses

    =============== ======== ==== ==== ======================================================
    port            type     size unit what
    =============== ======== ==== ==== ======================================================
    sensation (in)  vector   S    N    of a `TactileSkin`, or of a `SkinReadout` behind it
    body_poses (in) abstract      m    `list[RigidTransform]` of the plant, X_WB
    =============== ======== ==== ==== ======================================================

    Like Drake's visualizers it shows, and keeps, what the last published context holds.

    Args:
        worn: the skins, of `AddSkins`; with its `visible=False` they are not drawn twice.
        full: N, the reading that is shown in the strongest colour.
        balls: that touch, to be shown as well.
        root: path in Meshcat of the skins.
        period_s: s between two frames.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        worn: Sequence[WornSkin],
        *,
        full: float = FIRM,
        balls: Sequence[Ball] = (),
        root: str = "/tactile_skin/skins",
        period_s: float = _PERIOD_S,
    ):
        super().__init__()
        self._meshcat, self._full = meshcat, full
        self._balls = {f"/touching/{number}": ball for number, ball in enumerate(balls)}
        for path, ball in self._balls.items():
            # A little larger than what the model may draw of it.
            meshcat.SetObject(path, Sphere(1.02 * ball.radius), rgba(VERMILION))
        self._links = [int(w.link.index()) for w in worn]
        surfaces = surfaces_of([w.model for w in worn])
        self._drawing = SkinDrawing(meshcat, root, surfaces)
        num_receptors = sum(len(surface.receptors) for surface in surfaces)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        # s, poses of the links, sensation and centres of the balls of each.
        self._frames: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
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
    ) -> "SkinVisualizer":
        """Adds a visualizer to a diagram and connects it to the sensor `touch` of the skins."""
        show = SkinVisualizer(meshcat, worn, full=full)
        builder.AddNamedSystem("skin_visualizer", show)
        builder.Connect(touch.GetOutputPort("sensation"), show.GetInputPort("sensation"))
        builder.Connect(plant.get_body_poses_output_port(), show.GetInputPort("body_poses"))
        return show

    @property
    def last_sensation(self) -> np.ndarray:
        """`(S,)` N, as it was last shown; an IndexError if nothing was."""
        return self._frames[-1][2]

    def AddToRecording(self) -> None:
        """Adds all frames to Meshcat's recording: call it before `PublishRecording`.

        Raises:
            ValueError: nothing was published yet.
        """
        if not self._frames:
            raise ValueError("nothing was published; simulate before AddToRecording")
        recording = self._meshcat.get_mutable_recording()
        time_s, poses, sensation, centres = map(np.array, zip(*self._frames, strict=True))
        frames_s = np.arange(recording.frame(time_s[-1]) + 1) / recording.frames_per_second()
        rows = (np.searchsorted(time_s, frames_s + 1e-6, side="right") - 1).clip(0)
        self.Record(recording, poses[rows], sensation[rows], centres[rows])

    def Record(
        self,
        recording: MeshcatAnimation,
        poses: np.ndarray,
        sensation: np.ndarray,
        centres: np.ndarray,
    ) -> None:
        """Adds frames to a recording, of this simulation or of one before.

        Args:
            recording: to add them to.
            poses: `(frames, skins, 3, 4)` of the links that wear skins, in the world.
            sensation: `(frames, S)` N.
            centres: `(frames, balls, 3)` m, in the world.
        """
        self._drawing.record(recording, poses, sensation / self._full)
        for number, path in enumerate(self._balls):
            for frame, centre in enumerate(centres[:, number]):
                recording.SetTransform(frame, path, RigidTransform(centre))

    def _publish(self, context):
        X_WB = self._poses.Eval(context)
        poses = np.array([X_WB[link].GetAsMatrix34() for link in self._links])
        sensation = self._sensation.Eval(context)
        # If time restarts, the frames restart.
        while self._frames and self._frames[-1][0] >= context.get_time():
            self._frames.pop()
        balls = self._balls.values()
        centres = np.array([X_WB[ball.link] @ ball.p_LB for ball in balls]).reshape(-1, 3)
        self._frames.append((context.get_time(), poses, sensation, centres))
        for path, centre in zip(self._balls, centres, strict=True):
            self._meshcat.SetTransform(path, RigidTransform(centre))
        self._drawing.move(poses)
        self._drawing.show(sensation / self._full)
