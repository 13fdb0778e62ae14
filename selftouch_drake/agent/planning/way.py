"""The waypoints of a plan, in stretches along links, each with the joints that matter there."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from selftouch_drake.agent.sliding import Slides

#: Chooses one configuration of each layer.
Choose = Callable[[Sequence[np.ndarray]], np.ndarray]


class Way:
    """Waypoints of a plan in the making: first candidates, then one of them for each kernel.

    On a stretch only the joints that matter move; all others stay as they were at its beginning.

    Args:
        node: the kernel that is felt at the start.
        x: `(J,)` the scaled configuration there.
        joints: the joints that move from there on.
        choose: chooses one candidate for each kernel of a stretch.
    """

    def __init__(self, node: int, x: np.ndarray, joints: np.ndarray, choose: Choose):
        self.nodes = [node]
        self.in_air: list[bool] = []
        self.along_link: list[bool] = []
        self._choose = choose
        self._stretches = [(x, joints, list[np.ndarray]())]

    @property
    def end(self) -> np.ndarray:
        """`(J,)` the last configuration so far."""
        return self._chosen(*self._stretches[-1])[-1]

    def follow(self, nodes: list[int], layers: list[np.ndarray]) -> None:
        """Adds steps along links, through one of `(n, joints that move)` candidates per node."""
        self.nodes += nodes
        self.in_air += [False] * len(nodes)
        self.along_link += [True] * len(nodes)
        self._stretches[-1][2].extend(layers)

    def move(self, node: int, x: np.ndarray, joints: np.ndarray, *, in_air: bool) -> None:
        """Adds a straight step of all joints to `x`; from there on, `joints` move."""
        self.nodes.append(node)
        self.in_air.append(in_air)
        self.along_link.append(False)
        self._stretches.append((x, joints, []))

    def passed(self, slides: Slides | None) -> tuple[list[int], np.ndarray, np.ndarray]:
        """The nodes and waypoints of the plan; known slides replace straight steps.

        Returns:
            W kernels; `(W - 1,)` the step of this way that each step of the plan belongs to;
            `(W, J)` scaled configurations.
        """
        x = np.concatenate([self._chosen(*stretch) for stretch in self._stretches])
        if slides is None or not len(slides.ends):
            return self.nodes, np.arange(len(x) - 1), x
        nodes, waypoints, of_step = [self.nodes[0]], [x[0]], list[int]()
        for step, node in enumerate(self.nodes[1:]):
            passed, felt = slides.all_between(x[step], x[step + 1])
            nodes += [*felt.tolist(), node]
            waypoints += [*passed, x[step + 1]]
            of_step += [step] * (len(passed) + 1)
        return nodes, np.array(of_step, dtype=int), np.array(waypoints)

    def _chosen(self, x: np.ndarray, joints: np.ndarray, layers: list[np.ndarray]) -> np.ndarray:
        chosen = np.repeat(x[None], 1 + len(layers), axis=0)
        if layers:
            chosen[1:, joints] = self._choose([x[joints][None], *layers])[1:]
        return chosen
