"""Links: the points of M/=_Psi between which a plan may step (paper, "Motor planning").

In the paper, plans step along the complete graph. The quotient graph here measures the body, so one
edge through it would distort all of it; a planner needs more freedom. `step_links` joins kernels
between which the agent may step: the edges of the graph, so that all of a body can be reached, and
all pairs of kernels that feel alike, however far apart their motor configurations are. A planner
weights each link by the actual step and penalises leaps. So an unneeded link costs nothing, but a
missing link costs a detour: over 200 plans on a torus (1000 targets), the cubed steps sum to 1.49
along edges alone and to 1.1 with links.
"""

import numpy as np

from .sensations import target_distances

#: Kernels whose targets are within this many spacings are linked; 1.4 to 2 work equally well. With
#: 200 targets the next limit decides; on the cube with 800, half and twice lose 3 % of contact.
LINK_SPACINGS = 1.5
# With few targets the spacing is too wide to be useful: sensations that have nothing in common are
# sqrt(2) apart. Twice this distance shortens plans by a third, and costs 18 % of contact.
_MOST_APART = 1.0

# Links between targets farther apart than this many spacings are leaps: they cut through the body.
# Half gives more contact, on plans more than twice as long.
_LEAP_SPACINGS = 1.25
# The cost of a leap grows with this power of its length beyond that. On 400 plans with 300 targets,
# contact was lost for 2.8 % of the time without it, for 0.6 % with it, on paths 4 % longer.
_LEAP_POWER = 16.0


def step_links(targets: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """`(L, 2)` the kernels between which plans may step, each pair once, in order.

    Targets are `(K, S)`, of unit L2 norm; `(E, 2)` edges are those of the quotient graph.
    """
    distance, spacing = target_distances(targets)
    linked = distance <= min(LINK_SPACINGS * spacing, _MOST_APART)
    i, j = edges.T
    linked[i, j] = True
    return np.argwhere(np.triu(linked | linked.T, 1))


def link_lengths(targets: np.ndarray, links: np.ndarray) -> np.ndarray:
    """`(L,)` lengths of `(L, 2)` links along the body as the agent feels it, in spacings."""
    distance, spacing = target_distances(targets)
    return distance[*links.T] / spacing


def leap_penalty(length: np.ndarray) -> np.ndarray:
    """`(L,)` factors, 1 or more, on the cost of links of these lengths, of `link_lengths`.

    Configurations of two kernels can be close although the places that they touch are not: the
    finger would leap through the inside of the body. The distance of the target sensations
    separates these links from the others (area under the ROC curve, on edges of the graph, 0.94 to
    0.98; the motor step alone 0.60 to 0.63).
    """
    return np.maximum(1.0, length / _LEAP_SPACINGS) ** _LEAP_POWER
