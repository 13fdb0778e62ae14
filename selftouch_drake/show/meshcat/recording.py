"""Executed plans as a Meshcat animation, and as a page that needs no network."""

from __future__ import annotations

import gc
import html
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.agent.motions import Execution
from selftouch_drake.show.meshcat.meshcat_scene import MeshcatScene, firm_touch
from selftouch_drake.show.meshcat.skin_drawing import key_frames
from selftouch_drake.show.meshcat.stage import RobotDrawing, open_meshcat
from selftouch_drake.show.paths import touch_paths
from selftouch_drake.show.run_data import RunData, Targets
from selftouch_drake.show.style import PRESSURE

FRAMES_PER_S = 30
# Repetitions of the animation; the controls of the page stop it.
_REPETITIONS = 1000
# s, for which the end of each plan is held.
_PAUSE_S = 1.0


def recording_page(data: RunData, targets: Targets) -> str:
    """The page, as HTML.

    Args:
        data: of the run.
        targets: target sensations from the first to the last that the plan leads through; the first
            is a text if it begins in any configuration.

    Raises:
        MissingError: the plan was not executed.
    """
    data.execution(*targets)
    page, full = _recorded(data, targets)
    # Drake's diagrams are in reference cycles, and this one held the Meshcat server and its port.
    gc.collect()
    title = f"{data.experiment.name}: sensation {' to '.join(map(str, targets))}"
    return _with_legend(page, title, full)


def _recorded(data: RunData, targets: Targets) -> tuple[str, float]:
    meshcat = open_meshcat()
    full = record(meshcat, data, [targets])
    return meshcat.StaticHtml(), full


def _with_legend(page: str, title: str, full: float) -> str:
    """Lays a title and the scale of the colours over Meshcat's page."""
    stops = ", ".join(
        "rgb({:.0f},{:.0f},{:.0f})".format(*(255 * np.array(PRESSURE(x)[:3])))
        for x in np.linspace(0.0, 1.0, 9)
    )
    legend = f"""
  <div style="position: fixed; left: 1rem; top: 1rem; max-width: 22rem; color: #22262b;
              font: 14px/1.4 system-ui, sans-serif; pointer-events: none">
    <strong>{html.escape(title)}</strong><br>
    The agent touches itself. Blue is its plan, from green to blue; orange is the path that it
    took; red on the recovered body is where it feels itself.
    <div style="height: 10px; margin-top: 6px; border: 1px solid #888;
                background: linear-gradient(to right, {stops})"></div>
    <span style="float: left">0</span><span style="float: right">{full:.1f} N per receptor</span>
  </div>
"""
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(title)}</title>", 1)
    head, end, tail = page.rpartition("</body>")
    return head + legend + end + tail


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
