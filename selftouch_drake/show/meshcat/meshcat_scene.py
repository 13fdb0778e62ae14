"""The scene in Meshcat, live and in recordings: the robot's skins three times, side by side.

In the middle are the real skins on the robot; their receptors show the sensation. On the left the
same skins show the sensation that the agent expects. On the right is the recovered body, with the
sensation marked in red. Meshcat records transforms and properties, but no new objects: everything
that changes is drawn once. The parts of a skin are drawn below one path, whose transform follows
the skin's link.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Meshcat, MeshcatAnimation, Sphere
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.meshcat.stage import APART, FRAMES_PER_S, Stage, put_text
from selftouch_drake.show.recovered import RecoveredSkin
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import SkinPath, typical_extent
from selftouch_drake.show.style import BLUE, GREEN, ORANGE, RECOVERED, VERMILION, VIEW
from selftouch_drake.systems.simulation import Simulation
from selftouch_drake.systems.skin_drawing import SkinDrawing, key_frames, linear_light, rgba

# Postures of the experience that show where the skins move.
_NUM_POSTURES = 200
# Sensations whose numbers are written on the recovered body.
_NUM_NUMBERS = 16
# Paths of the expected sensation and of the recovered body.
_EXPECTED, _RECOVERED_BODY = "/expected", "/recovered"
_HERE = f"{_RECOVERED_BODY}/here"


def firm_touch(representation: QuotientRepresentation) -> float:
    """N, the L2 norm of a firm touch: the reading with the strongest colour.

    Executed plans run through the firmer half of each kernel, whose middle this is; six
    plans on the cube pressed with 0.97 to 1.08 times as much (medians). A receptor that feels all
    of it is at the end of the scale. An expected sensation has no strength, and is shown as a touch
    of this strength.
    """
    return float(np.quantile(representation.kernel_strength, 0.75))


class MeshcatScene(Stage):
    """Draws the scene of a run that has learned, and moves and colours the parts that change.

    The robot in the middle, its skins and their readings are those of the simulation.

    Attributes:
        simulation: of the robot; it shows itself.
        full: N, the reading with the strongest colour.
        expected: the skins that show an expected sensation `(S,)` of unit L2 norm.
    """

    def __init__(self, meshcat: Meshcat, data: RunData, *, beside_panel: bool = False):
        known = data.representation
        postures = known.kernel_q[:: max(len(known.kernel_q) // _NUM_POSTURES, 1)].astype(float)
        super().__init__(meshcat, data.world, postures=postures, beside_panel=beside_panel)
        self.full = firm_touch(known)
        self.simulation = Simulation(
            data.run.experiment.after(0),
            data.world.skins,
            num_joints=data.world.robot.num_joints,
            meshcat=meshcat,
            full=self.full,
        )
        self.simulation.rest_at(self.home)
        self.simulation.show()
        touching = data.world.experiment.touching
        self._are_balls = [touching[t.name].radius is not None for t in data.world.robot.touchers]
        self._targets = known.target_sensations
        # Paths move with the skin that they are on.
        self._plan_roots = [f"/skins/{skin.name}/plan" for skin in data.skins]
        self.expected = SkinDrawing(meshcat, _EXPECTED, data.skins)
        aside = APART * self.size * VIEW.axes[0]
        meshcat.SetTransform(_EXPECTED, RigidTransform(-aside))
        meshcat.SetTransform(_RECOVERED_BODY, RigidTransform(aside))
        self._write("/titles/recovered", self._draw_recovered(data), aside=aside)
        self._write("/titles/expected", "what it expects to feel", aside=-aside)
        self._write("/titles/felt", f"what it feels\n(darkest: {self.full:.1f} N)")
        self.show(self.home, np.zeros(len(self._targets[0])))

    def nearest(self, felt: np.ndarray) -> np.ndarray:
        """`(...)` the kernel whose sensation is most like `(..., S)` N."""
        return np.argmax(felt @ self._targets.T, axis=-1)

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Shows beside the robot that it is at `(J,)` q and feels `(S,)` N."""
        self.expected.move(self._robot.skin_positions(q[None])[0])
        place = self._places[self.nearest(felt)]
        if felt.any() and np.isfinite(place).all():
            self._meshcat.SetTransform(_HERE, RigidTransform(place))

    def record(
        self, recording: MeshcatAnimation, q: np.ndarray, felt: np.ndarray, expected: np.ndarray
    ) -> None:
        """Adds what was simulated before to a recording that has begun.

        Args:
            recording: of the scene's Meshcat.
            q: `(frames, J)` rad or m, where the joints were.
            felt: `(frames, S)` N.
            expected: `(frames, S)` of unit L2 norm.
        """
        for frame, configuration in enumerate(q):
            self.simulation.pose(configuration, frame / FRAMES_PER_S)
        poses = self._robot.skin_positions(q)
        centres = self._robot.toucher_positions(q)[:, self._are_balls]
        self.simulation.visualizer.Record(recording, poses, felt, centres)
        self.expected.record(recording, poses, expected)
        # Where nothing is felt, the kernel that was felt last.
        touched = np.where(felt.any(axis=1), np.arange(len(felt)), 0)
        kernel = self.nearest(felt)[np.maximum.accumulate(touched)]
        for frame in key_frames(kernel):
            place = self._places[kernel[frame]]
            if np.isfinite(place).all():
                recording.SetTransform(frame, _HERE, RigidTransform(place))

    def draw_path(self, paths: Sequence[SkinPath], num_rows: int) -> None:
        """Draws the planned paths over the skins, from green to blue."""
        for number, path in enumerate(paths):
            root = f"{self._plan_roots[path.skin]}/path_{number}"
            dots = _cloud(path.dots(0.008), BLUE)
            self._meshcat.SetObject(f"{root}/dots", dots, point_size=0.007)
            for end, row, color in (("start", 0, GREEN), ("goal", num_rows - 1, BLUE)):
                if (place := path.at(row)) is not None:
                    self._meshcat.SetObject(f"{root}/{end}", Sphere(0.014), rgba(color))
                    self._meshcat.SetTransform(f"{root}/{end}", RigidTransform(place))

    def draw_trace(self, paths: Sequence[SkinPath]) -> None:
        """Draws the executed paths, in orange."""
        for number, path in enumerate(paths):
            dots = _cloud(path.dots(0.004), ORANGE)
            root = f"{self._plan_roots[path.skin]}/trace_{number}"
            self._meshcat.SetObject(f"{root}/dots", dots, point_size=0.005)

    def clear_paths(self) -> None:
        """Removes all paths."""
        for root in self._plan_roots:
            self._meshcat.Delete(root)

    def _draw_recovered(self, data: RunData) -> str:
        """Draws the recovered body, and returns its title."""
        typical = typical_extent(data.skins)
        try:
            self._places = data.kernel_places
            draw_parts(self._meshcat, _RECOVERED_BODY, data.recovered, typical)
            title = "its body, as it recovered it,\nfitted to the true one"
        except MissingError:
            # Without a surface, or without its true place, the agent's own layout is drawn.
            self._places = _laid_out(data, self._middle, typical)
            cloud = _cloud(self._places[np.isfinite(self._places).all(axis=1)], RECOVERED)
            path = f"{_RECOVERED_BODY}/kernels"
            self._meshcat.SetObject(path, cloud, point_size=0.025 * typical)
            title = "its sensations, as it laid them out"
        self._meshcat.SetObject(_HERE, Sphere(0.04 * typical), rgba(VERMILION))
        # Some numbers of sensations, on the side of the camera.
        middle = np.nanmean(self._places, axis=0)
        known = np.flatnonzero((self._places - middle) @ VIEW.towards > 0.0)
        at = self._places[known]
        for row in farthest_points(lambda k: np.linalg.norm(at - at[k], axis=1), _NUM_NUMBERS):
            outside = at[row] + 0.12 * (at[row] - middle)
            path = f"{_RECOVERED_BODY}/numbers/{known[row]}"
            put_text(self._meshcat, path, str(known[row]), outside, 0.07 * typical)
        return title


