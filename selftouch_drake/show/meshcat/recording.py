"""An executed plan as a Meshcat animation, and as a page that needs no network."""

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.show.meshcat.legend import with_legend
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
