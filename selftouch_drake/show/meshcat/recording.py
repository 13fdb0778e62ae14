"""Executed plans as a Meshcat animation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from selftouch_drake.robot.agent import MakeAgent
from selftouch_drake.show.material import Material
from selftouch_drake.show.scenery import Scenery, firm_touch, key_frames

FRAMES_PER_S = 30
# The page starts over so often; its controls stop it.
_REPETITIONS = 1000
# s, for which the end of each plan is held.
_PAUSE_S = 1.0


def record(meshcat: Meshcat, material: Material, tours: Sequence[tuple[int | str, ...]]) -> float:
    """Draws the agent and records executed plans, one after the other.

    Args:
        meshcat: where to draw.
        material: of the run.
        tours: the target sensations that name each plan, in order.

    Returns:
        N, the reading of a receptor that is shown in the strongest colour.
    """
    plans = [material.executed(*targets) for targets in tours]
    rows = [frame_rows(plan["time_s"]) for plan in plans]
    q, felt, expected = (
        np.concatenate([plan[name][frames] for plan, frames in zip(plans, rows, strict=True)])
        for name in ("q_measured", "felt", "predicted")
    )
    number = np.repeat(np.arange(len(plans)), [len(r) for r in rows])
    full = firm_touch(material.representation)

    scenery = Scenery(meshcat, material)
    for plan_number, plan in enumerate(plans):
        scenery.draw_path(f"/plan/{plan_number}", material.fingertips(plan["q"]))
        scenery.draw_trace(f"/plan/{plan_number}", material.fingertips(plan["q_measured"]))
    # What is set with a time is recorded only; live, the recording is played.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    recording = meshcat.get_mutable_recording()
    recording.set_repetitions(_REPETITIONS)
    _animate_arm(meshcat, material, q)
    scenery.felt.record(recording, felt / full)
    scenery.expected.record(recording, expected)
    if scenery.mind is not None:
        # Which sensation of the recovered body the agent feels, or felt last.
        kernel = np.argmax(felt @ material.representation.target_sensations.T, axis=1)
        felt_last = np.maximum.accumulate(np.where(felt.any(axis=1), np.arange(len(felt)), 0))
        kernel = kernel[felt_last]
        for frame in key_frames(kernel):
            here = RigidTransform(scenery.mind[kernel[frame]])
            recording.SetTransform(frame, "/mind/here", here)
    for plan_number in range(len(plans)):
        shown = number == plan_number
        for frame in key_frames(shown):
            recording.SetProperty(frame, f"/plan/{plan_number}", "visible", bool(shown[frame]))
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return full


def frame_rows(time_s: np.ndarray) -> np.ndarray:
    """The row of a log `(T,)` s that is shown in each frame; the last one for a while."""
    duration = time_s[-1] - time_s[0]
    frame_s = np.arange(int(np.ceil((duration + _PAUSE_S) * FRAMES_PER_S))) / FRAMES_PER_S
    rows = np.searchsorted(time_s - time_s[0], frame_s - 1e-9)
    return np.minimum(rows, len(time_s) - 1)


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
