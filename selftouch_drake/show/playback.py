"""Recordings of executed plans: a page to keep, or a live view."""

from __future__ import annotations

import contextlib
import gc
import html
import logging
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams

from selftouch_drake.files import write_text_whole
from selftouch_drake.run_directory import RunDirectory
from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.recording import record
from selftouch_drake.show.style import PRESSURE


def write_playback(run: RunDirectory, start: int, goal: int) -> Path:
    """Records an executed plan into the run's `playback.html`, a page that needs no network.

    Args:
        run: the run.
        start: target sensation from which the plan leads.
        goal: target sensation to which it leads.

    Raises:
        MissingError: the plan was not executed.
    """
    page = _recorded_page(Material(run), start, goal)
    # Drake's diagrams are in reference cycles, and this one held the Meshcat server and its port.
    gc.collect()
    write_text_whole(run.playback, page)
    return run.playback


def play(
    run: RunDirectory, *, port: int | None = None, announce: Callable[[str], None] = print
) -> None:
    """Serves a recording of all executed plans to a browser, until interrupted.

    Args:
        run: the run.
        port: of the page; by default the first free one from 7000 on.
        announce: told where to look.

    Raises:
        MissingError: no plan was executed.
        ValueError: the port is taken.
    """
    material = Material(run)
    pairs = [pair for pair in material.pairs if "felt" in material.plan(*pair)]
    if not pairs:
        raise MissingError(f"{run.path} has no executed plan; run `selftouch execute`")
    with _quiet():
        try:
            meshcat = Meshcat(_params(port=port))
        except RuntimeError:
            raise ValueError(f"--port {port} is taken; choose another, or none") from None
    record(meshcat, material, pairs)
    announce(f"{len(pairs)} executed plans at {meshcat.web_url()} (Ctrl-C to end)")
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)


def _recorded_page(material: Material, start: int, goal: int) -> str:
    material.executed(start, goal)
    with _quiet():
        meshcat = Meshcat(_params(port=None))
    scale = record(meshcat, material, [(start, goal)])
    title = f"{material.run.experiment.name}: sensation {start} to {goal}"
    has_mind = meshcat.HasPath("/mind/kernels")
    return _with_legend(meshcat.StaticHtml(), title, scale, has_mind=has_mind)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keeps Drake from announcing a server that nobody is to visit."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)


def _params(*, port: int | None) -> MeshcatParams:
    return MeshcatParams(host="localhost", port=port, show_stats_plot=False)


def _with_legend(page: str, title: str, scale: float, *, has_mind: bool) -> str:
    """Lays a title and the scale of the colours over Meshcat's page."""
    stops = ", ".join(
        "rgb({:.0f},{:.0f},{:.0f})".format(*(255 * np.array(PRESSURE(x)[:3])))
        for x in np.linspace(0.0, 1.0, 9)
    )
    words = "The agent touches itself; dots are its plan, from green to blue."
    if has_mind:
        words += " To the right, the body as it recovered it, and in red the sensation it feels."
    legend = f"""
  <div style="position: fixed; left: 1rem; bottom: 1rem; max-width: 22rem; color: #22262b;
              font: 14px/1.4 system-ui, sans-serif; pointer-events: none">
    <strong>{html.escape(title)}</strong><br>
    {words}
    <div style="height: 10px; margin-top: 6px; border: 1px solid #888;
                background: linear-gradient(to right, {stops})"></div>
    <span style="float: left">0</span><span style="float: right">{scale:.1f} N a receptor</span>
  </div>
"""
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(title)}</title>", 1)
    head, end, tail = page.rpartition("</body>")
    return head + legend + end + tail
