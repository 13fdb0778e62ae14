"""The waypoints of a plan: one motor configuration in each kernel of a route."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import numba
import numpy as np
from numba import njit

from selftouch_drake.agent.memory import Slides
from selftouch_drake.agent.planning.route import square_step
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.quotient import NO_MODE


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
        self._stretches = [(x, joints, list[np.ndarray]())]

    @property
    def end(self) -> np.ndarray:
        """`(J,)` the last configuration so far."""
        return _chosen(*self._stretches[-1])[-1]

    def follow(
        self, nodes: list[int], links: list[int], layers: list[np.ndarray], mode: int
    ) -> None:
        """Adds steps along links, through one of `(n, joints that move)` candidates per node."""
        self.nodes += nodes
        self.in_air += [False] * len(nodes)
        self.links += links
        self.modes += [mode] * len(nodes)
        self.kept += [False] * (len(nodes) - 1) + [True]
        self._stretches[-1][2].extend(layers)

    def move(self, node: int, x: np.ndarray, joints: np.ndarray, *, in_air: bool) -> None:
        """Adds a straight step of all joints to `x`; from there on, `joints` move."""
        self.nodes.append(node)
        self.in_air.append(in_air)
        self.links.append(-1)
        self.modes.append(NO_MODE)
        self.kept.append(True)
        self._stretches.append((x, joints, []))

    def passed(
        self, slides: Slides, touch: TouchModel | None, limits: tuple[np.ndarray, np.ndarray]
    ) -> tuple[list[int], np.ndarray, np.ndarray, list[bool]]:
        """What the plan passes: known slides replace straight steps, and others are bent.

        Args:
            slides: known slides between touches.
            touch: bends steps along links into the skin, if there is one.
            limits: `(J,)` lowest and highest scaled configuration of what is bent.

        Returns:
            W kernels; `(W - 1,)` the step of these waypoints that each step of the plan belongs
            to; `(W, J)` scaled configurations; W times whether it is on a bent step, where the
            agent only expects to touch.
        """
        x = np.concatenate([_chosen(*stretch) for stretch in self._stretches])
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
        return nodes, np.array(of_step, dtype=int), np.array(waypoints), imagined


def _chosen(x: np.ndarray, joints: np.ndarray, layers: list[np.ndarray]) -> np.ndarray:
    """`(1 + layers, J)` configurations of a stretch, from `(J,)` x on."""
    chosen = np.repeat(x[None], 1 + len(layers), axis=0)
    if layers:
        chosen[1:, joints] = smoothest_configurations([x[joints][None], *layers])[1:]
    return chosen


def smoothest_configurations(layers: Sequence[np.ndarray]) -> np.ndarray:
    """`(W, J)` rad, one configuration of each layer, with the least sum of cubed steps.

    Layered dynamic programming: exact up to float32 rounding, and quadratic in the size of a layer.
    With squares instead of cubes, a long step would remain now and then, and lose contact. Layers
    are `(n_w, J)` rad, scaled candidates along the route; a layer of one candidate is fixed.
    """
    candidates = [np.ascontiguousarray(layer, dtype=np.float32) for layer in layers]
    least_costs = _least_costs(candidates[0].shape[1])
    costs = [np.zeros(len(candidates[0]), dtype=np.float32)]
    for before, here in pairwise(candidates):
        costs.append(np.empty(len(here), dtype=np.float32))
        least_costs(before, costs[-2], np.ascontiguousarray(here.T), costs[-1])
    choice = [int(costs[-1].argmin())]
    for number in range(len(layers) - 1, 0, -1):
        x = candidates[number][choice[-1]]
        choice.append(int(_came_from(candidates[number - 1], costs[number - 1], x)))
    return np.stack([layer[c] for layer, c in zip(layers, reversed(choice), strict=True)])


@lru_cache
def _least_costs(num_joints: int) -> Callable[..., None]:
    """Compiles a step of the search; a fixed number of joints keeps all sums in registers."""

    def least_costs(before, cost_before, here, cost):
        """Writes the least cost to reach each of the `(J, n)` configurations here.

        Those are in the vector lanes, and four of the `(m, J)` before are compared at a time.
        """
        cost[:] = np.inf
        last = len(before) - 1
        for b0 in range(0, last + 1, 4):
            # A short tail repeats its last row, which changes no minimum.
            b1, b2, b3 = min(b0 + 1, last), min(b0 + 2, last), min(b0 + 3, last)
            x0, x1, x2, x3 = before[b0], before[b1], before[b2], before[b3]
            c0, c1, c2, c3 = cost_before[b0], cost_before[b1], cost_before[b2], cost_before[b3]
            for i in range(here.shape[1]):
                s0 = s1 = s2 = s3 = np.float32(0)
                for j in range(num_joints):
                    x = here[j, i]
                    d0, d1, d2, d3 = x - x0[j], x - x1[j], x - x2[j], x - x3[j]
                    s0 += d0 * d0
                    s1 += d1 * d1
                    s2 += d2 * d2
                    s3 += d3 * d3
                t0, t1 = s0 * np.sqrt(s0) + c0, s1 * np.sqrt(s1) + c1
                t2, t3 = s2 * np.sqrt(s2) + c2, s3 * np.sqrt(s3) + c3
                t0, t2 = t0 if t0 < t1 else t1, t2 if t2 < t3 else t3
                least = t0 if t0 < t2 else t2
                cost[i] = least if least < cost[i] else cost[i]

    # Each variant has cache files of its own, as in `set_distances`.
    least_costs.__qualname__ += f"_{num_joints}"
    return numba.njit(cache=True, error_model="numpy")(least_costs)


@njit(cache=True)
def _came_from(before, cost_before, x):
    """The previous configuration, of `(m, J)`, from which x is reached at least cost."""
    best, least = 0, np.float32(np.inf)
    for row in range(len(before)):
        square = square_step(x, before[row])
        cost = square * np.sqrt(square) + cost_before[row]
        if cost < least:
            best, least = row, cost
    return best
