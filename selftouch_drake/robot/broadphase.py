"""Finds pairs of toucher and skin that cannot touch, so that their contact need not be computed.

Conservative: a toucher whose ball is out of a skin's box cannot touch it.

Most configurations of a random walk touch nothing. For those it is enough to place the touchers and
to see that they are outside the skins' boxes. The innermost loops run over `_LANES` configurations
at a time, for the processor's vector instructions.
"""

import numpy as np

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.touchers import triangles_in_frame

# Configurations at a time.
_LANES = 32
# m, upper bound of the rounding error of positions in `_move`.
_ROUNDING = 1e-6


class BroadPhase:
    """Finds the pairs of one robot that may touch.

    Each toucher has a ball around it, and each skin a box, in the frames of the joints that move
    them.
    """

    def __init__(self, robot: Robot):
        self._tree = tree = robot.kinematics
        self._pairs = np.array(robot.touching_pairs, dtype=np.int64).reshape(-1, 2)
        walls = {skin.geometry_id: skin.model.wall.tet_vertices for skin in robot.skins}
        inspector = robot.scene_graph.model_inspector()
        shapes = list(walls.values())
        for toucher in robot.touchers:
            worn = [walls[geometry] for geometry in toucher.geometry_ids if geometry in walls]
            shapes.append(np.concatenate(worn or [triangles_in_frame(toucher, inspector)[0]]))
        # In the frames of the joints that move them.
        shapes = [
            p_LQ @ X_JL[:, :3].T + X_JL[:, 3] for X_JL, p_LQ in zip(tree.X_JL, shapes, strict=True)
        ]
        bounds = np.array([np.append(p.min(axis=0), p.max(axis=0)) for p in shapes])
        self._boxes = bounds[: len(walls)].copy()
        # Centre and radius of a ball that holds all points of a toucher.
        self._balls = np.empty((len(robot.touchers), 4))
        self._balls[:, :3] = (bounds[len(walls) :, :3] + bounds[len(walls) :, 3:]) / 2
        for ball, points in zip(self._balls, shapes[len(walls) :], strict=True):
            ball[3] = np.linalg.norm(points - ball[:3], axis=1).max() + _ROUNDING

    def near(self, q: np.ndarray) -> np.ndarray:
        """`(N, P)` bool, which of the touching pairs might touch at `q` `(N, J)`."""
        lanes = np.zeros((q.shape[1], -(-len(q) // _LANES) * _LANES))
        lanes[:, : len(q)] = q.T
        found = np.zeros((lanes.shape[1], len(self._pairs)), dtype=np.bool_)
        _near(
            lanes, self._tree.parent, self._tree.X_PF, self._tree.turns, self._tree.owner,
            self._pairs, self._balls, self._boxes, found,
        )  # fmt: skip
        return found[: len(q)]


@compiled
def _near(lanes, parent, X_PF, turns, owner, pairs, balls, boxes, found):
    # The world, then what each joint carries: 12 numbers of `_LANES` configurations each.
    X = np.zeros((len(parent) + 1) * 12 * _LANES)
    for i in range(3):
        for lane in range(_LANES):
            X[5 * i * _LANES + lane] = 1.0
    sine, cosine, shift = np.empty(_LANES), np.empty(_LANES), np.empty(_LANES)
    apart, num_skins = np.empty(_LANES), len(boxes)
    for start in range(0, lanes.shape[1], _LANES):
        for joint in range(len(parent)):
            _move(lanes[joint, start : start + _LANES], turns[joint], sine, cosine, shift)
            _carry(X, parent[joint], joint, X_PF, sine, cosine, shift)
        for pair in range(len(pairs)):
            toucher, skin = pairs[pair, 0], pairs[pair, 1]
            carrier, pressed = owner[num_skins + toucher], owner[skin]
            _apart(X, carrier, pressed, balls, toucher, boxes, skin, apart)
            for lane in range(_LANES):
                found[start + lane, pair] = apart[lane] <= balls[toucher, 3] ** 2


@inner
def _move(q, turns, sine, cosine, shift):
    """Sine and cosine of an angle, good to 1e-10, or the shift of a joint that slides."""
    for lane in range(_LANES):
        # Within half a turn, and of that a quarter, for which few terms do; then doubled twice.
        # Adding and taking away this number rounds to an integer.
        turn = (q[lane] * (0.5 / np.pi) + 6755399441055744.0) - 6755399441055744.0
        x = 0.25 * q[lane] - 0.5 * np.pi * turn
        z = x * x
        s = 1 - z * (1 / 20) * (1 - z * (1 / 42) * (1 - z * (1 / 72) * (1 - z * (1 / 110))))
        s = x * (1 - z * (1 / 6) * s)
        s, c = 2 * s * np.sqrt(1 - s * s), 1 - 2 * s * s
        sine[lane] = 2 * s * c if turns else 0.0
        cosine[lane] = 1 - 2 * s * s if turns else 1.0
        shift[lane] = 0.0 if turns else q[lane]


@inner
def _carry(X, parent, joint, X_PF, sine, cosine, shift):
    """Places what a joint carries.

    Indices are unsigned: with signed ones the compiler makes no vector instructions.
    """
    lanes = np.uint64(_LANES)
    two, three = lanes + lanes, lanes + lanes + lanes
    for i in range(3):
        before = np.uint64(((parent + 1) * 12 + 4 * i) * _LANES)
        after = np.uint64(((joint + 1) * 12 + 4 * i) * _LANES)
        x0, x1, x2 = X_PF[joint, 0, 0], X_PF[joint, 1, 0], X_PF[joint, 2, 0]
        y0, y1, y2 = X_PF[joint, 0, 1], X_PF[joint, 1, 1], X_PF[joint, 2, 1]
        z0, z1, z2 = X_PF[joint, 0, 2], X_PF[joint, 1, 2], X_PF[joint, 2, 2]
        p0, p1, p2 = X_PF[joint, 0, 3], X_PF[joint, 1, 3], X_PF[joint, 2, 3]
        for lane in range(lanes):
            a, b = X[before + lane], X[before + lanes + lane]
            c, d = X[before + two + lane], X[before + three + lane]
            x, y, z = a * x0 + b * x1 + c * x2, a * y0 + b * y1 + c * y2, a * z0 + b * z1 + c * z2
            X[after + lane] = x * cosine[lane] + y * sine[lane]
            X[after + lanes + lane] = y * cosine[lane] - x * sine[lane]
            X[after + two + lane] = z
            X[after + three + lane] = a * p0 + b * p1 + c * p2 + d + z * shift[lane]


@inner
def _apart(X, carrier, pressed, balls, ball, boxes, skin, apart):
    """Writes the squared distance from the centre of a ball to the box of a skin, m²."""
    lanes = np.uint64(_LANES)
    x, y, z = balls[ball, 0], balls[ball, 1], balls[ball, 2]
    for i in range(3):
        low, high = boxes[skin, i], boxes[skin, 3 + i]
        for lane in range(lanes):
            along = 0.0
            for k in range(3):
                c = np.uint64(((carrier + 1) * 12 + 4 * k) * _LANES) + lane
                s = np.uint64(((pressed + 1) * 12 + 4 * k) * _LANES) + lane
                away = X[c] * x + X[c + lanes] * y + X[c + lanes + lanes] * z
                away += X[c + lanes + lanes + lanes] - X[s + lanes + lanes + lanes]
                along += X[s + np.uint64(i) * lanes] * away
            beyond = max(max(low - along, along - high), 0.0)
            apart[lane] = beyond * beyond + (apart[lane] if i else 0.0)
