"""How one toucher moves over one part of the skin, as a body model has it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from selftouch_drake.agent.body_model.chain import slope
from selftouch_drake.agent.body_model.model import UNUSED, BodyModel
from selftouch_drake.agent.body_model.support import SHAPE_BASIS
from selftouch_drake.compiled import compiled, inner

# Share of the joints' squared reach by which steps that put a posture onto a place are damped, and
# the longest step, mu; after a step shorter than the last, the posture has arrived.
_DAMPED, _LONGEST, _ARRIVED = 1e-3, 0.6, 1e-4


# No slots: what its shape makes is computed once.
@dataclass(frozen=True, kw_only=True, eq=False)
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
        own = np.ascontiguousarray(q[:, self.joints], dtype=float)
        place, by_q = np.empty((len(q), 3)), np.empty((len(q), 3, len(self.joints)))
        _places(own, self.twists, self.signs, self.point, self._bulge, normal, place, by_q)
        return place, by_q

    def put(
        self,
        q: np.ndarray,
        place: np.ndarray,
        normal: np.ndarray,
        limits: tuple[np.ndarray, np.ndarray],
        *,
        scale: np.ndarray,
        steps: int,
    ) -> np.ndarray:
        """`(n, J)` postures near others with the toucher at places, if it gets there.

        Each goes the shortest way by steps of damped least squares, and stays within limits.

        Args:
            q: `(n, J)` readings of all joints.
            place: `(n, 3)` where the centre of the ball shall be.
            normal: `(n, 3)` as in `places`.
            limits: `(J,)` lowest and highest readings.
            scale: `(J,)` mu per unit of each reading: ways are short in mu.
            steps: that are made at most.
        """
        return self._moved(put_onto, q, place, normal, limits, scale, steps)

    def follow(
        self,
        q_start: np.ndarray,
        place: np.ndarray,
        normal: np.ndarray,
        limits: tuple[np.ndarray, np.ndarray],
        *,
        scale: np.ndarray,
        steps: int,
    ) -> np.ndarray:
        """`(n, J)` postures with the toucher at places, each put there from the one before it.

        Args:
            q_start: `(J,)` readings of all joints, from which the first is put.
            place: as of `put`.
            normal: likewise.
            limits: likewise.
            scale: likewise.
            steps: likewise.
        """
        q = np.repeat(q_start[None], len(place), axis=0)
        return self._moved(follow_onto, q, place, normal, limits, scale, steps)

    def _moved(self, move, q, place, normal, limits, scale, steps) -> np.ndarray:
        """Postures that a compiled function moves."""
        q, joints = q.copy(), self.joints
        own = np.ascontiguousarray(q[:, joints] * scale[joints], dtype=float)
        lower, upper = (limit[joints] * scale[joints] for limit in limits)
        twists = self.twists / scale[joints, None]
        move(own, twists, self.signs, self.point, self._bulge, place, normal, lower, upper, steps)
        q[:, joints] = own / scale[joints]
        return q

    @cached_property
    def _bulge(self) -> np.ndarray:
        """`(3, 3)` of the toucher's shape, as in `support.bulge`."""
        return np.tensordot(self.shape, SHAPE_BASIS, axes=1)


@inner
def _place(q, twists, signs, point, bulge, normal, work, place, by_q, turn):
    """Fills in a row of `Reach.places`; `work` is room."""
    points, known, tip = work
    slope(q, twists, signs, point, points, known, place, by_q, turn)
    if not bulge.any():
        return
    # Where it touches depends on how it is turned.
    along, height = np.zeros(3), 0.0
    for axis in range(3):
        for row in range(3):
            for other in range(3):
                along[axis] -= bulge[axis, other] * turn[row, other] * normal[row]
    for axis in range(3):
        for row in range(3):
            height -= along[axis] * turn[row, axis] * normal[row]
    for axis in range(3):
        away = 0.0
        for row in range(3):
            away -= turn[row, axis] * normal[row]
        tip[axis] = point[axis] + 2.0 * along[axis] - height * away
    slope(q, twists, signs, tip, points, known, place, by_q, turn)


