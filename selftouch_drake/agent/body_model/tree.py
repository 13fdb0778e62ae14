"""Trees of joints: ways through them, and the same tree for raw readings."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint, exponentials
from selftouch_drake.agent.body_model.fit import Way
from selftouch_drake.agent.body_model.model import BASE


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """A rooted tree of joints, with what its links carry.

    Attributes:
        parent: the joint, or `BASE`, on whose link each joint stands.
        part: the link of each part: a joint, or `BASE`.
        toucher: the link of each toucher.
    """

    parent: Mapping[int, int]
    part: Mapping[int, int]
    toucher: Mapping[int, int]

    @staticmethod
    def chain(order: list[int], part: int = 0, num_touchers: int = 1) -> "Tree":
        """A part on the base, and touchers at the end of a chain."""
        parent = dict(zip(order, [BASE, *order[:-1]], strict=True))
        end = order[-1] if order else BASE
        return Tree(parent, {part: BASE}, dict.fromkeys(range(num_touchers), end))

    def above(self, link: int) -> list[int]:
        """The joints from a link up to the base, the nearest one first."""
        joints = []
        while link != BASE:
            joints.append(link)
            link = self.parent[link]
        return joints

    def way(self, start: int, end: int) -> Way:
        """From one link to another: joints on both ways to the base cancel."""
        up, down = self.above(start), self.above(end)
        while up and down and up[-1] == down[-1]:
            up, down = up[:-1], down[:-1]
        return tuple([(joint, -1) for joint in up] + [(joint, 1) for joint in down[::-1]])

    def ways(self, pairs: list[tuple[int, int]]) -> dict[tuple[int, int], Way]:
        """Ways of pairs of part and toucher."""
        return {(p, u): self.way(self.part[p], self.toucher[u]) for p, u in pairs}

    def root_first(self) -> list[int]:
        """All joints, each after those that carry it."""
        return sorted(self.parent, key=lambda joint: len(self.above(joint)))


def for_readings(
    tree: Tree, twists: np.ndarray, center: np.ndarray, scale: np.ndarray, motion: np.ndarray
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Twists of a tree for readings q, from those for `(q - center) / scale`.

    Args:
        tree: of joints.
        twists: `(J, 6)` for standardised readings.
        center: `(J,)` of the readings.
        scale: `(J,)` of the readings.
        motion: `(4, 4)` similarity from the frame of these twists to the model's.

    Returns:
        `(J, 6)` twists in the frame of all at `q = 0`, 0 for joints out of the tree; and of each
        link, `BASE` too, the `(4, 4)` similarity that carries points of its frame at standardised
        readings of 0 to that frame.
    """
    carried = {BASE: np.array(motion, dtype=float)}
    found = np.zeros_like(twists)
    for joint in tree.root_first():
        before = carried[tree.parent[joint]]
        found[joint] = adjoint(before, twists[joint] / scale[joint])
        back = exponentials(-twists[joint] * center[joint] / scale[joint])[0]
        carried[joint] = before @ back
    return found, carried
