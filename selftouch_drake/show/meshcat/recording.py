"""An executed plan as a Meshcat animation, and as a page that needs no network."""

import html

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.show.meshcat.meshcat_scene import MeshcatScene
from selftouch_drake.show.meshcat.stage import FRAMES_PER_S, drawn_page
from selftouch_drake.show.run_data import RunData, Targets
from selftouch_drake.show.skins import touch_paths

#: Repetitions of an animation; the controls of the page stop it.
REPETITIONS = 1000
# s, for which the end is held.
_PAUSE_S = 1.0


def recording_page(data: RunData, targets: Targets) -> str:
    """The page of the plan that the targets name, as HTML.

    Raises:
        MissingError: the plan was not executed.
    """
    data.execution(*targets)
    with drawn_page() as meshcat:
        full = record(meshcat, data, targets)
        page = meshcat.StaticHtml()
    name = data.run.experiment.name
    return with_legend(
        page,
        f"{name}: sensation {' to '.join(map(str, targets))}",
        "The agent touches itself. Blue is its plan, from green to blue; orange is the path that "
        "it took; red on the recovered body is where it feels itself. The more a receptor feels, "
        f"the darker it is, up to {full:.1f} N per receptor.",
    )


def with_legend(page: str, title: str, text: str) -> str:
    """A page of Meshcat's with its title, and over it what its colours mean."""
    title = html.escape(title)
    legend = f"""
  <div style="position: fixed; left: 1rem; top: 1rem; max-width: 22rem; color: #22262b;
              font: 14px/1.4 system-ui, sans-serif; pointer-events: none">
    <strong>{title}</strong><br>
    {html.escape(text)}
  </div>
"""
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, end, tail = page.rpartition("</body>")
    return head + legend + end + tail


def record(meshcat: Meshcat, data: RunData, targets: Targets) -> float:
    """Draws the agent and records the executed plan that the targets name.

    Returns:
        N, the reading of a receptor that is shown in the strongest colour.
    """
    execution = data.execution(*targets)
    motion, rows = execution.motion, frame_rows(execution.motion.time_s)
    scene = MeshcatScene(meshcat, data)
    scene.draw_path(touch_paths(data.world, motion.q), len(motion.q))
    scene.draw_trace(touch_paths(data.world, execution.q_measured))
    # What is set with a time is recorded only; live, the recording is played.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    recording = meshcat.get_mutable_recording()
    recording.set_repetitions(REPETITIONS)
    scene.record(
        recording, execution.q_measured[rows], execution.felt[rows], motion.predicted[rows]
    )
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return scene.full


def frame_rows(time_s: np.ndarray) -> np.ndarray:
    """The row of a log `(T,)` s for each frame; the last row is held for a while."""
    duration = time_s[-1] - time_s[0]
    frame_s = np.arange(int(np.ceil((duration + _PAUSE_S) * FRAMES_PER_S))) / FRAMES_PER_S
    rows = np.searchsorted(time_s - time_s[0], frame_s - 1e-9)
    return np.minimum(rows, len(time_s) - 1)