def draw_parts(meshcat: Meshcat, root: str, parts: Sequence[RecoveredSkin], size: float) -> None:
    """Draws recovered parts and their kernels below `root`, for skins of a size in m."""
    for part in parts:
        path = f"{root}/part_{part.part}"
        # A sheet is seen from both sides.
        faces = part.faces if part.closed else np.vstack([part.faces, part.faces[:, ::-1]])
        color = rgba(RECOVERED, 0.4)
        meshcat.SetTriangleMesh(f"{path}/surface", part.places.T, faces.T, color)
        cloud = _cloud(part.positions, RECOVERED)
        meshcat.SetObject(f"{path}/kernels", cloud, point_size=0.025 * size)


def _laid_out(data: RunData, middle: np.ndarray, size: float) -> np.ndarray:
    """`(K, 3)` m, the kernels as the agent laid them out: parts side by side, scaled to `size`."""
    places, right = data.representation.embedding.copy(), 0.0
    for part in data.body.parts:
        own = places[part.kernels]
        width = float(np.ptp(own, axis=0).max())
        places[part.kernels] += (right + width / 2) * VIEW.axes[0] - own.mean(axis=0)
        right += 1.2 * width
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    return middle + (places - (low + high) / 2) * size / float((high - low).max())


def _cloud(points: np.ndarray, color: str) -> PointCloud:
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = 255 * linear_light(np.array(to_rgb(color)))[:, None]
    return cloud
