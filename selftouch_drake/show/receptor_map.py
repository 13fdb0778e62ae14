"""The picture of a map of receptors: each part, with an error bar as a circle."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from selftouch_drake.agent.shape.receptor_map import FEW_FELT, ReceptorMap
from selftouch_drake.files import written_whole
from selftouch_drake.show.style import AMOUNT, MUTED, SKIN, styled

# Most parts that are drawn.
_MOST_PARTS = 4


@styled
def draw_map(found: ReceptorMap, path: Path) -> None:
    """Draws the receptors of each part on its two widest axes, coloured by the third.

    A circle is the error bar of a receptor; those that felt few touches are hollow.
    """
    parts = found.parts[:_MOST_PARTS]
    figure = Figure(figsize=(4.5 * len(parts), 4.8), layout="constrained")
    for ax, part in zip(np.ravel(figure.subplots(1, len(parts))), parts, strict=True):
        places = found.positions[part.receptors]
        places = places @ np.linalg.svd(places, full_matrices=False)[2].T
        width = 2.0 * found.error[part.receptors]
        circles = EllipseCollection(
            width, width, 0.0, units="xy", offsets=places[:, :2], offset_transform=ax.transData
        )
        circles.set(facecolor=SKIN, alpha=0.4, edgecolor="none")
        ax.add_collection(circles)
        color = AMOUNT(mpl.colors.Normalize()(places[:, 2]))
        few = found.felt[part.receptors] < FEW_FELT
        ax.scatter(*places[~few, :2].T, c=color[~few], s=14)
        ax.scatter(*places[few, :2].T, facecolor="none", edgecolor=MUTED, s=14)
        ax.set_title(f"{len(places)} receptors, in spacings")
        ax.set_aspect("equal")
    figure.suptitle("The receptors, and the error of each place (grey)")
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside:
        figure.savefig(aside, format="png", metadata={"Software": None})
