"""The recording of an executed plan as a page that needs no network."""

from __future__ import annotations

import gc
import html

import numpy as np

from selftouch_drake.show.meshcat.recording import record
from selftouch_drake.show.meshcat.server import open_meshcat
from selftouch_drake.show.run_data import RunData, Targets
from selftouch_drake.show.style import PRESSURE


def recording_page(data: RunData, targets: Targets) -> str:
    """The page, as HTML.

    Args:
        data: of the run.
        targets: target sensations from the first to the last that the plan leads through; the first
            is a text if it begins in any configuration.

    Raises:
        MissingError: the plan was not executed.
    """
    page = _recorded(data, targets)
    # Drake's diagrams are in reference cycles, and this one held the Meshcat server and its port.
    gc.collect()
    return page


def _recorded(data: RunData, targets: Targets) -> str:
    data.execution(*targets)
    meshcat = open_meshcat()
    full = record(meshcat, data, [targets])
    title = f"{data.experiment.name}: sensation {' to '.join(map(str, targets))}"
    return _with_legend(meshcat.StaticHtml(), title, full)


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
