"""How one toucher moves over one part of the skin, as a body model has it."""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.chain import slopes
from selftouch_drake.agent.body_model.model import UNUSED, BodyModel
from selftouch_drake.agent.body_model.support import bulge

# Share of the joints' squared reach by which a step towards a place is damped.
_DAMPED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """The joints between a part of the skin and a toucher, and where they carry it.

    L joints of the J that the body has. Places are in the frame of the link that wears the part, in
    the model's unit of length.

    Attributes:
        part: the part of the skin.
        toucher: what touches it.
        joints: `(L,)` the joints on the way from the part to the toucher.
        signs: `(L,)` 1, or -1 for joints that the way passes backwards.
        twists: `(L, 6)` of these joints.
        point: `(3,)` the toucher's centre in the frame of its link.
        shape: `(5,)` its surface, as in `BodyModel.toucher_shape`.
    """

    part: int
    toucher: int
    joints: np.ndarray
    signs: np.ndarray
    twists: np.ndarray
    point: np.ndarray
    shape: np.ndarray

    @classmethod
    def of(cls, model: BodyModel, part: int, toucher: int) -> "Reach | None":
        """How a toucher of a model moves over a part; None if no joint moves it there."""
        wearer = int(model.part_link[part])
        if wearer == UNUSED:
            return None
        back, there = model.between(wearer, int(model.toucher_link[toucher]))
        joints = np.array(back + there, dtype=int)
        if not len(joints):
            return None
        return cls(
            part=part,
            toucher=toucher,
            joints=joints,
            signs=np.repeat([-1.0, 1.0], [len(back), len(there)]),
            twists=model.twists[joints],
            point=model.toucher_place[toucher],
            shape=model.toucher_shape[toucher],
        )

    def places(self, q: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the toucher is, and how its joints move it.

        Args:
            q: `(n, J)` readings of all joints.
            normal: `(n, 3)` outward normals of the skin that it touches; they do not matter to a
                toucher without a shape.

        Returns:
            `(n, 3)` the centre of a ball that touches the skin where the toucher does, and
            `(n, 3, L)` its derivatives by the readings of `joints`.
        """
        q = q[:, self.joints]
        place, by_q, turn = slopes(q, self.twists, self.point, self.signs)
        if not self.shape.any():
            return place, by_q
        away = -np.einsum("nij,ni->nj", turn, normal)
        place, by_q, _ = slopes(q, self.twists, self.point + bulge(self.shape, away), self.signs)
        return place, by_q


def step_towards(way: np.ndarray, by_q: np.ndarray, longest: float) -> np.ndarray:
    """`(n, L)` a step of the joints that brings a toucher nearer to where it should be.

    Damped least squares: the shortest step that does, no longer than `longest`.

    Args:
        way: `(n, 3)` from where it is to where it should be.
        by_q: `(n, 3, L)` how the joints move it there.
        longest: norm of a step.
    """
    square = np.einsum("nal,nbl->nab", by_q, by_q)
    damping = _DAMPED * np.einsum("naa->n", square)
    square += damping[:, None, None] * np.eye(3)
    pull = np.linalg.solve(square, way[:, :, None])[:, :, 0]
    step = np.einsum("nal,na->nl", by_q, pull)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, longest / np.maximum(size, 1e-12))
    return step
