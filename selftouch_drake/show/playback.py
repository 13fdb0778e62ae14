"""Executed plans as a Meshcat recording: a page to keep, or a live view."""

from __future__ import annotations

import gc
import html
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from selftouch_drake.files import write_text_whole
from selftouch_drake.run_directory import RunDirectory
from selftouch_drake.show.material import Material, Missing
from selftouch_drake.show.motion_figures import evenly_spaced
from selftouch_drake.show.scene import View
from selftouch_drake.show.style import BLUE, GREEN, PRESSURE, RECOVERED, SKIN, VERMILION
from selftouch_drake.world.station import MakeKinematicStation

FRAMES_PER_S = 30
# The recovered body is drawn to the right of the real one in this view.
_VIEW = View(elevation=20.0, azimuth=-70.0)
# Pressure is shown in so many steps: few enough that a receptor's colour changes seldom.
_STEPS = 24
# The page starts over so often; its controls stop it.
_REPETITIONS = 1000
# s, between two plans in one recording.
_PAUSE_S = 1.0


def write_playback(run: RunDirectory, start: int, goal: int) -> Path:
    """Records an executed plan into the run's `playback.html`, a page that needs no network.

    Args:
        run: the run.
        start: target sensation from which the plan leads.
        goal: target sensation to which it leads.

    Raises:
        Missing: the plan was not executed.
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
        Missing: no plan was executed.
    """
    material = Material(run)
    pairs = [pair for pair in material.pairs if "felt" in material.plan(*pair)]
    if not pairs:
        raise Missing(f"{run.path} has no executed plan; run `selftouch execute`")
    meshcat = Meshcat(_params(port=port))
    record(meshcat, material, pairs)
    announce(f"{len(pairs)} executed plans at {meshcat.web_url()} (Ctrl-C to end)")
    while True:
        time.sleep(1.0)


def _recorded_page(material: Material, start: int, goal: int) -> str:
    material.executed(start, goal)
    meshcat = Meshcat(_params(port=None))
    scale = record(meshcat, material, [(start, goal)])
    title = f"{material.run.experiment.name}: sensation {start} to {goal}"
    has_mind = meshcat.HasPath("/mind/kernels")
    return _with_legend(meshcat.StaticHtml(), title, scale, has_mind=has_mind)


def record(meshcat: Meshcat, material: Material, pairs: Sequence[tuple[int, int]]) -> float:
    """Draws the agent and records executed plans, one after the other.

    Returns:
        N, the reading of a receptor that is shown in the strongest colour.
    """
    plans = [material.executed(*pair) for pair in pairs]
    scale = float(np.quantile(np.concatenate([p["felt"].max(axis=1) for p in plans]), 0.98)) or 1.0
    mind = _draw_agent(meshcat, material)
    station = MakeKinematicStation(material.run.experiment, *material.body, meshcat)
    context = station.diagram.CreateDefaultContext()
    q = station.diagram.GetInputPort("q").FixValue(context, plans[0]["q_measured"][0])
    station.diagram.ForcedPublish(context)

    # Live, the first configuration stays: what is set while recording is only recorded.
    meshcat.StartRecording(FRAMES_PER_S, set_visualizations_while_recording=False)
    begin = 0.0
    for number, plan in enumerate(plans):
        path = f"/plan/{number}"
        _draw_path(meshcat, path, material, plan)
        frame_s, rows = frames(plan["time_s"])
        frame_s = frame_s + begin
        for time_s, row in zip(frame_s, rows, strict=True):
            q.GetMutableData().get_mutable_value().SetFromVector(plan["q_measured"][row])
            context.SetTime(time_s)
            station.diagram.ForcedPublish(context)
        _animate_receptors(meshcat, plan["felt"][rows], frame_s, scale)
        if mind is not None:
            _animate_mind(meshcat, mind, material, plan["felt"][rows], frame_s)
        if number > 0:
            meshcat.SetProperty(path, "visible", False, 0.0)
        meshcat.SetProperty(path, "visible", True, begin)
        begin = frame_s[-1] + _PAUSE_S
        if number + 1 < len(plans):
            meshcat.SetProperty(path, "visible", False, begin)
    meshcat.StopRecording()
    meshcat.get_mutable_recording().set_repetitions(_REPETITIONS)
    meshcat.PublishRecording()
    return scale


