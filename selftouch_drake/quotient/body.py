"""The body that the agent recovers: shape, holes and dimension (paper, section IV).

With one finger, X/=_phi is the space of points of contact on the body, and M/=_Psi its
representative. So a layout of the quotient graph is a discrete shape of the body, as in figure 3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .alpha import flat
from .dimension import LEAST_KERNELS, intrinsic_dimension, skin_dimension, space_dimension
from .holes import Topology, topology
from .layout import Embedding, curvature_corrected_mds
from .lengths import BodyGraph, sensorimotor
from .paths import geodesics
from .representation import Representation
from .sensations import angles

#: Lays out N nodes, from `(E, 2)` edges, `(N, N)` shortest paths over them, and a dimension.
LayoutMethod = Callable[[np.ndarray, np.ndarray, int], Embedding]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """A body, or a part of one: n kernels.

    Attributes:
        distances: `(n, n)` geodesic distances along the body, in a unit of its own.
        skin_dimension: 1 if the skin is a line, 2 if it is a surface.
        space_dimension: of the space that the body needs, 2, 3 or 4.
        embedding: layout of the kernels in that space, in an arbitrary pose; in three dimensions if
            the body needs a fourth.
        topology: its holes; None if not requested, or if all kernels lie in a plane of three
            dimensions.
        dimension: its intrinsic dimension; None if not requested, or with fewer than 50 kernels.
    """

    distances: np.ndarray
    skin_dimension: int
    space_dimension: int
    embedding: Embedding
    topology: Topology | None
    dimension: float | None

    @property
    def positions(self) -> np.ndarray:
        """`(n, d)` positions of the kernels, d = 2 or 3."""
        return self.embedding.positions


def recover(
    representation: Representation,
    measure: Callable[[Representation], BodyGraph] = sensorimotor,
    layout_method: LayoutMethod = curvature_corrected_mds,
) -> Shape:
    """Recovers the body from a representation of 5 kernels or more.

    Args:
        representation: what was learned.
        measure: measures along the body: one of `lengths`, in whose graph nodes are kernels.
        layout_method: finds places that fit the distances.

    Raises:
        ValueError: the representation is too small.
    """
    skin = skin_of(representation)
    graph = measure(representation)
    distances = graph.geodesics(graph.length)
    layout, space = layout_and_space(graph.edges, distances, skin, layout_method)
    found, dimension = holes_and_dimension(layout.positions, distances, skin)
    return Shape(
        distances=distances,
        skin_dimension=skin,
        space_dimension=space,
        embedding=layout,
        topology=found,
        dimension=dimension,
    )


def skin_of(representation: Representation) -> int:
    """Whether the skin is a line (1) or a surface (2), by what neighbours feel."""
    by_feel = angles(representation.target_sensations, representation.edges)
    return skin_dimension(geodesics(representation.edges, by_feel, representation.num_targets))


def layout_and_space(
    edges: np.ndarray, distances: np.ndarray, skin: int, layout_method: LayoutMethod
) -> tuple[Embedding, int]:
    """Lays out nodes in as many dimensions as they need, at most 3, and says how many that are.

    The `(N, N)` distances are shortest paths over `(E, 2)` edges; `skin` is the dimension of it.
    """
    layout = layout_method(edges, distances, skin + 1)
    space = space_dimension(edges, distances, layout, skin)
    if skin + 1 != min(space, 3):
        layout = layout_method(edges, distances, space)
    return layout, space


def holes_and_dimension(
    places: np.ndarray, distances: np.ndarray, skin: int
) -> tuple[Topology | None, float | None]:
    """Holes of a body at `(N, d)` places, and dimension by `(n, n)` distances; as in `Shape`.

    `skin` is the dimension of the skin.
    """
    holes = None if flat(places) else topology(places)
    enough = len(distances) >= LEAST_KERNELS
    return holes, intrinsic_dimension(distances, skin) if enough else None
