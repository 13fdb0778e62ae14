"""The waypoints of an unfinished plan, leg by leg: along links, and through the air."""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.memory import Slides
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.quotient import NO_MODE
from selftouch_drake.quotient.waypoints import smoothest_configurations


class Waypoints:
    """Waypoints of an unfinished plan: first candidates, then one of them for each kernel.

    They come in stretches along links. On a stretch only the joints that matter move; all others
    stay as they were at its beginning.

    Args:
        node: the kernel that is felt at the start.
        x: `(J,)` the scaled configuration there.
        joints: the joints that move from there on.
    """

    def __init__(self, node: int, x: np.ndarray, joints: np.ndarray):
        self.nodes = [node]
        self.in_air: list[bool] = []
        self.links: list[int] = []
        #: The mode of each step along a link; `NO_MODE` of the others.
        self.modes: list[int] = []
        #: Whether each waypoint stays as it is: a leg begins or ends there.
        self.kept = [True]
        self._stretches = [_Stretch(x, joints, [])]

    @property
    def end(self) -> np.ndarray:
        """`(J,)` the last configuration so far."""
        return self._stretches[-1].chosen[-1]

    def follow(
        self, nodes: list[int], links: list[int], layers: list[np.ndarray], mode: int
    ) -> None:
        """Adds steps along links, through one of `(n, joints that move)` candidates per node."""
        self.nodes += nodes
        self.in_air += [False] * len(nodes)
        self.links += links
        self.modes += [mode] * len(nodes)
        self.kept += [False] * (len(nodes) - 1) + [True]
        self._stretches[-1].layers.extend(layers)

    def move(self, node: int, x: np.ndarray, joints: np.ndarray, *, in_air: bool) -> None:
        """Adds a straight step of all joints to `x`; from there on, `joints` move."""
        self.nodes.append(node)
        self.in_air.append(in_air)
        self.links.append(-1)
        self.modes.append(NO_MODE)
        self.kept.append(True)
        self._stretches.append(_Stretch(x, joints, []))

    def passed(
        self, slides: Slides, touch: TouchModel | None, limits: tuple[np.ndarray, np.ndarray]
    ) -> "PassedWaypoints":
        """What the plan passes: known slides replace straight steps, and others are bent.

        Args:
            slides: known slides between touches.
            touch: bends steps along links into the skin, if there is one.
            limits: `(J,)` lowest and highest scaled configuration of what is bent.
        """
        x = np.concatenate([stretch.chosen for stretch in self._stretches])
        between = [x[:0]] * (len(x) - 1)
        if touch is not None:
            x, between = touch.between(x, self.modes, self.kept, limits)
        nodes, waypoints, of_step, imagined = [self.nodes[0]], [x[0]], list[int](), [False]
        for step, node in enumerate(self.nodes[1:]):
            passed, felt = slides.all_between(x[step], x[step + 1])
            imagines = not len(passed)
            if imagines:
                passed = between[step]
                nearer = np.arange(len(passed)) < len(passed) / 2
                felt = np.where(nearer, self.nodes[step], node)
            nodes += [*felt.tolist(), node]
            waypoints += [*passed, x[step + 1]]
            of_step += [step] * (len(passed) + 1)
            imagined += [imagines] * len(passed) + [False]
        return PassedWaypoints(
            nodes=np.array(nodes),
            of_step=np.array(of_step, dtype=int),
            waypoints_x=np.array(waypoints),
            imagined=np.array(imagined),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """A stretch along links.

    Attributes:
        x: `(J,)` the scaled configuration at its beginning.
        joints: the joints that move.
        layers: for each kernel after the first, `(n, joints that move)` candidates.
    """

    x: np.ndarray
    joints: np.ndarray
    layers: list[np.ndarray]

    @property
    def chosen(self) -> np.ndarray:
        """`(1 + layers, J)` one configuration of each kernel."""
        chosen = np.repeat(self.x[None], 1 + len(self.layers), axis=0)
        if self.layers:
            candidates = [self.x[self.joints][None], *self.layers]
            chosen[1:, self.joints] = smoothest_configurations(candidates)[1:]
        return chosen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PassedWaypoints:
    """What a plan of W waypoints passes.

    Attributes:
        nodes: `(W,)` kernels.
        of_step: `(W - 1,)` the step of the unfinished plan that each step belongs to.
        waypoints_x: `(W, J)` scaled configurations.
        imagined: `(W,)` bool, on a bent step, where the agent only expects to touch.
    """

    nodes: np.ndarray
    of_step: np.ndarray
    waypoints_x: np.ndarray
    imagined: np.ndarray
