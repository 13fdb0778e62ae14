"""Executed plans as a Meshcat animation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.agent.motions import Execution
from selftouch_drake.show.meshcat.meshcat_scene import MeshcatScene, firm_touch
from selftouch_drake.show.meshcat.receptors import key_frames
from selftouch_drake.show.meshcat.stage import RobotDrawing
from selftouch_drake.show.paths import touch_paths
from selftouch_drake.show.run_data import RunData, Targets

FRAMES_PER_S = 30
# Repetitions of the animation; the controls of the page stop it.
_REPETITIONS = 1000
# s, for which the end of each plan is held.
_PAUSE_S = 1.0


def record(meshcat: Meshcat, data: RunData, tours: Sequence[Targets]) -> float:
    """Draws the agent and records executed plans, one after the other.

    Args:
        meshcat: where to draw.
        data: of the run.
        tours: the target sensations that name each plan, in order.

    Returns:
        N, the reading of a receptor that is shown in the strongest colour.
    """
    executions = [data.execution(*targets) for targets in tours]
    rows = [frame_rows(execution.motion.time_s) for execution in executions]
    q, felt, expected = (
        np.concatenate([array[frames] for array, frames in zip(arrays, rows, strict=True)])
        for arrays in (
            [execution.q_measured for execution in executions],
            [execution.felt for execution in executions],
            [execution.motion.predicted for execution in executions],
        )
    )
    number = np.repeat(np.arange(len(tours)), [len(r) for r in rows])
    full = firm_touch(data.representation)

    scene = MeshcatScene(meshcat, data)
    names = [f"plan_{plan}" for plan in range(len(tours))]
    for name, execution in zip(names, executions, strict=True):
        _draw_paths(scene, name, data, execution)
    # What is set with a time is recorded only; live, the recording is played.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    recording = meshcat.get_mutable_recording()
    recording.set_repetitions(_REPETITIONS)
    drawing = RobotDrawing(meshcat, data.experiment, data.world.skins)
    for frame, configuration in enumerate(q):
        drawing.put(configuration, frame / FRAMES_PER_S)
    robot = data.robot
    scene.record(
        recording,
        poses=robot.skin_positions(q),
        p_WT=robot.toucher_positions(q),
        felt=felt / full,
        expected=expected,
        kernel=_felt_last(felt, data.representation.target_sensations),
    )
    for plan, name in enumerate(names):
        shown = number == plan
        for frame in key_frames(shown):
            for root in scene.path_roots(name):
                recording.SetProperty(frame, root, "visible", bool(shown[frame]))
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return full


def frame_rows(time_s: np.ndarray) -> np.ndarray:
    """The row of a log `(T,)` s for each frame; the last row is held for a while."""
    duration = time_s[-1] - time_s[0]
    frame_s = np.arange(int(np.ceil((duration + _PAUSE_S) * FRAMES_PER_S))) / FRAMES_PER_S
    rows = np.searchsorted(time_s - time_s[0], frame_s - 1e-9)
    return np.minimum(rows, len(time_s) - 1)


def _draw_paths(scene: MeshcatScene, name: str, data: RunData, execution: Execution) -> None:
    planned, measured = (
        touch_paths(data.shape, data.touches_at, q)
        for q in (execution.motion.q, execution.q_measured)
    )
    scene.draw_path(name, planned, len(execution.motion.q))
    scene.draw_trace(name, measured)


def _felt_last(felt: np.ndarray, target_sensations: np.ndarray) -> np.ndarray:
    """`(frames,)` the kernel whose sensation the agent feels, or felt last."""
    kernel = np.argmax(felt @ target_sensations.T, axis=1)
    touched = np.where(felt.any(axis=1), np.arange(len(felt)), 0)
    return kernel[np.maximum.accumulate(touched)]
