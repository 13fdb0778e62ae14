"""A system that shows sensations in Meshcat, live and in recordings."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from selftouch_drake.robot import TactileSkin, WornSkin
from selftouch_drake.show.meshcat.skin_drawing import SkinDrawing
from selftouch_drake.show.skins import surfaces_of
from selftouch_drake.show.style import FIRM

# s between two frames.
_PERIOD_S = 1 / 32


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

    - sensation: `(S,)` N, of a `TactileSkin`, or of a `SkinReadout` behind it.
    - body_poses: `list[RigidTransform]` of the plant.

    Like Drake's visualizers it shows, and keeps, what the last published context holds.

    Args:
        worn: the skins, of `AddSkins`; with its `visible=False` they are not drawn twice.
        full: N, the reading that is shown in the strongest colour.
    """

    def __init__(self, meshcat: Meshcat, worn: Sequence[WornSkin], *, full: float = FIRM):
        super().__init__()
        self._meshcat, self._full = meshcat, full
        self._links = [int(w.link.index()) for w in worn]
        surfaces = surfaces_of([w.model for w in worn])
        self._drawing = SkinDrawing(meshcat, "/tactile_skin/skins", surfaces)
        num_receptors = sum(len(surface.receptors) for surface in surfaces)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        # s, poses of the links, and sensation of each.
        self._frames: list[tuple[float, np.ndarray, np.ndarray]] = []
        self.DeclarePeriodicPublishEvent(_PERIOD_S, 0.0, self._publish)
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

    def AddToRecording(self) -> None:
        """Adds all frames to Meshcat's recording: call it before `PublishRecording`.

        Raises:
            ValueError: nothing was published yet.
        """
        if not self._frames:
            raise ValueError("nothing was published; simulate before AddToRecording")
        recording = self._meshcat.get_mutable_recording()
        time_s, poses, sensation = map(np.array, zip(*self._frames, strict=True))
        frames_s = np.arange(recording.frame(time_s[-1]) + 1) / recording.frames_per_second()
        rows = (np.searchsorted(time_s, frames_s + 1e-6, side="right") - 1).clip(0)
        self._drawing.record(recording, poses[rows], sensation[rows] / self._full)

    def _publish(self, context):
        X_WB = self._poses.Eval(context)
        poses = np.array([X_WB[link].GetAsMatrix34() for link in self._links])
        sensation = self._sensation.Eval(context)
        # If time restarts, the frames restart.
        while self._frames and self._frames[-1][0] >= context.get_time():
            self._frames.pop()
        self._frames.append((context.get_time(), poses, sensation))
        self._drawing.move(poses)
        self._drawing.show(sensation / self._full)
