"""Figures, recording and report of a run, and live play."""

from collections.abc import Callable
from pathlib import Path

from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.experience.store import StoreError
from selftouch_drake.files import write_text_whole
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import MissingError, RunDirectory
from selftouch_drake.run.stages import Progress, silent
from selftouch_drake.run.worlds import require_robot, run_bodies
from selftouch_drake.show.meshcat.babbling import babbling_page
from selftouch_drake.show.meshcat.live import PLAY_FIT, LiveShow
from selftouch_drake.show.meshcat.live_page import shown_page
from selftouch_drake.show.meshcat.recording import recording_page
from selftouch_drake.show.page.figures import draw_figures
from selftouch_drake.show.page.report import report_page
from selftouch_drake.show.run_data import RunData


def write_figures(run: RunDirectory, *, vector: bool = False) -> dict[str, Path | str]:
    """Draws the figures whose data exist into the run's `figures` folder, as `draw_figures`.

    Raises:
        ValueError: a file of the run is damaged, or of another experiment; nothing was drawn.
    """
    data = RunData(run)
    data.require_sound()
    return draw_figures(data, vector=vector)


def write_recording(run: RunDirectory, *targets: int | str, path: Path) -> Path:
    """Records an executed plan into the page `path`, which needs no network.

    Raises:
        MissingError: the plan was not executed.
    """
    write_text_whole(path, recording_page(RunData(run), targets))
    return path


def write_babbling(run: RunDirectory, data: RunData) -> Path | None:
    """Shows the first seconds of babbling in the run's `babbling.html`, if that is not made yet.

    Returns:
        The page; None if nothing babbled, or a body that Drake does not simulate.
    """
    if not run.babbling.exists():
        try:
            write_text_whole(run.babbling, babbling_page(run, data.world))
        except (MissingError, StoreError):
            return None
    return run.babbling


def write_report(run: RunDirectory, progress: Progress = silent, *, vector: bool = False) -> Path:
    """Draws the figures and the recording of a run, and writes its `report.html`.

    Arguments as in `draw_figures`, errors as in `write_figures`.
    """
    data = RunData(run)
    data.require_sound()
    pictures = draw_figures(data, lambda done, doing: progress(0.7 * done, doing), vector=vector)
    progress(0.7, "recording")
    recording: Path | str = run.playback
    try:
        write_text_whole(run.playback, recording_page(data, data.shown_pair))
    except MissingError as reason:
        run.playback.unlink(missing_ok=True)
        recording = str(reason)
    progress(0.8, "babbling")
    babbling = write_babbling(run, data)
    progress(0.9, "report")
    write_text_whole(run.report, report_page(data, pictures, recording, babbling))
    progress(1.0, "reported")
    return run.report


def play(
    run: RunDirectory, *, port: int | None = None, announce: Callable[[str], None] = print
) -> None:
    """Shows the agent of a run live in a browser, until its `end` button or Ctrl-C.

    `port` and `announce`, which also hears of every motion, are as in `shown_page`.

    Raises:
        ValueError: the run has not learned, or the port is taken.
    """
    # Missing parts are reported before a page opens.
    require_robot(run.experiment)
    agent = load_agent(run)
    data = RunData(run)
    pilot = pilot_in(run_bodies(run), agent, run.experiment)
    pilot.prepare_queries()
    with shown_page(f"{run.experiment.name}, live", port, announce, **PLAY_FIT) as meshcat:
        show = LiveShow(meshcat, data, pilot, announce)
        while not show.ended:
            show.step()
