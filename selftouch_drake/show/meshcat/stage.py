"""Meshcat with its background, its camera, text, and a robot that can be posed and feels."""

import contextlib
import logging
from collections.abc import Iterator, Sequence

import manifold3d
import numpy as np
from matplotlib.textpath import TextPath
from pydrake.geometry import (
    Meshcat,
    MeshcatAnimation,
    MeshcatParams,
    MeshcatVisualizer,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.robot import MakeRobot, World
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one, moved, surfaces_of
from selftouch_drake.show.style import FIRM, INK, VERMILION, VIEW
from selftouch_drake.systems.skin_drawing import SkinDrawing, rgba
from selftouch_drake.threads import OncePerThread

FRAMES_PER_S = 30
#: s between two frames, and between two readings of the controls.
FRAME_S = 1 / FRAMES_PER_S
#: The button that ends a page, as the browser labels it.
END = "end"
#: What stands beside the robot is this many of its sizes away.
APART = 1.55
# Share of the places of moving skins that may overlap with the neighbours, on each side.
_RARE = 0.03
# Captions stand lower by at most this share of the size where corners or touchers reach down.
_DEEPEST = 0.4
# All that is drawn on a page.
_ALL_PATHS = ("/drake", "/skins", "/touching", "/expected", "/recovered", "/titles", "/status")
# Between lines of text, as a share of the size, and the line of the status.
_LINE, _STATUS = 0.18, 2


def open_meshcat(port: int | None = None) -> Meshcat:
    """A Meshcat on this machine alone, opened without log messages.

    Args:
        port: of the page; by default the first free one from 7000 on.

    Raises:
        ValueError: the port is taken.
    """
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
    except RuntimeError:
        raise ValueError(f"--port {port} is in use; give another, or leave it out") from None
    finally:
        logger.setLevel(level)


@OncePerThread
def page_meshcat() -> Meshcat:
    """The Meshcat in which a thread draws pages to be stored.

    Older Drakes never free a diagram with a Python system, nor the Meshcat that it shows itself in:
    a thread keeps one, whatever the number of its pages.
    """
    return open_meshcat()


@contextlib.contextmanager
def drawn_page() -> Iterator[Meshcat]:
    """An empty Meshcat for a page to be stored; it is emptied again afterwards."""
    meshcat = page_meshcat()
    try:
        yield meshcat
    finally:
        meshcat.DeleteRecording()
        meshcat.DeleteAddedControls()
        for path in _ALL_PATHS:
            meshcat.Delete(path)


class Stage:
    """The background, the camera and the text of a page that shows a robot.

    Args:
        postures: `(n, J)` for which there is to be room; by default `home`.
        beside_panel: whether the camera is farther away, so that there is room for Meshcat's
            controls; the page moves the scene aside.

    Attributes:
        home: `(J,)` rad or m, the posture that its model has by default.
        size: m, of its skins in that posture, or of what they move over.
        status: the text.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        world: World,
        *,
        postures: np.ndarray | None = None,
        beside_panel: bool = False,
    ):
        self._meshcat, self._robot, self.status = meshcat, world.robot, ""
        plant = world.robot.plant
        self.home = plant.GetPositions(plant.CreateDefaultContext())
        self._make_room(surfaces_of(world.skins), self.home[None] if postures is None else postures)
        self._set_stage(beside_panel=beside_panel)

    def say(self, text: str) -> None:
        """Writes one or two lines below the robot."""
        if text != self.status:
            self._write("/status", text, line=_STATUS)
            self.status = text

    def _write(self, path: str, text: str, *, aside: np.ndarray | float = 0.0, line: int = 0):
        centre = self._under + aside - _LINE * self.size * line * VIEW.axes[1]
        put_text(self._meshcat, path, text, centre, 0.08 * self.size)

    def _make_room(self, skins: Sequence[SkinSurface], postures: np.ndarray) -> None:
        at_home = as_one(all_moved(skins, self._robot.skin_positions(self.home[None])[0])).vertices
        low, high = at_home.min(axis=0), at_home.max(axis=0)
        self._middle = (low + high) / 2
        # No more points than the outline of a picture needs.
        outlines = [skin.vertices[:: max(len(skin.vertices) // 200, 1)] for skin in skins]
        places = [
            moved(outline, pose)
            for poses in self._robot.skin_positions(postures)
            for outline, pose in zip(outlines, poses, strict=True)
        ]
        picture = VIEW.project(np.concatenate(places) - self._middle)
        (left, lowest, _), (right, _, _) = np.quantile(picture, [_RARE, 1 - _RARE], axis=0)
        self.size = max(float((high - low).max()), float(right - left) / APART)
        # Captions stand below corners and what touches too, unless these reach far below the rest.
        touching = VIEW.project(
            self._robot.toucher_positions(postures).reshape(-1, 3) - self._middle
        )
        reached = picture[:, 1].min()
        if len(touching):
            reached = min(reached, np.quantile(touching[:, 1], _RARE))
        lowest = max(float(reached), lowest - _DEEPEST * self.size)
        self._under = self._middle + (lowest - 0.25 * self.size) * VIEW.axes[1]

    def _set_stage(self, *, beside_panel: bool) -> None:
        for prop in ("/Grid", "/Axes"):
            self._meshcat.SetProperty(prop, "visible", False)
        self._meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
        self._meshcat.SetProperty("/Background/<object>", "bottom_color", [0.87, 0.89, 0.92])
        # Room above for arms.
        centre = self._middle + np.array([0.0, 0.0, 0.04])
        distance = 0.35 + 1.7 * self.size
        if beside_panel:
            distance *= 1.25
        self._meshcat.SetCameraPose(centre + distance * VIEW.towards, centre)


class FeelingRobot(Stage):
    """A robot in Meshcat that is posed and coloured: of stored touches, and of sliders.

    Only where nothing is simulated: for kinematic babbling, stored touches and sliders. It feels
    nothing itself: who shows it says where it is and what it feels. What is simulated, under
    dynamics, shows itself by `MakeSelfTouchDiagram`. Without a Python system, its
    diagram is freed by older Drakes too, and so is its Meshcat.

    Args:
        full: N, the reading with the strongest colour; all else as in `Stage`.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        world: World,
        *,
        full: float = FIRM,
        postures: np.ndarray | None = None,
        beside_panel: bool = False,
    ):
        super().__init__(meshcat, world, postures=postures, beside_panel=beside_panel)
        self.full = full
        builder, scene_graph = DiagramBuilder(), SceneGraph()
        builder.AddSystem(scene_graph)
        plant = MakeRobot(world.experiment, world.skins, scene_graph).plant
        to_pose = MultibodyPositionToGeometryPose(plant)
        builder.AddSystem(to_pose)
        source_id = plant.get_source_id()
        assert source_id is not None  # the plant is registered by MakeRobot
        builder.Connect(to_pose.get_output_port(), scene_graph.get_source_pose_port(source_id))
        builder.ExportInput(to_pose.get_input_port(), "q")
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._skins = SkinDrawing(meshcat, "/skins", surfaces_of(world.skins))
        self._balls = dict[int, str]()
        for number, toucher in enumerate(world.robot.touchers):
            if (radius := world.experiment.touching[toucher.name].radius) is not None:
                self._balls[number] = f"/touching/{number}"
                # A little larger than what the model may draw of it.
                meshcat.SetObject(self._balls[number], Sphere(1.02 * radius), rgba(VERMILION))

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Shows the robot at `(J,)` q, feeling `(S,)` N."""
        self._publish(q)
        self._skins.move(self._robot.skin_positions(q[None])[0])
        places = self._robot.toucher_positions(q[None])[0]
        for number, path in self._balls.items():
            self._meshcat.SetTransform(path, RigidTransform(places[number]))
        self._skins.show(felt / self.full)

    def record(self, recording: MeshcatAnimation, q: np.ndarray, felt: np.ndarray) -> None:
        """Adds frames to a recording that has begun: q `(frames, J)`, felt `(frames, S)` N."""
        for frame, configuration in enumerate(q):
            self._publish(configuration, frame / FRAMES_PER_S)
        places = self._robot.toucher_positions(q)
        for number, path in self._balls.items():
            for frame, place in enumerate(places[:, number]):
                recording.SetTransform(frame, path, RigidTransform(place))
        self._skins.record(recording, self._robot.skin_positions(q), felt / self.full)

    def _publish(self, q: np.ndarray, time_s: float = 0.0) -> None:
        self._diagram.GetInputPort("q").FixValue(self._context, q)
        self._context.SetTime(time_s)
        self._diagram.ForcedPublish(self._context)


# Size at which outlines are taken from the font: fine enough that bends look round.
_FONT_SIZE = 60.0
_LINE_SPACING = 1.5


def put_text(meshcat: Meshcat, path: str, text: str, centre: np.ndarray, size: float) -> None:
    """Writes lines that face the camera, the first round `centre` `(3,)` m, in a font of `size` m.

    Meshcat has no text: letters are flat meshes, and not pictures, which a page requests only after
    it has heard of them; a slow page requests pictures that are gone by then. What was written at
    the path before is replaced.
    """
    vertices, faces = letters(text)
    flat = np.vstack([size * vertices.T, np.zeros(len(vertices))])
    meshcat.SetTriangleMesh(path, flat, faces.T, rgba(INK))
    meshcat.SetTransform(path, RigidTransform(RotationMatrix(VIEW.axes.T), centre))


def letters(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Lines of text, centred at the origin, at a font size of one.

    Returns:
        `(V, 2)` vertices and `(F, 3)` indices of triangles.
    """
    outlines = []
    for number, line in enumerate(text.split("\n")):
        if not line.strip():  # which TextPath cannot do
            continue
        glyphs = TextPath((0.0, 0.0), line, size=_FONT_SIZE)
        contours = [np.asarray(polygon)[:-1] for polygon in glyphs.to_polygons()]
        x = np.concatenate(contours)[:, 0]
        middle = (x.min() + x.max()) / 2
        down = (0.35 + _LINE_SPACING * number) * _FONT_SIZE
        outlines += [contour - [middle, down] for contour in contours]
    # The font alone knows which contours are holes.
    rings = manifold3d.CrossSection(outlines, manifold3d.FillRule.EvenOdd).to_polygons()
    if not rings:
        return np.zeros((0, 2)), np.zeros((0, 3), dtype=int)
    return np.concatenate(rings) / _FONT_SIZE, np.asarray(manifold3d.triangulate(rings))
