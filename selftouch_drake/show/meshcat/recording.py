"""An executed plan as a Meshcat animation, and as a page that needs no network."""

import html
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.show.meshcat.meshcat_scene import MeshcatScene
from selftouch_drake.show.meshcat.stage import FRAMES_PER_S, drawn_page
from selftouch_drake.show.run_data import RunData, Targets
from selftouch_drake.show.skins import touch_paths
from selftouch_drake.show.style import BLUE, GREEN, ORANGE, VERMILION

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
        "The agent touches itself. The more a receptor feels, the darker it is, up to "
        f"{full:.1f} N per receptor.",
        (
            (GREEN, "start"),
            (BLUE, "plan and goal"),
            (ORANGE, "path that it took"),
            (VERMILION, "what touches; on the recovered body, where it feels itself"),
        ),
    )


# Meshcat keeps the height of a scene: on a page that is narrower than it is high, what stands
# beside the robot would leave the screen. This ratio of width to height shows all of it.
_WIDE = 1.5


def with_legend(
    page: str, title: str, text: str, colors: Sequence[tuple[str, str]] = (), *, wide: float = _WIDE
) -> str:
    """A page of Meshcat's with its title, and over it what its colours mean.

    Args:
        page: HTML.
        title: of the page.
        text: a sentence or two below it.
        colors: and what each stands for.
        wide: width over height that the scene needs: on narrower screens, it becomes smaller.
    """
    title = html.escape(title)
    entries = "".join(
        f'<li style="margin-right: .8em"><span style="color: {color}">&#9679;</span> '
        f"{html.escape(meaning)}</li>"
        for color, meaning in colors
    )
    legend = f"""
  <style>
    #legend {{ position: fixed; left: 1rem; top: 1rem; width: min(22rem, 100vw - 2rem);
              color: #22262b; font: 14px/1.4 system-ui, sans-serif; pointer-events: none }}
    #legend ul {{ display: flex; flex-wrap: wrap; list-style: none; margin: .3em 0; padding: 0 }}
    /* Below Meshcat's button for its controls. */
    @media (max-width: 40rem) {{ #legend {{ top: 2rem; font-size: 12px }} }}
  </style>
  <div id="legend"><strong>{title}</strong><br>{html.escape(text)}<ul>{entries}</ul></div>
  <script>
    function fitScene() {{
      viewer.camera.zoom = Math.min(1, innerWidth / innerHeight / {wide});
      viewer.camera.updateProjectionMatrix();
      viewer.set_dirty();
    }}
    addEventListener("resize", fitScene);
    fitScene();
  </script>
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
