"""The quotient graph for other tools."""

from typing import TYPE_CHECKING

import numpy as np

from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient import graph as quotient_graph

if TYPE_CHECKING:
    import networkx as nx


def to_networkx(representation: QuotientRepresentation, *, complete: bool = False) -> "nx.Graph":
    """The quotient graph as a networkx graph, as in `quotient.graph.to_networkx`.

    Nodes also have the attribute `part` and, of a representation with an embedding, `position`,
    `(3,)` in the embedding of their part.
    """
    import networkx as nx  # not needed to plan

    graph = quotient_graph.to_networkx(representation, complete=complete)
    nx.set_node_attributes(graph, dict(enumerate(representation.part.tolist())), "part")
    if isinstance(representation, EmbeddedRepresentation):
        nx.set_node_attributes(graph, dict(enumerate(representation.embedding)), "position")
    return graph


def without_vectors(graph: "nx.Graph") -> "nx.Graph":
    """A graph of `to_networkx` for formats without vectors, such as GraphML.

    A node's `position` becomes `position_0` to `position_2`, and so on.
    """
    plain = graph.copy()
    for _, attributes in plain.nodes(data=True):
        for name in [name for name, value in attributes.items() if np.ndim(value)]:
            for i, entry in enumerate(np.asarray(attributes.pop(name)).tolist()):
                attributes[f"{name}_{i}"] = entry
    return plain
