"""Sliding: from one touch to another without losing contact, by feel (naive).

The straight way between two touching configurations may leave the skin. The agent does not know how
to bend it. But at any touch it can try small movements and notice which ones change how strong the
touch is; along all others it slides. So it moves as straight as it can, and presses more or
less when the touch is weaker or stronger than wanted.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.agent.body import Body, Felt

#: mu, length of a step, and of a trial to either side. Measured on 51 ways of 2 mu between
#: touches of a forearm with nine joints that matter: 86 % succeed by sliding, 12 % if straight.
_STEP = 0.06
_TRIAL = 0.01

#: It gives up after this multiple of the steps of the straight way, or after the second number.
_MOST_DETOUR, _LEAST_GOES = 4, 30

#: The wanted strength of the touch is interpolated between both ends, but at least this share of
#: the stronger one. The real strength may differ from it by these factors.
_FIRM = 0.6
_LEAST_FELT, _MOST_FELT = 0.3, 3.0

# It gives up if less than this share of the remaining way is along the skin.
_ACROSS = 1e-3

#: A body that travels follows a path at this share of its velocity limits, to feel along it. It was
#: there if each joint was within this share of its range.
_SLOWLY, _NEAR = 0.25, 0.03
#: Steps within which it gets up speed.
_BEGINNING = 8

# Straight ways that are checked for a detour before it gives up; a body that travels goes them.
_MOST_CHECKS, _MOST_TRAVELLED = 300, 20

# Halvings of a step that loses contact, and corrections of each, before it gives up.
_MOST_HALVINGS, _CORRECTIONS = 5, 4


@dataclass(frozen=True, slots=True, eq=False)
class Slider:
    """Slides by feel; all its configurations are scaled, in mu.

    Attributes:
        body: where it feels.
        joint_scale: `(J,)` factors of the agent's representation.
    """

    body: Body
    joint_scale: np.ndarray

    def feel(self, x: np.ndarray) -> Felt:
        """What the body feels at `(n, J)` configurations, and whether it can be there."""
        return self.body.feel(x / self.joint_scale)

    def feel_along(self, x: np.ndarray) -> Felt:
        """As `feel`, for `(n, J)` configurations that lie close together on a path.

        A body that travels follows the path in one slow motion, and visits by themselves only those
        that it then did not come near to.
        """
        body, q = self.body, x / self.joint_scale
        if body.jumps or len(x) < 2:
            return self.feel(x)
        needs = (np.abs(np.diff(q, axis=0)) / (_SLOWLY * body.velocity)).max(axis=1)
        needs /= ((1 + np.arange(len(needs))) / _BEGINNING).clip(max=1.0)
        time_s = np.append(0.0, needs.clip(1e-3).cumsum())
        followed = body.follow(time_s, q)
        rows = np.arange(len(followed.time_s))
        along = followed.felt().of_rows(
            np.rint(np.interp(time_s, followed.time_s, rows)).astype(int)
        )
        near = (np.abs(along.q - q) <= _NEAR * (body.upper - body.lower)).all(axis=1)
        if not near.all():
            visited = self.feel(x[~near])
            for name in ("q", "sensation", "reached"):
                getattr(along, name)[~near] = getattr(visited, name)
        return along

    def slide(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Slides from one touching configuration `(J,)` to another; joints that differ move.

        Returns `(M, J)` mu, touching configurations in between, about 0.06 mu apart, and `(M, S)`
        N, the sensations there; None if it did not arrive.
        """
        joints = np.flatnonzero(x_from != x_to)
        at_ends = self.feel(np.stack([x_from, x_to]))
        felt = at_ends.sensation[0]
        start, end = _strength(at_ends.sensation)
        if not (start > 0 and end > 0 and at_ends.reached[1]):
            return None
        whole = float(np.linalg.norm(x_to - x_from))
        x, passed = x_from, list[tuple[np.ndarray, np.ndarray]]()
        for _ in range(max(round(_MOST_DETOUR * whole / _STEP), _LEAST_GOES)):
            rest = float(np.linalg.norm(x_to - x))
            if rest < 1.5 * _STEP:
                xs = np.array([x for x, _ in passed]).reshape(-1, len(x))
                return xs, np.array([f for _, f in passed]).reshape(-1, len(felt))
            wanted = end + (start - end) * min(rest / whole, 1.0)
            found = self._go(x, x_to, felt, max(wanted, _FIRM * max(start, end)), joints)
            if found is None:
                return None
            x, felt = found
            passed.append(found)
        return None

    def detour(self, x_from: np.ndarray, x_to: np.ndarray, over: np.ndarray) -> np.ndarray | None:
        """Finds a way through the air, via some configurations, that the robot can take everywhere.

        It checks the shortest way, removes the parts that are impossible, and repeats (lazy
        probabilistic roadmap, Bohlin and Kavraki 2000). From `(J,)` to `(J,)`, it may pass `over`
        `(n, J)`. Returns the `(m, J)` that it passes, at least one; None if no way was found.
        """
        x = np.concatenate([x_from[None], over, x_to[None]])
        length = np.linalg.norm(x[:, None] - x, axis=2)
        goal = len(x) - 1
        length[0, goal] = length[goal, 0] = 0.0  # no edge: the straight way is not a detour
        graph, checked = csr_array(length), np.zeros(length.shape, dtype=bool)
        for _ in range(_MOST_CHECKS if self.body.jumps else _MOST_TRAVELLED):
            total, before = dijkstra(graph, indices=0, return_predecessors=True)
            if not np.isfinite(total[goal]):
                return None
            way = [goal]
            while way[-1] != 0:
                way.append(int(before[way[-1]]))
            unsure = [(i, j) for i, j in pairwise(way[::-1]) if not checked[i, j]]
            if not unsure:
                return x[way[-2:0:-1]]
            i, j = unsure[0]
            checked[i, j] = checked[j, i] = True
            if not self.feel_along(straight(x[i], x[j])).reached.all():
                graph[i, j] = graph[j, i] = np.inf
        return None

    def slope(self, x: np.ndarray, joints: np.ndarray | None = None) -> np.ndarray:
        """`(J,)` N per mu, how fast the strength of the touch grows at `(J,)` x along each joint.

        Joints that are not in `joints` get 0; by default all are tried.
        """
        joints = np.arange(len(x)) if joints is None else joints
        trials = np.zeros((len(joints), len(x)))
        trials[np.arange(len(joints)), joints] = _TRIAL
        tried = self.within(np.stack([x + trials, x - trials]))
        slope = np.zeros(len(x))
        if self.body.jumps:
            more, less = _strength(self.feel(tried.reshape(-1, len(x))).sensation).reshape(2, -1)
            apart = np.linalg.norm(tried[0] - tried[1], axis=1)
            slope[joints] = np.divide(more - less, apart, out=apart * 0.0, where=apart > 0)
        else:
            # One slow motion through all trials: to stop at each takes ten times as long.
            felt = self.feel_along(tried.swapaxes(0, 1).reshape(-1, len(x)))
            off = (felt.q * self.joint_scale - x)[:, joints]
            fit = np.linalg.lstsq(
                np.column_stack([off, np.ones(len(off))]), _strength(felt.sensation)
            )
            slope[joints] = fit[0][:-1]
        return slope

    def within(self, x: np.ndarray) -> np.ndarray:
        """`(..., J)` the nearest positions within the limits of the joints."""
        return x.clip(self.body.lower * self.joint_scale, self.body.upper * self.joint_scale)

    def _go(
        self, x: np.ndarray, x_to: np.ndarray, felt: np.ndarray, wanted: float, joints: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The next configuration and the sensation there; None if it gives up."""
        slope = self.slope(x, joints)
        steepness = float(np.linalg.norm(slope))
        if not steepness > 0:
            return None
        up = slope / steepness
        along = (x_to - x) - up * (up @ (x_to - x))
        length = float(np.linalg.norm(along))
        if length < _ACROSS * np.linalg.norm(x_to - x):
            return None
        step = min(_STEP, length)
        for _ in range(_MOST_HALVINGS + 1):
            press = np.clip((wanted - _strength(felt)) / steepness, -0.5 * step, 0.5 * step)
            there = self.within(x + step / length * along + press * up)
            for _ in range(_CORRECTIONS):
                # A body that travels feels in motion.
                now = self.feel_along(there[None] if self.body.jumps else np.stack([x, there]))
                share = float(_strength(now.sensation[-1])) / wanted
                if _LEAST_FELT < share < _MOST_FELT:
                    if now.reached[-1]:
                        return there, now.sensation[-1]
                    break
                correction = np.clip((1.0 - share) * wanted / steepness, -step, step)
                there = self.within(there + correction * up)
            step /= 2
        return None


def straight(x_from: np.ndarray, x_to: np.ndarray) -> np.ndarray:
    """`(n, J)` mu, scaled configurations on the straight way, about 0.06 mu apart."""
    count = 2 + int(np.linalg.norm(x_to - x_from) / _STEP)
    return x_from + np.linspace(0.0, 1.0, count)[:, None] * (x_to - x_from)


def _strength(sensation: np.ndarray) -> np.ndarray:
    return np.linalg.norm(sensation, axis=-1)
