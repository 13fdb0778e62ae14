"""Meshcat with its background, its camera and a robot that can be posed."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, MeshcatVisualizer, SceneGraph, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import MakeRobot, SkinModel, World
from selftouch_drake.show.meshcat.skin_drawing import SkinDrawing, rgba
from selftouch_drake.show.meshcat.text_meshes import put_text
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.skins import all_moved, as_one, surfaces_of
from selftouch_drake.show.style import FIRM, INK, VERMILION
from selftouch_drake.show.view import View

VIEW = View(elevation=20.0, azimuth=-70.0)


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


@contextlib.contextmanager
def shown_page(
    name: str, port: int | None = None, announce: Callable[[str], None] = print
) -> Iterator[Meshcat]:
    """Opens a Meshcat for what goes on inside, until its end or Ctrl-C.

    Args:
        name: of what is shown.
        port: of the page; by default the first free one from 7000 on.
        announce: called with where to look, and at the end.

    Raises:
        ValueError: the port is taken.
    """
    meshcat = open_meshcat(port)
    announce(f"{name} at {meshcat.web_url()} (Ctrl-C to end)")
    with contextlib.suppress(KeyboardInterrupt):
        yield meshcat
    announce("ended")


def set_stage(
    meshcat: Meshcat, view: View, middle: np.ndarray, size: float, *, beside_panel: bool = False
) -> None:
    """Sets background and camera, so that three bodies of a size in m stand round `middle`.

    Args:
        meshcat: where.
        view: the camera's direction.
        middle: `(3,)` m.
        size: m.
        beside_panel: whether the bodies stand left of the middle of the page, so that Meshcat's
            controls do not cover them on a page that is at least 4:3.
    """
    for prop in ("/Grid", "/Axes"):
        meshcat.SetProperty(prop, "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.87, 0.89, 0.92])
    # Room above for arms.
    centre = middle + np.array([0.0, 0.0, 0.04])
    distance = 0.35 + 1.7 * size
    if beside_panel:
        distance *= 1.25
        centre = centre + 0.2 * distance * view.axes[0]
    meshcat.SetCameraPose(centre + distance * view.towards, centre)


class RobotDrawing:
    """A robot in Meshcat that can be posed.

    Its diagram feels nothing: on older Drakes one with a Python system is never freed, nor is the
    Meshcat that it shows itself in.

    Args:
        meshcat: where it is drawn.
        experiment: whose robot it is.
        skins: its skins.
    """

    def __init__(self, meshcat: Meshcat, experiment: Experiment, skins: Sequence[SkinModel]):
        builder = DiagramBuilder()
        scene_graph = SceneGraph()
        builder.AddSystem(scene_graph)
        plant = MakeRobot(experiment, skins, scene_graph).plant
        to_pose = MultibodyPositionToGeometryPose(plant)
        builder.AddSystem(to_pose)
        source_id = plant.get_source_id()
        assert source_id is not None  # the plant is registered by MakeRobot
        builder.Connect(to_pose.get_output_port(), scene_graph.get_source_pose_port(source_id))
        builder.ExportInput(to_pose.get_input_port(), "q")
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()

    def put(self, q: np.ndarray, time_s: float = 0.0) -> None:
        """Shows the robot at `(J,)` q; in recordings, at `time_s`."""
        self._diagram.GetInputPort("q").FixValue(self._context, q)
        self._context.SetTime(time_s)
        self._diagram.ForcedPublish(self._context)


def draw_balls(meshcat: Meshcat, shape: RobotShape) -> dict[int, str]:
    """Draws touching balls that the model does not draw; returns their paths by toucher."""
    paths = {}
    for number, radius in shape.bare_balls().items():
        paths[number] = f"/touching/{number}"
        meshcat.SetObject(paths[number], Sphere(radius), rgba(VERMILION))
    return paths


class FeelingRobot:
    """A robot that can be posed and coloured by sensations, with a line of text below.

    Args:
        meshcat: where it is drawn.
        world: of the robot.

    Attributes:
        home: `(J,)` rad or m, the posture that its model has by default.
        size: m, longest side of its skins in that posture.
        status: the text.
    """

    def __init__(self, meshcat: Meshcat, world: World):
        self._meshcat, self._robot = meshcat, world.robot
        self._drawing = RobotDrawing(meshcat, world.experiment, world.skins)
        skins = surfaces_of(world.skins)
        self._skins = SkinDrawing(meshcat, "/skins", skins)
        self._balls = draw_balls(meshcat, RobotShape(self._robot, world.experiment.touching))
        plant = self._robot.plant
        self.home = plant.GetPositions(plant.CreateDefaultContext())
        at_home = as_one(all_moved(skins, self._robot.skin_positions(self.home[None])[0]))
        low, high = at_home.vertices.min(axis=0), at_home.vertices.max(axis=0)
        self._middle, self.size = (low + high) / 2, float((high - low).max())
        self.status = ""
        set_stage(meshcat, VIEW, self._middle, self.size)

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Shows the robot at `(J,)` q, feeling `(S,)` N."""
        self._drawing.put(q)
        self._skins.move(self._robot.skin_positions(q[None])[0])
        places = self._robot.toucher_positions(q[None])[0]
        for number, path in self._balls.items():
            self._meshcat.SetTransform(path, RigidTransform(places[number]))
        self._skins.show(felt / FIRM)

    def say(self, text: str) -> None:
        """Writes a line below the robot."""
        if text != self.status:
            under = self._middle - 0.75 * self.size * VIEW.axes[1]
            size = 0.08 * self.size
            put_text(self._meshcat, "/status", text, under, VIEW, size=size, color=rgba(INK))
            self.status = text
