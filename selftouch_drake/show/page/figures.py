"""All figures of a run: which there are, what they are drawn from, and writing them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.distance import cdist

from selftouch_drake.evaluation import touch_density
from selftouch_drake.files import written_whole
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show import (
    experience_figures,
    graph_figures,
    motion_figures,
    sensation_figures,
    shape_figures,
)
from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.style import DPI

# Touches that are drawn one by one, about: as many as one can tell apart.
_NUM_DOTS = 6000


def agent(material: Material) -> Figure:
    """The agent as it touches itself, its arm well clear of the body."""
    skin, known = material.skin, material.representation
    q = known.kernel_q[:: max(len(known.kernel_q) // 400, 1)].astype(float)
    joints = material.joints(q)
    clear = int(np.linalg.norm(joints[:, 1:], axis=2).min(axis=1).argmax())
    return experience_figures.agent(
        skin.vertices, skin.faces, skin.p_BS, joints[clear], material.fingertips(q)[clear]
    )


def coverage(material: Material) -> Figure:
    """Where babbling touched the body; with two fingers, where the first one was."""
    skin = material.skin
    first = (p_WF[:, :3] for p_WF in material.truth.batches("p_WF"))
    density = touch_density(skin.vertices, skin.faces, first)
    number = material.truth.num_rows
    some = material.truth.take("p_WF", np.arange(0, number, max(number // _NUM_DOTS, 1)))
    return experience_figures.coverage(skin.vertices, skin.faces, density, some[:, :3], number)


def sensations(material: Material) -> Figure:
    """A few target sensations on the skin."""
    skin = material.skin
    return sensation_figures.sensations(
        skin.vertices, skin.faces, skin.p_BS, material.representation.target_sensations
    )


def kernels(material: Material) -> Figure:
    """Sizes, likeness and firmness of the motor kernel sets."""
    known = material.representation
    return sensation_figures.kernels(
        np.diff(known.kernel_offsets), known.kernel_error, known.kernel_strength
    )


def distance_matrix(material: Material) -> Figure:
    """Distances between kernel sets, against the truth where it is there."""
    known = material.representation
    try:
        positions = material.kernel_positions
    except MissingError:
        return graph_figures.distance_matrix(known.set_distance)
    return graph_figures.distance_matrix(known.set_distance, cdist(positions, positions))


def quotient_graph(material: Material) -> Figure:
    """The quotient graph in the embedding."""
    known = material.representation
    return graph_figures.quotient_graph(material.embedding, known.edges, known.edge_cost)


def body_shape(material: Material) -> Figure:
    """The body and the body that the agent recovered (paper, figure 3)."""
    skin = material.skin
    recovered, faces = material.recovered
    return shape_figures.body_shape(
        skin.vertices,
        skin.faces,
        skin.p_BS,
        recovered,
        faces,
        num_kernels=len(material.embedding),
        rms_fraction=material.metrics.get("shape_rms_fraction"),
    )


def persistence(material: Material) -> Figure:
    """Components, loops and voids of the recovered body."""
    return shape_figures.persistence(
        material.diagrams, betti=material.metrics.get("topology_betti")
    )


def plan_path(material: Material) -> Figure:
    """One plan round the body (paper, figure 4)."""
    skin, plan = material.skin, material.plan(*material.shown_pair)
    return motion_figures.plan_path(
        skin.vertices,
        skin.faces,
        material.fingertips(plan["q"]),
        material.fingertips(plan["waypoints_q"]),
    )


def felt_and_predicted(material: Material) -> Figure:
    """What was felt along that plan, and what had been predicted."""
    plan = material.executed(*material.shown_pair)
    return motion_figures.felt_and_predicted(plan["time_s"], plan["predicted"], plan["felt"])


def contact_and_tracking(material: Material) -> Figure:
    """Force and tracking along that plan."""
    plan = material.executed(*material.shown_pair)
    return motion_figures.contact_and_tracking(
        plan["time_s"], plan["q"], plan["q_measured"], plan["felt"]
    )


# In the order of the paper. The name is that of the file.
FIGURES: dict[str, Callable[[Material], Figure]] = {
    "agent": agent,
    "coverage": coverage,
    "sensations": sensations,
    "kernels": kernels,
    "distance_matrix": distance_matrix,
    "quotient_graph": quotient_graph,
    "body_shape": body_shape,
    "persistence": persistence,
    "plan_path": plan_path,
    "felt_and_predicted": felt_and_predicted,
    "contact_and_tracking": contact_and_tracking,
}


def write_figures(
    run: RunDirectory,
    *,
    vector: bool = False,
    progress: Callable[[float, str], None] = lambda fraction, doing: None,
    skipped: Callable[[str, str], None] = lambda name, reason: None,
) -> list[Path]:
    """Draws the figures whose data exist into the run's `figures` folder.

    Args:
        run: the run, with any of its stages done.
        vector: whether to write each as PDF as well, for papers: words, lines and marks as such,
            shaded bodies as pictures.
        progress: told the fraction done and what is being drawn.
        skipped: told the name of each figure that cannot be drawn, and the reason.

    Returns:
        The PNG files written, in the order of `FIGURES`. A figure that cannot be drawn any more is
        removed, so that none shows what is no longer true.

    Raises:
        ValueError: a file of the run is damaged, or of another experiment; nothing was drawn.
    """
    material = Material(run)
    material.require_sound()
    run.figures.mkdir(exist_ok=True)
    written = []
    for number, (name, draw) in enumerate(FIGURES.items()):
        progress(number / len(FIGURES), name.replace("_", " "))
        path, for_papers = (run.figures / f"{name}.{kind}" for kind in ("png", "pdf"))
        # A PDF of before is not asked for now, and may no longer be true.
        for_papers.unlink(missing_ok=True)
        try:
            figure = draw(material)
        except MissingError as reason:
            path.unlink(missing_ok=True)
            skipped(name, str(reason))
            continue
        _write(figure, path, dpi=DPI, metadata={"Software": None})
        if vector:
            _write(figure, for_papers, dpi=2 * DPI, metadata={"CreationDate": None})
        written.append(path)
    return written


def _write(figure: Figure, path: Path, *, dpi: int, metadata: dict[str, None]) -> None:
    # Letters stay letters in a PDF, as journals ask.
    with written_whole(path) as aside, mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(
            aside, format=path.suffix[1:], dpi=dpi, bbox_inches="tight", metadata=metadata
        )
