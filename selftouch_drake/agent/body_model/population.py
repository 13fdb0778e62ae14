"""Many hypotheses of a body at once: the criterion, its gradient by hand, and Adam, compiled.

A member of a population has twists, points of its touchers, and its own way from each group of
touches to what touched: so orders of joints compete. A *group* is a set of kernels that one toucher
touched on one part.

At each step the point of a toucher is carried along its way, to the places of all touches that
were drawn (`tiles.py`); the criterion judges the places (`scatter.py`); its slopes are carried back
along the way, and say how twists and points change.
"""

import math
from typing import NamedTuple

import numpy as np

from selftouch_drake.agent.body_model.scatter import (
    Scratch,
    criterion_of_kernels,
    criterion_of_sensations,
)
from selftouch_drake.agent.body_model.tiles import KEPT, TILE, F, U, carried_back, moved_by_joint
from selftouch_drake.compiled import compiled, inner

# Adam's usual constants.
_BETA1, _BETA2, _TINY = 0.9, 0.999, 1e-9
_T = U(TILE)


class Ways(NamedTuple):
    """Ways of all members, from the link of each group's part to that of its toucher.

    Attributes:
        joint: `(B, G, L)` joints on the way, padded.
        sign: `(B, G, L)` float32, -1 where the way passes a joint backwards.
        length: `(B, G)` number of joints on the way.
        toucher: `(G,)` index of the group's toucher.
    """

    joint: np.ndarray
    sign: np.ndarray
    length: np.ndarray
    toucher: np.ndarray


class Draws(NamedTuple):
    """Touches that each step looks at.

    Attributes:
        q: `(J, R)` float32 readings of all touches.
        rows: `(steps, G, N)` int32; kernel after kernel, each with the same number of members, then
            padding up to a multiple of `TILE`.
        num_kernels: `(G,)` kernels drawn from each group.
        members: `()` drawn from each kernel.
        weight: `(G,)` of each group in the sum of criteria.
        precision: `(N0 N0 + N1 N1 + ...,)` the matrix of each group, one after the other: of places
            that are a smooth function of sensations, with the mean taken out. It takes the place of
            kernels; `(0,)` for kernels.
        fixed: `(F,)` joints whose twists stay as they are; where there are any, points do too.
        alike: `(J,)` how far the readings turn joints, all alike but for one factor, and none of
            them slides along its axis; 0 for joints that turn as far as they may. `(0,)`: each
            twist is free.
    """

    q: np.ndarray
    rows: np.ndarray
    num_kernels: np.ndarray
    members: np.integer
    weight: np.ndarray
    precision: np.ndarray
    fixed: np.ndarray = np.zeros(0, dtype=np.int64)
    alike: np.ndarray = np.zeros(0)


class _Room(NamedTuple):
    """The one array of a descent, and where its parts begin.

    Attributes:
        values: float32; first the tiles of one group and member, at every joint of its way.
        per_tile: entries of a tile at all joints.
        readings: where the `(G, J, N)` readings of a step begin.
        slopes: where the slopes of one tile begin.
    """

    values: np.ndarray
    per_tile: np.integer
    readings: np.integer
    slopes: np.integer


class _Way(NamedTuple):
    """The way of one group and member.

    Attributes:
        joint: `(L,)` its joints.
        sign: `(L,)` float32.
        readings: where the `(J, N)` readings of the group begin in the room.
        num_rows: N.
    """

    joint: np.ndarray
    sign: np.ndarray
    readings: np.integer
    num_rows: int


@inner
def _read(room, q, rows):
    """Writes the readings `(G, J, N)` of one step's `(G, N)` rows into the room."""
    num_groups, num_rows = rows.shape
    for group in range(num_groups):
        for joint in range(len(q)):
            begin = room.readings + U((group * len(q) + joint) * num_rows)
            for i in range(num_rows):
                room.values[begin + U(i)] = q[joint, rows[group, i]]


