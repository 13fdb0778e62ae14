"""Why the number of parts may be wrong: receptors with gaps between them (naive).

Parts are told apart by touches that receptors share. Where a skin has a gap, the receptors on
either side share few. So do those of two skins that something is caught between. Touches do not
tell the two apart.
"""

from collections.abc import Iterator

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.holes import Topology

#: Two parts may be one if a receptor of either shares this many touches, and felt so many. Of skins
#: of 200 receptors scattered at random over half a ball, those across a gap share 0.25 to 0.4. Two
#: arms that touch a body and each other share 0.07; skins of an infant 0.1, but for a fist that was
#: caught between two of them: 0.36.
_MAYBE_ONE, _LEAST_FELT = 0.2, 100


def doubts_of_parts(
    representation: QuotientRepresentation,
    sensation: np.ndarray,
    topologies: list[Topology | None],
) -> list[str]:
    """Why the number of parts is not sure, a line each; nothing if it is.

    Args:
        representation: of the body.
        sensation: `(n, S)` N, touches, unselected.
        topologies: of its parts.
    """
    lines = [
        f"part {number} counts as one, but its places fall into {found.betti[0]} pieces"
        for number, found in enumerate(topologies)
        if found is not None and found.betti[0] > 1
    ]
    return lines + [
        f"parts {one} and {other} may be one with a gap between its receptors: {share:.0%} of the "
        "touches of a receptor on one are felt on the other"
        for one, other, share in _shared(representation, sensation)
    ]


def _shared(
    representation: QuotientRepresentation, sensation: np.ndarray
) -> Iterator[tuple[int, int, float]]:
    """Pairs of parts that share many touches, and how many."""
    if representation.num_parts == 1:
        return
    touched = (np.asarray(sensation) > 0).astype(np.float32)
    together = touched.T @ touched
    felt = np.diag(together)
    rarer = np.minimum(felt[:, None], felt)
    share = np.where(rarer >= _LEAST_FELT, together / np.maximum(rarer, 1.0), 0.0)
    # The part of a receptor is that of the kernels that it feels most.
    weight = np.zeros((representation.num_parts, touched.shape[1]))
    for part in range(representation.num_parts):
        weight[part] = representation.target_sensations[representation.part == part].sum(axis=0)
    for one in range(representation.num_parts):
        for other in range(one + 1, representation.num_parts):
            here, there = (weight.argmax(axis=0) == p for p in (one, other))
            known = weight.max(axis=0) > 0
            most = share[np.ix_(here & known, there & known)].max(initial=0.0)
            if most >= _MAYBE_ONE:
                yield one, other, float(most)