def frames(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times of the frames from 0 on, s, and the nearest row of a log to each."""
    duration = time_s[-1] - time_s[0]
    frame_s = np.arange(int(np.ceil(duration * FRAMES_PER_S)) + 1) / FRAMES_PER_S
    rows = np.searchsorted(time_s - time_s[0], np.minimum(frame_s, duration) - 1e-9)
    return frame_s, np.minimum(rows, len(time_s) - 1)


def key_frames(values: np.ndarray) -> Iterator[int]:
    """The frames that say all of a series whose values are held between changes.

    Playing blends from key to key, so that the last frame before a change is a key as well.
    """
    changes = np.flatnonzero(np.diff(values) != 0)
    yield from np.unique(np.concatenate([[0], changes, changes + 1])).tolist()


def _params(*, port: int | None) -> MeshcatParams:
    return MeshcatParams(host="localhost", port=port, show_stats_plot=False)


def _draw_agent(meshcat: Meshcat, material: Material) -> np.ndarray | None:
    """Draws what does not move; returns `(K, 3)` m, the recovered body, where it is drawn."""
    skin = material.skin
    low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
    size = float((high - low).max())
    meshcat.SetTriangleMesh("/body/skin", skin.vertices.T, skin.faces.T, _rgba(SKIN, 0.4))
    for receptor, p_BS in enumerate(skin.p_BS):
        path = _receptor(receptor)
        meshcat.SetObject(path, Sphere(0.02 * size), Rgba(*PRESSURE(0.0)))
        meshcat.SetTransform(path, RigidTransform(p_BS))
    mind = _mind_positions(material, beside=1.5 * size)
    middle = (low + high) / 2
    if mind is not None:
        cloud = _cloud(mind, RECOVERED)
        meshcat.SetObject("/mind/kernels", cloud, point_size=0.016)
        meshcat.SetObject("/mind/here", Sphere(0.03 * size), _rgba(VERMILION))
        middle = (middle + mind.mean(axis=0)) / 2
    for prop in ("/Grid", "/Axes"):
        meshcat.SetProperty(prop, "visible", False)
    meshcat.SetProperty("/Background", "top_color", [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Background", "bottom_color", [0.87, 0.89, 0.92])
    # Room above for the arm, whose links are 0.4 m long.
    middle = middle + [0.0, 0.0, 0.12]
    distance = 0.5 + (1.2 if mind is None else 1.4) * size
    meshcat.SetCameraPose(middle + distance * _VIEW.towards, middle)
    return mind


def _mind_positions(material: Material, *, beside: float) -> np.ndarray | None:
    try:
        positions, _ = material.recovered
    except Missing:
        return None
    return positions + beside * _VIEW.axes[0]


def _draw_path(meshcat: Meshcat, path: str, material: Material, plan: dict) -> None:
    tips = material.fingertips(plan["q"])
    for finger in range(tips.shape[1]):
        dots = evenly_spaced(tips[:, finger], 0.008)
        meshcat.SetObject(f"{path}/path_{finger}", _cloud(dots, BLUE), point_size=0.007)
        for name, row, color in (("start", 0, GREEN), ("goal", -1, BLUE)):
            end = f"{path}/{name}_{finger}"
            meshcat.SetObject(end, Sphere(0.014), _rgba(color))
            meshcat.SetTransform(end, RigidTransform(tips[row, finger]))


def _animate_receptors(
    meshcat: Meshcat, felt: np.ndarray, frame_s: np.ndarray, scale: float
) -> None:
    """Colours the receptors by what they feel.

    A recorded property named `color` is not played back (Drake issue 20879). The colour of the
    material is, and is blended in linear light.
    """
    level = np.rint(_STEPS * np.clip(felt / scale, 0.0, 1.0)).astype(int)
    colors = _linear(PRESSURE(np.arange(_STEPS + 1) / _STEPS)[:, :3]).tolist()
    recording = meshcat.get_mutable_recording()
    keys = [recording.frame(time_s) for time_s in frame_s]
    for receptor in range(level.shape[1]):
        path = f"{_receptor(receptor)}/<object>"
        for frame in key_frames(level[:, receptor]):
            recording.SetProperty(
                keys[frame], path, "material.color", colors[level[frame, receptor]]
            )


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Linear light of sRGB components, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _animate_mind(
    meshcat: Meshcat, mind: np.ndarray, material: Material, felt: np.ndarray, frame_s: np.ndarray
) -> None:
    """Shows in the recovered body which of its sensations the agent feels."""
    kernel = np.argmax(felt @ material.representation.target_sensations.T, axis=1)
    for frame in key_frames(kernel):
        here = RigidTransform(mind[kernel[frame]])
        meshcat.SetTransform("/mind/here", here, float(frame_s[frame]))


def _receptor(receptor: int) -> str:
    return f"/body/receptors/{receptor}"


def _rgba(color: str, alpha: float = 1.0) -> Rgba:
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return Rgba(red, green, blue, alpha)


def _cloud(points: np.ndarray, color: str) -> PointCloud:
    cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = points.T
    cloud.mutable_rgbs()[:] = np.array([[int(color[i : i + 2], 16)] for i in (1, 3, 5)])
    return cloud


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
