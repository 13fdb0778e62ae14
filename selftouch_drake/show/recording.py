"""Executed plans as a Meshcat animation.

A recording knows transforms and properties, no new objects: whatever is shown is drawn before it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import (
    Meshcat,
    MeshcatAnimation,
    MeshcatVisualizer,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.motion_figures import evenly_spaced
from selftouch_drake.show.scene import View
from selftouch_drake.show.style import BLUE, GREEN, PRESSURE, RECOVERED, SKIN, VERMILION
from selftouch_drake.world.agent import MakeAgent

FRAMES_PER_S = 30
# The recovered body is drawn to the right of the real one in this view.
_VIEW = View(elevation=20.0, azimuth=-70.0)
# Pressure is shown in so many steps: few enough that a receptor's colour changes seldom.
_STEPS = 24
# The page starts over so often; its controls stop it.
_REPETITIONS = 1000
# s, for which the end of each plan is held.
_PAUSE_S = 1.0


def record(meshcat: Meshcat, material: Material, pairs: Sequence[tuple[int, int]]) -> float:
    """Draws the agent and records executed plans, one after the other.

    Returns:
        N, the reading of a receptor that is shown in the strongest colour.
    """
    plans = [material.executed(*pair) for pair in pairs]
    rows = [frame_rows(plan["time_s"]) for plan in plans]
    q = np.concatenate([p["q_measured"][r] for p, r in zip(plans, rows, strict=True)])
    felt = np.concatenate([p["felt"][r] for p, r in zip(plans, rows, strict=True)])
    number = np.repeat(np.arange(len(plans)), [len(r) for r in rows])
    scale = float(np.quantile(felt.max(axis=1), 0.98)) or 1.0

    mind = _draw_agent(meshcat, material)
    for plan_number, plan in enumerate(plans):
        _draw_path(meshcat, f"/plan/{plan_number}", material, plan)
    # What is set with a time is recorded only; live, the recording is played.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    recording = meshcat.get_mutable_recording()
    recording.set_repetitions(_REPETITIONS)
    _animate_arm(meshcat, material, q)
    _animate_receptors(recording, felt, scale)
    if mind is not None:
        _animate_mind(recording, mind, material, felt)
    for plan_number in range(len(plans)):
        shown = number == plan_number
        for frame in key_frames(shown):
            recording.SetProperty(frame, f"/plan/{plan_number}", "visible", bool(shown[frame]))
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return scale


def frame_rows(time_s: np.ndarray) -> np.ndarray:
    """The row of a log `(T,)` s that is shown in each frame; the last one for a while."""
    duration = time_s[-1] - time_s[0]
    frame_s = np.arange(int(np.ceil((duration + _PAUSE_S) * FRAMES_PER_S))) / FRAMES_PER_S
    rows = np.searchsorted(time_s - time_s[0], frame_s - 1e-9)
    return np.minimum(rows, len(time_s) - 1)


def key_frames(values: np.ndarray) -> Iterator[int]:
    """The frames that say all of a series whose values are held between changes.

    Playing blends from key to key, so that the last frame before a change is a key as well; and
    each series starts over when it ends, so that all have to end with the last frame.
    """
    changes = np.flatnonzero(np.diff(values) != 0)
    yield from np.unique([0, *changes, *(changes + 1), len(values) - 1]).tolist()


def _draw_agent(meshcat: Meshcat, material: Material) -> np.ndarray | None:
    """Draws what does not move; returns `(K, 3)` m, the recovered body, where it is drawn."""
    skin = material.skin
    low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
    size = float((high - low).max())
    meshcat.SetTriangleMesh("/body/skin", skin.vertices.T, skin.faces.T, _rgba(SKIN, 0.4))
    for receptor, p_BS in enumerate(skin.p_BS):
        path = _receptor(receptor)
        meshcat.SetObject(path, Sphere(0.02 * size), Rgba(*PRESSURE(0.0)))
        meshcat.SetTransform(path, RigidTransform(p_BS))
    mind = _mind_positions(material, beside=1.5 * size)
    middle = (low + high) / 2
    if mind is not None:
        cloud = _cloud(mind, RECOVERED)
        meshcat.SetObject("/mind/kernels", cloud, point_size=0.016)
        meshcat.SetObject("/mind/here", Sphere(0.04 * size), _rgba(VERMILION))
        middle = (middle + mind.mean(axis=0)) / 2
    for prop in ("/Grid", "/Axes"):
        meshcat.SetProperty(prop, "visible", False)
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.87, 0.89, 0.92])
    # Room above for the arm, whose links are 0.4 m long.
    middle = middle + np.array([0.0, 0.0, 0.12])
    distance = 0.5 + (1.2 if mind is None else 1.4) * size
    meshcat.SetCameraPose(middle + distance * _VIEW.towards, middle)
    return mind


def _mind_positions(material: Material, *, beside: float) -> np.ndarray | None:
    try:
        positions, _ = material.recovered
    except MissingError:
        return None
    return positions + beside * _VIEW.axes[0]


def _draw_path(meshcat: Meshcat, path: str, material: Material, plan: dict) -> None:
    tips = material.fingertips(plan["q"])
    for finger in range(tips.shape[1]):
        dots = evenly_spaced(tips[:, finger], 0.008)
        meshcat.SetObject(f"{path}/path_{finger}", _cloud(dots, BLUE), point_size=0.007)
        for name, row, color in (("start", 0, GREEN), ("goal", -1, BLUE)):
            end = f"{path}/{name}_{finger}"
            meshcat.SetObject(end, Sphere(0.014), _rgba(color))
            meshcat.SetTransform(end, RigidTransform(tips[row, finger]))


def _animate_arm(meshcat: Meshcat, material: Material, q: np.ndarray) -> None:
    """Publishes the arm at `q` `(frames, J)` rad.

    Its diagram feels nothing: on older Drakes one with a Python system is never freed, nor is the
    Meshcat that it shows itself in.
    """
    builder = DiagramBuilder()
    scene_graph = SceneGraph()
    builder.AddSystem(scene_graph)
    agent = MakeAgent(material.run.experiment, material.body[0], scene_graph)
    to_pose = MultibodyPositionToGeometryPose(agent.plant)
    builder.AddSystem(to_pose)
    source_id = agent.plant.get_source_id()
    assert source_id is not None  # the plant is registered by MakeAgent
    builder.Connect(to_pose.get_output_port(), scene_graph.get_source_pose_port(source_id))
    builder.ExportInput(to_pose.get_input_port(), "q")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    for frame, configuration in enumerate(q):
        diagram.GetInputPort("q").FixValue(context, configuration)
        context.SetTime(frame / FRAMES_PER_S)
        diagram.ForcedPublish(context)


def _animate_receptors(recording: MeshcatAnimation, felt: np.ndarray, scale: float) -> None:
    """Colours the receptors by what they feel.

    A recorded property named `color` is not played back (Drake issue 20879). The colour of the
    material is, and is blended in linear light.
    """
    level = np.rint(_STEPS * np.clip(felt / scale, 0.0, 1.0)).astype(int)
    colors = _linear(PRESSURE(np.arange(_STEPS + 1) / _STEPS)[:, :3]).tolist()
    for receptor, levels in enumerate(level.T):
        path = f"{_receptor(receptor)}/<object>"
        for frame in key_frames(levels):
            recording.SetProperty(frame, path, "material.color", colors[levels[frame]])


def _animate_mind(
    recording: MeshcatAnimation, mind: np.ndarray, material: Material, felt: np.ndarray
) -> None:
    """Shows in the recovered body which of its sensations the agent feels, or felt last."""
    kernel = np.argmax(felt @ material.representation.target_sensations.T, axis=1)
    felt_last = np.maximum.accumulate(np.where(felt.any(axis=1), np.arange(len(felt)), 0))
    kernel = kernel[felt_last]
    for frame in key_frames(kernel):
        recording.SetTransform(frame, "/mind/here", RigidTransform(mind[kernel[frame]]))


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Linear light of sRGB components, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _receptor(receptor: int) -> str:
    return f"/body/receptors/{receptor}"


def _rgba(color: str, alpha: float = 1.0) -> Rgba:
    return Rgba(*to_rgb(color), alpha)


def _cloud(points: np.ndarray, color: str) -> PointCloud:
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = 255 * _linear(np.array(to_rgb(color)))[:, None]
    return cloud
