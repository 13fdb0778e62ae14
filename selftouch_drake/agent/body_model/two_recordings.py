"""What changed of a known body between two recordings, as each toucher on each part tells."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain_change import (
    ChainChange,
    explained,
    foretold,
)
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.body_model.model import UNUSED, BodyModel, JointKind
from selftouch_drake.agent.body_model.smoothness import Sensed, SmoothChain

# Touches of a toucher on a part that a comparison needs of the second recording, and of the first
# to say how exact places are; and the most of the second one.
_FEWEST, _MOST = 60, 600
# Those of the second one are at most this share of those of the first, which say what is felt
# where: what the first does not know well is the same error in each of them.
_SHARE = 1 / 3


class Touches(NamedTuple):
    """Touches of a recording: `(n, J)` readings, `(n, S)` sensations, `(n,)` target sensations."""

    q: np.ndarray
    sensation: np.ndarray
    target: np.ndarray

    def some(self, rows: np.ndarray) -> "Touches":
        """Some of them."""
        return Touches(self.q[rows], self.sensation[rows], self.target[rows])


class Compared(NamedTuple):
    """What a toucher on a part tells: what changed of the chain between them, if anything did."""

    part: int
    toucher: int
    change: ChainChange | None


def changed_between(model: BodyModel, before: Touches, after: Touches) -> list[Compared]:
    """What changed between two recordings of one robot, for each toucher on each accepted part.

    Pairs with too few touches in one of the recordings are left out.

    Args:
        model: of the first recording.
        before: touches of the first one.
        after: touches of the second; target sensations are those of the first.
    """
    found = []
    of_before, of_after = (_pairs(model, touches) for touches in (before, after))
    for part in np.flatnonzero(model.accepted_by_part & (model.part_link != UNUSED)).tolist():
        for toucher in range(len(model.toucher_link)):
            pair = part, toucher
            here = before.some(_spread((of_before == pair).all(axis=1), 3 * _MOST))
            most = min(_MOST, int(_SHARE * min(len(here.q), model.num_touches[part])))
            there = after.some(_spread((of_after == pair).all(axis=1), most))
            # Every third touch says how exact places are, as the others say them.
            says = np.arange(len(here.q)) % 3 == 0
            if min(int(says.sum()), len(there.q)) < _FEWEST:
                continue
            some, known = (
                chain_between(model, part, toucher, of.q, of.sensation)
                for of in (here.some(~says), here)
            )
            tests, since = ((of.q, of.sensation) for of in (here.some(says), there))
            usual, _ = foretold(some, tests, tests)
            _, now = foretold(known, since, since)
            change = explained(known, usual, replace(now, root=usual.root))
            sure = change is not None and all(part.sure for part in change.parts)
            found.append(Compared(part, toucher, change if sure else None))
    return found


def chain_between(
    model: BodyModel, part: int, toucher: int, q: np.ndarray, sensation: np.ndarray
) -> KnownChain:
    """The chain from a part to a toucher, known by `(n, J)` readings and `(n, S)` sensations."""
    back, on = model.between(int(model.part_link[part]), int(model.toucher_link[toucher]))
    joints = [*back, *on]
    signs = np.array([-1.0] * len(back) + [1.0] * len(on))
    return KnownChain(
        joints=joints,
        chain=SmoothChain(
            signs[:, None] * model.twists[joints], model.toucher_place[toucher], np.inf
        ),
        slides=model.joint_kind[joints] == JointKind.SLIDES,
        center=np.zeros(q.shape[1]),
        scale=np.ones(q.shape[1]),
        q=q,
        sensed=Sensed.of(csr_array(sensation)),
        strength=sensation.max(axis=1),
    )


def _pairs(model: BodyModel, touches: Touches) -> np.ndarray:
    """`(n, 2)` part and toucher of each touch; -1 where the model does not know."""
    part = model.kernel_part[touches.target]
    return np.stack([part, model.touched_by(touches.q, touches.target)], axis=1)


def _spread(chosen: np.ndarray, most: int) -> np.ndarray:
    """Some of the rows that `(n,)` bool says, spread evenly."""
    rows = np.flatnonzero(chosen)
    return rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)]
