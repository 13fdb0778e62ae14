"""What stands in Meshcat, live and in recordings: three bodies side by side.

In the middle the real one, whose receptors show what is felt; to the left the same body showing
what the agent expects to feel; to the right the body that the agent recovered, with the sensation
it feels marked in red. Meshcat records and changes transforms and properties, no objects: whatever
is to change is drawn here once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Meshcat, MeshcatAnimation, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.show.lettering import put_legend, put_words
from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.motion_figures import evenly_spaced
from selftouch_drake.show.scene import View
from selftouch_drake.show.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PRESSURE,
    RECOVERED,
    SKIN,
    VERMILION,
)

VIEW = View(elevation=20.0, azimuth=-70.0)
# Pressure is shown in so many steps: few enough that a receptor's colour changes seldom.
_STEPS = 24
_COLORS = PRESSURE(np.arange(_STEPS + 1) / _STEPS)
# Bodies stand this many times their size apart.
_APART = 1.55
# Between lines of text, as a share of the body's size.
_LINE = 0.18


def firm_touch(representation: QuotientRepresentation) -> float:
    """N, the L2 norm of a firm touch: the reading that is shown in the strongest colour.

    Executed plans run through the firmer half of each kernel, whose middle this is; six
    plans on the cube pressed with 0.97 to 1.08 times as much (medians). A receptor that feels all
    of it is at the end of the scale, and an expected sensation, which has no strength, is shown as
    if it were so firm.
    """
    return float(np.quantile(representation.kernel_strength, 0.75))


class Receptors:
    """Receptors on one body, coloured by what they feel.

    Args:
        meshcat: where they are drawn.
        path: of all of them in Meshcat.
        positions: `(S, 3)` m.
        radius: m, of the ball that stands for one.
    """

    def __init__(self, meshcat: Meshcat, path: str, positions: np.ndarray, radius: float):
        self._meshcat = meshcat
        self._paths = [f"{path}/{receptor}" for receptor in range(len(positions))]
        self._shown = np.zeros(len(positions), dtype=int)
        for each, position in zip(self._paths, positions, strict=True):
            meshcat.SetObject(each, Sphere(radius), Rgba(*_COLORS[0]))
            meshcat.SetTransform(each, RigidTransform(position))

    def show(self, felt: np.ndarray) -> None:
        """Shows `(S,)` readings, 1 in the strongest colour."""
        steps = _steps(felt)
        for receptor in np.flatnonzero(steps != self._shown):
            self._meshcat.SetProperty(
                self._paths[receptor], "color", _COLORS[steps[receptor]].tolist()
            )
        self._shown = steps

    def record(self, recording: MeshcatAnimation, felt: np.ndarray) -> None:
        """Records `(frames, S)` readings, 1 in the strongest colour.

        A recorded property named `color` is not played back (Drake issue 20879). The colour of the
        material is, and is blended in linear light; live it does nothing.
        """
        colors = linear_light(_COLORS[:, :3]).tolist()
        for path, steps in zip(self._paths, _steps(felt).T, strict=True):
            for frame in key_frames(steps):
                recording.SetProperty(
                    frame, f"{path}/<object>", "material.color", colors[steps[frame]]
                )


class Scenery:
    """Draws all that does not move, and keeps what changes its colour or place.

    Args:
        meshcat: where it is drawn.
        material: of a run that has learned.

    Attributes:
        felt: receptors of the real body.
        expected: receptors of the body to its left.
        mind: `(K, 3)` m, the recovered body where it is drawn; None if there is none.
        size: m, of the body.
    """

    def __init__(self, meshcat: Meshcat, material: Material):
        self._meshcat = meshcat
        skin = material.skin
        low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
        middle = (low + high) / 2
        self.size = float((high - low).max())
        lowest = ((skin.vertices - middle) @ VIEW.axes[1]).min()
        self._under = middle + (lowest - 0.22 * self.size) * VIEW.axes[1]
        aside = _APART * self.size * VIEW.axes[0]
        skin_color = rgba(SKIN, 0.4)
        for path, place in (("/body", 0.0 * aside), ("/expected", -aside)):
            mesh = (skin.vertices + place).T
            meshcat.SetTriangleMesh(f"{path}/skin", mesh, skin.faces.T, skin_color)
        radius = 0.02 * self.size
        self.felt = Receptors(meshcat, "/body/receptors", skin.p_BS, radius)
        self.expected = Receptors(meshcat, "/expected/receptors", skin.p_BS - aside, radius)
        self.mind = self._draw_mind(material, aside)
        self._titles(-aside, aside)
        for prop in ("/Grid", "/Axes"):
            meshcat.SetProperty(prop, "visible", False)
        meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
        meshcat.SetProperty("/Background/<object>", "bottom_color", [0.87, 0.89, 0.92])
        # Room above for the arm, whose links are 0.4 m long.
        centre = middle + np.array([0.0, 0.0, 0.04])
        meshcat.SetCameraPose(centre + (0.35 + 1.7 * self.size) * VIEW.towards, centre)

    def tell(self, text: str) -> None:
        """Writes one or two lines below everything."""
        self._write("/told", text, line=2)

    def draw_legend(self, full: float) -> None:
        """Draws the scale of the colours, up to `full` N, below the body's title."""
        centre = self._under - _LINE * self.size * VIEW.axes[1]
        width = 0.8 * self.size
        put_legend(self._meshcat, "/legend", full, centre, VIEW, width=width, color=rgba(INK))

    def _write(self, path: str, text: str, *, aside: np.ndarray | float = 0.0, line: int = 0):
        centre = self._under + aside - _LINE * self.size * line * VIEW.axes[1]
        size = 0.08 * self.size
        put_words(self._meshcat, path, text, centre, VIEW, size=size, color=rgba(INK))

    def _titles(self, left: np.ndarray, right: np.ndarray) -> None:
        titles = [
            ("expected", "what it expects to feel", left),
            ("felt", "what it feels", 0.0 * left),
        ]
        if self.mind is not None:
            titles.append(("mind", "its body, as it recovered it", right))
        for name, text, place in titles:
            self._write(f"/titles/{name}", text, aside=place)

    def _draw_mind(self, material: Material, aside: np.ndarray) -> np.ndarray | None:
        try:
            positions, faces = material.recovered
        except MissingError:
            return None
        mind = positions + aside
        skin = rgba(RECOVERED, 0.4)
        self._meshcat.SetTriangleMesh("/mind/skin", mind.T, faces.T, skin)
        cloud = _cloud(mind, RECOVERED)
        self._meshcat.SetObject("/mind/kernels", cloud, point_size=0.025 * self.size)
        self._meshcat.SetObject("/mind/here", Sphere(0.04 * self.size), rgba(VERMILION))
        return mind

    def draw_path(self, path: str, tips: np.ndarray) -> None:
        """Draws a planned way `(T, fingers, 3)` m of the fingertips, from green to blue."""
        for finger in range(tips.shape[1]):
            dots = evenly_spaced(tips[:, finger], 0.008)
            self._meshcat.SetObject(f"{path}/path_{finger}", _cloud(dots, BLUE), point_size=0.007)
            for name, row, color in (("start", 0, GREEN), ("goal", -1, BLUE)):
                end = f"{path}/{name}_{finger}"
                self._meshcat.SetObject(end, Sphere(0.014), rgba(color))
                self._meshcat.SetTransform(end, RigidTransform(tips[row, finger]))

    def draw_trace(self, path: str, tips: np.ndarray) -> None:
        """Draws the way `(T, fingers, 3)` m that the fingertips went, in orange."""
        for finger in range(tips.shape[1]):
            dots = evenly_spaced(tips[:, finger], 0.004)
            cloud = _cloud(dots, ORANGE)
            self._meshcat.SetObject(f"{path}/trace_{finger}", cloud, point_size=0.005)


def key_frames(values: np.ndarray) -> Iterator[int]:
    """The frames that say all of a series whose values are held between changes.

    Playing blends from key to key, so that the last frame before a change is a key as well; and
    each series starts over when it ends, so that all have to end with the last frame.
    """
    changes = np.flatnonzero(np.diff(values) != 0)
    yield from np.unique([0, *changes, *(changes + 1), len(values) - 1]).tolist()


def linear_light(srgb: np.ndarray) -> np.ndarray:
    """Linear light of sRGB components, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def rgba(color: str, alpha: float = 1.0) -> Rgba:
    """A colour as Meshcat takes it."""
    return Rgba(*to_rgb(color), alpha)


def _steps(felt: np.ndarray) -> np.ndarray:
    return np.rint(_STEPS * np.clip(felt, 0.0, 1.0)).astype(int)


def _cloud(points: np.ndarray, color: str) -> PointCloud:
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = 255 * linear_light(np.array(to_rgb(color)))[:, None]
    return cloud
