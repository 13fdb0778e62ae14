"""The scene in Meshcat, live and in recordings: the robot's skins three times, side by side.

In the middle are the real skins on the robot; their receptors show the sensation. On the left the
same skins show the sensation that the agent expects. On the right is the recovered body, with the
sensation marked in red. Meshcat records transforms and properties, but no new objects: everything
that changes is drawn once. The parts of a skin are drawn below one path, whose transform follows
the skin's link.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Meshcat, MeshcatAnimation, Sphere
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.geometry import farthest_points
from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.meshcat.skin_drawing import (
    Receptors,
    SkinDrawing,
    key_frames,
    linear_light,
    rgba,
)
from selftouch_drake.show.meshcat.stage import VIEW, draw_balls, set_stage
from selftouch_drake.show.meshcat.text_meshes import put_text
from selftouch_drake.show.paths import SkinPath, evenly_spaced
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import all_moved, as_one, moved
from selftouch_drake.show.style import BLUE, GREEN, INK, ORANGE, RECOVERED, VERMILION

# Distance between the three, as a multiple of their size.
_APART = 1.55
# Share of the places of moving skins that may overlap with the neighbours, on each side.
_RARE = 0.03
# Postures of the experience that show where the skins move.
_NUM_POSTURES = 200
# Between lines of text, as a share of the size.
_LINE = 0.18
# Balls of the legend of the colours.
_NUM_COLORS = 13
# Sensations whose numbers are written on the recovered body.
_NUM_NUMBERS = 16
# Paths of the real skins, of the expected ones, and of the recovered body.
FELT, EXPECTED, RECOVERED_BODY = "/skins", "/expected", "/recovered"


def firm_touch(representation: QuotientRepresentation) -> float:
    """N, the L2 norm of a firm touch: the reading with the strongest colour.

    Executed plans run through the firmer half of each kernel, whose middle this is; six
    plans on the cube pressed with 0.97 to 1.08 times as much (medians). A receptor that feels all
    of it is at the end of the scale. An expected sensation has no strength, and is shown as a touch
    of this strength.
    """
    return float(np.quantile(representation.kernel_strength, 0.75))


class MeshcatScene:
    """Draws the scene, and moves and colours the parts that change.

    Args:
        meshcat: where it is drawn.
        data: of a run that has learned.
        beside_panel: whether to leave room on the right for Meshcat's controls.

    Attributes:
        size: m, of the body, or of what its parts move over.
        kernel_places: `(K, 3)` m, the kernels on the recovered body, or as the agent laid them out
            if they are on no surface; NaN in fragments.
    """

    def __init__(self, meshcat: Meshcat, data: RunData, *, beside_panel: bool = False):
        self._meshcat = meshcat
        self._skins = data.skins
        home = as_one(all_moved(data.skins, data.home))
        low, high = home.vertices.min(axis=0), home.vertices.max(axis=0)
        middle = (low + high) / 2
        width, lowest = _reach(data, middle)
        self.size = max(float((high - low).max()), width / _APART)
        self._under = middle + (lowest - 0.22 * self.size) * VIEW.axes[1]
        self._aside = _APART * self.size * VIEW.axes[0]
        # Paths move with the skin that they are on.
        self._plan_roots = [f"{FELT}/{skin.name}/plan" for skin in data.skins]
        self._felt = SkinDrawing(meshcat, FELT, data.skins)
        self._expected = SkinDrawing(meshcat, EXPECTED, data.skins)
        meshcat.SetTransform(EXPECTED, RigidTransform(-self._aside))
        self.move(data.home)
        self._balls = draw_balls(meshcat, data.shape)
        self.kernel_places, title = self._draw_recovered(data, middle)
        self._write("/titles/recovered", title, aside=self._aside)
        self._write_titles()
        set_stage(meshcat, VIEW, middle, self.size, beside_panel=beside_panel)

    def move(self, poses: np.ndarray) -> None:
        """Puts the skins where their links are: `(skins, 3, 4)`."""
        self._felt.move(poses)
        self._expected.move(poses)

    def move_balls(self, p_WT: np.ndarray) -> None:
        """Puts the balls that the model does not draw at `(touchers, 3)` m."""
        for number, path in self._balls.items():
            self._meshcat.SetTransform(path, RigidTransform(p_WT[number]))

    def show_felt(self, felt: np.ndarray) -> None:
        """Shows a sensation `(S,)` on the real skins, 1 in the strongest colour."""
        self._felt.show(felt)

    def show_expected(self, expected: np.ndarray) -> None:
        """Shows an expected sensation `(S,)` beside them."""
        self._expected.show(expected)

    def show_here(self, kernel: int) -> None:
        """Marks a kernel on the recovered body, if it is there."""
        if np.isfinite(self.kernel_places[kernel]).all():
            here = RigidTransform(self.kernel_places[kernel])
            self._meshcat.SetTransform(f"{RECOVERED_BODY}/here", here)

    def record(
        self,
        recording: MeshcatAnimation,
        *,
        poses: np.ndarray,
        p_WT: np.ndarray,
        felt: np.ndarray,
        expected: np.ndarray,
        kernel: np.ndarray,
    ) -> None:
        """Records what changes, frame by frame.

        Args:
            recording: to add to.
            poses: `(frames, skins, 3, 4)` of the skins' links.
            p_WT: `(frames, touchers, 3)` m, of what touches.
            felt: `(frames, S)` as of `show_felt`.
            expected: `(frames, S)` as of `show_expected`.
            kernel: `(frames,)` the kernel that is felt, or was felt last.
        """
        for number, path in self._balls.items():
            for frame, place in enumerate(p_WT[:, number]):
                recording.SetTransform(frame, path, RigidTransform(place))
        self._felt.record(recording, poses, felt)
        self._expected.record(recording, poses, expected)
        for frame in key_frames(kernel):
            place = self.kernel_places[kernel[frame]]
            if np.isfinite(place).all():
                here = RigidTransform(place)
                recording.SetTransform(frame, f"{RECOVERED_BODY}/here", here)

    def draw_path(self, paths: Sequence[SkinPath], num_rows: int) -> None:
        """Draws the planned paths over the skins, from green to blue."""
        for number, path in enumerate(paths):
            root = f"{self._plan_roots[path.skin]}/path_{number}"
            self._draw_dots(root, path, BLUE, spacing=0.008, point_size=0.007)
            for end, row, color in (("start", 0, GREEN), ("goal", num_rows - 1, BLUE)):
                if (place := path.at(row)) is not None:
                    self._meshcat.SetObject(f"{root}/{end}", Sphere(0.014), rgba(color))
                    self._meshcat.SetTransform(f"{root}/{end}", RigidTransform(place))

    def draw_trace(self, paths: Sequence[SkinPath]) -> None:
        """Draws the executed paths, in orange."""
        for number, path in enumerate(paths):
            root = f"{self._plan_roots[path.skin]}/trace_{number}"
            self._draw_dots(root, path, ORANGE, spacing=0.004, point_size=0.005)

    def clear_paths(self) -> None:
        """Removes all paths."""
        for root in self._plan_roots:
            self._meshcat.Delete(root)

    def write_status(self, text: str) -> None:
        """Writes one or two lines below everything."""
        self._write("/status", text, line=2)

    def draw_legend(self, full: float) -> None:
        """Draws the scale of the receptors' colours, up to `full` N, below the body's title."""
        share = np.linspace(0.0, 1.0, _NUM_COLORS)
        centre = self._under - _LINE * self.size * VIEW.axes[1]
        places = centre + 0.8 * self.size * (share - 0.5)[:, None] * VIEW.axes[0]
        Receptors(self._meshcat, "/legend/colors", places, 0.02 * self.size).show(share)
        for end, text in ((-1.0, "0"), (1.0, f"{full:.1f} N\nper receptor")):
            self._write(
                f"/legend/{end:.0f}", text, aside=0.6 * end * self.size * VIEW.axes[0], line=1
            )

    def _draw_recovered(self, data: RunData, middle: np.ndarray) -> tuple[np.ndarray, str]:
        """Draws the recovered body; returns the places of the kernels, and its title."""
        typical = float(np.median([skin.extent for skin in self._skins]))
        self._meshcat.SetTransform(RECOVERED_BODY, RigidTransform(self._aside))
        try:
            parts, places = data.recovered, data.kernel_places
            title = "its body, as it recovered it,\nfitted to the true one"
        except MissingError:
            # Without a surface, or without its true place, the agent's own layout is drawn.
            parts, places = (), _laid_out(data, middle, typical)
            title = "its sensations, as it laid them out"
            cloud = _cloud(places[np.isfinite(places).all(axis=1)], RECOVERED)
            self._meshcat.SetObject(f"{RECOVERED_BODY}/kernels", cloud, point_size=0.025 * typical)
        for part in parts:
            path = f"{RECOVERED_BODY}/part_{part.part}"
            color = rgba(RECOVERED, 0.4)
            # A sheet is seen from both sides.
            faces = part.faces if part.closed else np.vstack([part.faces, part.faces[:, ::-1]])
            self._meshcat.SetTriangleMesh(f"{path}/surface", part.places.T, faces.T, color)
            cloud = _cloud(part.positions, RECOVERED)
            self._meshcat.SetObject(f"{path}/kernels", cloud, point_size=0.025 * typical)
        ball = Sphere(0.04 * typical)
        self._meshcat.SetObject(f"{RECOVERED_BODY}/here", ball, rgba(VERMILION))
        self._number(places, typical)
        return places, title

    def _number(self, places: np.ndarray, typical: float) -> None:
        """Writes the numbers of some sensations where they are, on the side of the camera."""
        middle = np.nanmean(places, axis=0)
        known = np.flatnonzero((places - middle) @ VIEW.towards > 0.0)
        at = places[known]
        for row in farthest_points(lambda k: np.linalg.norm(at - at[k], axis=1), _NUM_NUMBERS):
            outside = at[row] + 0.12 * (at[row] - middle)
            path = f"{RECOVERED_BODY}/numbers/{known[row]}"
            put_text(
                self._meshcat, path, str(known[row]), outside, VIEW,
                size=0.07 * typical, color=rgba(INK),
            )  # fmt: skip

    def _draw_dots(
        self, path: str, points: SkinPath, color: str, *, spacing: float, point_size: float
    ) -> None:
        dots = np.concatenate([evenly_spaced(s, spacing) for s in points.stretches()])
        self._meshcat.SetObject(f"{path}/dots", _cloud(dots, color), point_size=point_size)

    def _write(self, path: str, text: str, *, aside: np.ndarray | float = 0.0, line: float = 0.0):
        centre = self._under + aside - _LINE * self.size * line * VIEW.axes[1]
        size = 0.08 * self.size
        put_text(self._meshcat, path, text, centre, VIEW, size=size, color=rgba(INK))

    def _write_titles(self) -> None:
        self._write("/titles/expected", "what it expects to feel", aside=-self._aside)
        self._write("/titles/felt", "what it feels")


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


def _reach(data: RunData, middle: np.ndarray) -> tuple[float, float]:
    """m, how wide the skins are or mostly move in the picture, and how far below `middle`."""
    home = VIEW.project(as_one(all_moved(data.skins, data.home)).vertices - middle)
    width, lowest = float(np.ptp(home[:, 0])), float(home[:, 1].min())
    q = data.representation.kernel_q
    some = q[:: max(len(q) // _NUM_POSTURES, 1)].astype(float)
    poses = data.robot.skin_positions(some)
    if np.ptp(poses, axis=0).max() < 1e-9:
        return width, lowest
    # No more points than the outline of a picture needs.
    outlines = [skin.vertices[:: max(len(skin.vertices) // 200, 1)] for skin in data.skins]
    places = [
        moved(outline, pose) for number, outline in enumerate(outlines) for pose in poses[:, number]
    ]
    right, up, _ = VIEW.project(np.concatenate(places) - middle).T
    left_end, right_end = np.quantile(right, [_RARE, 1.0 - _RARE])
    return max(width, float(right_end - left_end)), min(lowest, float(np.quantile(up, _RARE)))


def _cloud(points: np.ndarray, color: str) -> PointCloud:
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = 255 * linear_light(np.array(to_rgb(color)))[:, None]
    return cloud
