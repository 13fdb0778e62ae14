"""The first ten seconds of a run's babbling, as a page that plays them and needs no network."""

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.colors import FIRM
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experience.walk import CHOICE_S
from selftouch_drake.robot import World
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.meshcat.legend import with_legend
from selftouch_drake.show.meshcat.recording import REPETITIONS
from selftouch_drake.show.meshcat.stage import FRAMES_PER_S, FeelingRobot, Stage, drawn_page
from selftouch_drake.show.style import VERMILION
from selftouch_drake.systems.simulation import Babbling

#: s, of the walk that is shown.
SHOWN_S = 10.0

# Share of the touches that are weaker than the strongest colour.
_WEAKER = 0.75


def babbling_page(run: RunDirectory, world: World) -> str:
    """The page of a run that has babbled, as HTML.

    A random walk is simulated anew, under dynamics, in the diagram of `MakeSelfTouchDiagram`. An
    active explorer has no walk: the page shows the postures of its first touches.

    Raises:
        StoreError: it has not babbled.
    """
    experience = ExperienceReader(run.experience)
    sensation = next(experience.batches("sensation"))
    full = float(np.quantile(np.linalg.norm(sensation, axis=1), _WEAKER)) or FIRM
    name, active = run.experiment.name, run.experiment.babbling.strategy == "active"
    with drawn_page() as meshcat:
        if active:
            _record_touches(meshcat, run, world, full)
        else:
            _record_walk(meshcat, run, world, full)
        page = meshcat.StaticHtml()
    what = (
        "An active explorer has no random walk: these are the postures of its first touches, "
        if active
        else "The agent babbles: joint controllers follow its random walk under gravity, torque "
        "limits and contact forces, "
    )
    return with_legend(
        page,
        f"{name}: the first {SHOWN_S:.0f} seconds of babbling",
        f"{what}{SHOWN_S:.0f} seconds of them. The more a receptor feels, the darker it is, up to "
        f"{full:.1f} N per receptor.",
        ((VERMILION, "what touches"),),
        wide=1.0,
    )


def _record_walk(meshcat: Meshcat, run: RunDirectory, world: World, full: float) -> None:
    """Records walk 0 as it is simulated."""
    Stage(meshcat, world)
    simulation = Babbling(
        run.experiment.after(0), world.skins, log_period=np.inf, meshcat=meshcat, full=full
    )
    _start(meshcat)
    simulation.begin(0)
    simulation.advance_to(SHOWN_S)
    meshcat.StopRecording()
    simulation.visualizer.AddToRecording()
    meshcat.PublishRecording()


def _record_touches(meshcat: Meshcat, run: RunDirectory, world: World, full: float) -> None:
    """Records the stored touches of the first seconds; nothing is simulated."""
    robot, babbling = FeelingRobot(meshcat, world, full=full), run.experiment.babbling
    experience = ExperienceReader(run.experience)
    step, (sensation, q) = next(experience.steps()), next(experience.touches())
    step_s = CHOICE_S if babbling.mode == "dynamic" else babbling.step_duration
    row = _rows_of_frames(step_s * (step - step[0]))
    _start(meshcat)
    recording = meshcat.get_mutable_recording()
    robot.record(recording, q[row].astype(float), sensation[row].astype(float))
    meshcat.StopRecording()
    meshcat.PublishRecording()


def _rows_of_frames(time_s: np.ndarray) -> np.ndarray:
    """`(frames,)` the touch that each frame shows: the last of those at `(n,)` s from 0 on."""
    frame_s = np.arange(round(SHOWN_S * FRAMES_PER_S)) / FRAMES_PER_S
    return np.searchsorted(time_s, frame_s + 1e-9, side="right") - 1


def _start(meshcat: Meshcat) -> None:
    # What is set with a time is recorded only; live, the recording is played.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    meshcat.get_mutable_recording().set_repetitions(REPETITIONS)
