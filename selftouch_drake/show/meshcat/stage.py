"""Background, camera and robot in Meshcat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph, Sphere
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import MakeRobot, SkinModel
from selftouch_drake.show.meshcat.receptors import rgba
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.style import VERMILION
from selftouch_drake.show.view import View

VIEW = View(elevation=20.0, azimuth=-70.0)


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