@compiled
def _places(q, twists, signs, point, bulge, normal, place, by_q):
    turn, length = np.empty((3, 3)), len(twists)
    work = (np.empty((length + 1, 3)), np.empty((length, 4)), np.empty(3))
    for i in range(len(q)):
        _place(q[i], twists, signs, point, bulge, normal[i], work, place[i], by_q[i], turn)


@compiled
def put_onto(x, twists, signs, point, bulge, goal, normal, lower, upper, steps):
    """Moves scaled postures `(n, L)` x as `Reach.put` says.

    Args:
        x: moved in place.
        twists: `(L, 6)` of the scaled joints.
        signs: `(L,)` 1, or -1 for joints that the way passes backwards.
        point: `(3,)` the toucher's centre.
        bulge: `(3, 3)` of its shape; zeros for a point or a ball.
        goal: `(n, 3)` where it shall be.
        normal: `(n, 3)` outward normals of the skin there.
        lower: `(L,)` limits of x.
        upper: `(L,)` likewise.
        steps: that are made at most.
    """
    work = _room(len(twists))
    for i in range(len(x)):
        _put(x[i], twists, signs, point, bulge, goal[i], normal[i], lower, upper, steps, work)


@compiled
def follow_onto(x, twists, signs, point, bulge, goal, normal, lower, upper, steps):
    """As `put_onto`, but each row is put from where the one before it ends; x gives the first."""
    work = _room(len(twists))
    for i in range(len(x)):
        if i > 0:
            x[i] = x[i - 1]
        _put(x[i], twists, signs, point, bulge, goal[i], normal[i], lower, upper, steps, work)


@inner
def _room(length):
    """Room for `_put` with so many joints."""
    slopes = (np.empty((length + 1, 3)), np.empty((length, 4)), np.empty(3))
    at = (np.empty((3, 3)), np.empty(3), np.empty((3, length)))
    return slopes, at, np.empty((3, 3)), np.empty(length)


@inner
def _put(x, twists, signs, point, bulge, goal, normal, lower, upper, steps, work):
    """Moves one posture `(L,)` as `put_onto` does."""
    slopes, (turn, place, by_x), square, move = work
    length = len(twists)
    for _ in range(steps):
        _place(x, twists, signs, point, bulge, normal, slopes, place, by_x, turn)
        for row in range(3):
            for column in range(3):
                square[row, column] = 0.0
                for joint in range(length):
                    square[row, column] += by_x[row, joint] * by_x[column, joint]
        damping = _DAMPED * (square[0, 0] + square[1, 1] + square[2, 2])
        for axis in range(3):
            square[axis, axis] += damping
        a, b, c = _solved(square, goal[0] - place[0], goal[1] - place[1], goal[2] - place[2])
        size = 0.0
        for joint in range(length):
            move[joint] = by_x[0, joint] * a + by_x[1, joint] * b + by_x[2, joint] * c
            size += move[joint] * move[joint]
        shorter = min(1.0, _LONGEST / max(math.sqrt(size), 1e-12))
        for joint in range(length):
            moved = x[joint] + shorter * move[joint]
            x[joint] = min(max(moved, lower[joint]), upper[joint])
        if size < _ARRIVED * _ARRIVED:
            break


@inner
def _solved(A, x, y, z):
    """The solution of three linear equations, by Cramer's rule; 0 if there is none."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c1 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c2 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    size = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    if size == 0.0:
        return 0.0, 0.0, 0.0
    d0 = A[0, 2] * A[2, 1] - A[0, 1] * A[2, 2]
    d1 = A[0, 0] * A[2, 2] - A[0, 2] * A[2, 0]
    d2 = A[0, 1] * A[2, 0] - A[0, 0] * A[2, 1]
    e0 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    e1 = A[0, 2] * A[1, 0] - A[0, 0] * A[1, 2]
    e2 = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    return (
        (c0 * x + d0 * y + e0 * z) / size,
        (c1 * x + d1 * y + e1 * z) / size,
        (c2 * x + d2 * y + e2 * z) / size,
    )