@inner
def _place(room, way, point, twists, x):
    """Writes the `(3, N)` places to which the joints on a way carry the point of a toucher."""
    values, length = room.values, len(way.joint)
    for tile in range(way.num_rows // TILE):
        first = U(tile) * room.per_tile
        tip = first + U(length) * KEPT
        for axis in range(3):
            p = F(point[axis])
            for i in range(_T):
                values[tip + U(axis * TILE) + i] = p
        # From the joint at the toucher to that at the part.
        for k in range(length - 1, -1, -1):
            joint = way.joint[k]
            at, out = first + U(k + 1) * KEPT, first + U(k) * KEPT
            read = way.readings + U(joint * way.num_rows + tile * TILE)
            moved_by_joint(values, at, out, read, F(way.sign[k]), twists[joint])
        for axis in range(3):
            for i in range(_T):
                x[axis, tile * TILE + i] = values[first + U(axis * TILE) + i]


@inner
def _carry_back(room, way, slopes, used, twists, by_twist, by_point):
    """Adds to the slopes by twists `(J, 6)` and point `(3,)`, from those by the places used."""
    values = room.values
    for tile in range((used + TILE - 1) // TILE):
        first = U(tile) * room.per_tile
        for axis in range(3):
            for i in range(_T):
                values[room.slopes + U(axis * TILE) + i] = F(slopes[axis, tile * TILE + i])
        for k in range(len(way.joint)):
            joint = way.joint[k]
            at, out = first + U(k + 1) * KEPT, first + U(k) * KEPT
            read = way.readings + U(joint * way.num_rows + tile * TILE)
            sign = F(way.sign[k])
            carried_back(values, room.slopes, at, out, read, sign, twists[joint], by_twist[joint])
        for axis in range(3):
            total = F(0)
            for i in range(_T):
                total += values[room.slopes + U(axis * TILE) + i]
            by_point[axis] += total


@inner
def _adam(value, slope, moments, rate, step):
    """One step of Adam on flat arrays; `(2, n)` moments are mean and square of the slopes."""
    mean, square = moments[0], moments[1]
    c1, c2 = 1 - _BETA1 ** (step + 1), 1 - _BETA2 ** (step + 1)
    for i in range(len(value)):
        mean[i] = _BETA1 * mean[i] + (1 - _BETA1) * slope[i]
        square[i] = _BETA2 * square[i] + (1 - _BETA2) * slope[i] * slope[i]
        value[i] -= rate * (mean[i] / c1) / (math.sqrt(square[i] / c2) + _TINY)


@inner
def _dot(a, b):
    """Of two vectors in space."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _on_ways(ways, member, num_joints):
    """The joints that a member has on any of its ways."""
    on_way = np.zeros(num_joints, dtype=np.bool_)
    for group in range(ways.joint.shape[1]):
        on_way[ways.joint[member, group, : ways.length[member, group]]] = True
    return np.flatnonzero(on_way)


@inner
def _hold(twists, joints, alike):
    """Takes the pitch out of `(J, 6)` twists, and lets joints turn alike."""
    total, number = 0.0, 0
    for joint in joints:
        w, v = twists[joint, :3], twists[joint, 3:]
        square = _dot(w, w) + _TINY
        pitch = _dot(w, v) / square
        for axis in range(3):
            v[axis] -= pitch * w[axis]
        if alike[joint] > 0:
            total += 0.5 * math.log(square) - math.log(alike[joint])
            number += 1
    for joint in joints:
        if alike[joint] > 0:
            w = twists[joint, :3]
            farther = math.exp(total / number) * alike[joint] / math.sqrt(_dot(w, w) + _TINY)
            for axis in range(3):
                w[axis] *= farther


@inner
def _hold_slopes(by_twist, twists, joints, alike):
    """Leaves of the `(J, 6)` slopes what twists that are held may follow."""
    total, number = 0.0, 0
    for joint in joints:
        w, v, by_w, by_v = (
            twists[joint, :3], twists[joint, 3:], by_twist[joint, :3], by_twist[joint, 3:]
        )  # fmt: skip
        square = _dot(w, w) + _TINY
        if alike[joint] > 0:
            total += _dot(by_w, w)
            number += 1
        # A turn of the axis takes the pitch out of v.
        along = _dot(by_v, w) / square
        for axis in range(3):
            by_v[axis] -= along * w[axis]
            by_w[axis] -= along * v[axis]
    for joint in joints:
        if alike[joint] > 0:
            w, by_w = twists[joint, :3], by_twist[joint, :3]
            square = _dot(w, w) + _TINY
            farther = (total / number - _dot(by_w, w)) / square
            for axis in range(3):
                by_w[axis] += farther * w[axis]


@compiled
def descend(draws, ways, twists, points, rate, tail):
    """Adam with cosine decay, each member for itself, all on the same draws.

    Args:
        draws: `Draws`.
        ways: `Ways` of the B members.
        twists: `(B, J, 6)` changed in place.
        points: `(B, U, 3)` of the touchers, changed in place.
        rate: `()` of the first step; 0 only evaluates.
        tail: `()` degrees of freedom of the Student distribution; 0 for a Gaussian one.

    Returns:
        `(B, G)` criterion of each group, averaged over the last steps.
    """
    steps, num_groups, num_rows = draws.rows.shape
    num_members, num_joints = twists.shape[0], twists.shape[1]
    per_tile = U(ways.joint.shape[2] + 1) * KEPT
    at_readings = U(num_rows // TILE) * per_tile
    at_slopes = at_readings + U(num_groups * num_joints * num_rows)
    room = _Room(np.zeros(at_slopes + U(3 * TILE), F), per_tile, at_readings, at_slopes)
    x, slopes = np.zeros((3, num_rows)), np.zeros((3, num_rows))
    scratch = Scratch(np.zeros(num_rows), np.zeros((num_rows, 3)), np.zeros((4, 3, 3)))
    within = np.zeros((num_members, num_groups, 3, 3))
    history = np.zeros((num_members, num_groups))
    by_twist, by_point = np.zeros((num_joints, 6)), np.zeros((points.shape[1], 3))
    moments = np.zeros((num_members, 2, by_twist.size))
    point_moments = np.zeros((num_members, 2, by_point.size))
    for step in range(steps):
        now = rate * 0.5 * (1 + math.cos(math.pi * step / steps))
        _read(room, draws.q, draws.rows[step])
        for b in range(num_members):
            if len(draws.alike) > 0:
                _hold(twists[b], _on_ways(ways, b, num_joints), draws.alike)
            by_twist[:] = 0
            by_point[:] = 0
            first = 0
            for group in range(num_groups):
                length, toucher = ways.length[b, group], ways.toucher[group]
                way = _Way(
                    ways.joint[b, group, :length],
                    ways.sign[b, group, :length],
                    room.readings + U(group * num_joints * num_rows),
                    num_rows,
                )
                _place(room, way, points[b, toucher], twists[b], x)
                used = draws.num_kernels[group] * draws.members
                if len(draws.precision) > 0:
                    precision = draws.precision[first : first + used * used].reshape(used, used)
                    first += used * used
                    value = criterion_of_sensations(
                        x, slopes, precision, draws.weight[group], scratch
                    )
                else:
                    sizes = draws.num_kernels[group], draws.members
                    value = criterion_of_kernels(
                        x, slopes, within[b, group], sizes, tail, draws.weight[group], scratch
                    )
                share = max(0.05, 1.0 / (step + 1))
                history[b, group] += share * (value - history[b, group])
                if rate > 0:
                    slopes[:, used:] = 0
                    _carry_back(room, way, slopes, used, twists[b], by_twist, by_point[toucher])
            if len(draws.fixed) > 0:
                by_twist[draws.fixed] = 0
                by_point[:] = 0
            if len(draws.alike) > 0:
                _hold_slopes(by_twist, twists[b], _on_ways(ways, b, num_joints), draws.alike)
            if rate > 0:
                _adam(twists[b].ravel(), by_twist.ravel(), moments[b], now, step)
                _adam(points[b].ravel(), by_point.ravel(), point_moments[b], now, step)
    return history
