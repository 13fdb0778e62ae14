"""Shapes that meet: balls on some links of the body, and fields of depth on others, compiled."""

from typing import NamedTuple

import numpy as np

from selftouch_drake.compiled import compiled, inner


class Meetings(NamedTuple):
    """What may run into what: M meetings of a mover, made of balls, and a solid, a field of depth.

    Links are numbered as in `BodyModel.link_poses`, of L links, the base last.

    Attributes:
        mover: `(M,)` number of the mover in each meeting.
        solid: `(M,)` number of the solid.
        mover_link: `(M,)` the link of each.
        solid_link: `(M,)` likewise.
        balls: `(b, 4)` centres and radii of the balls of all movers, in the frames of their links.
        first_ball: `(movers + 1,)` where the balls of each mover begin, and end.
        around: `(movers, 4)` centre and radius of a ball that holds all of a mover's.
        corner: `(solids, 3)` lower corner of each grid, in the frame of the solid's link.
        cell: `(solids,)` edge of a cell.
        sides: `(solids, 3)` numbers of corners.
        height: `(g,)` height above the surface at the corners of all grids, negative inside;
            infinite where nobody knows.
        clear: `(g,)` distances from the corners to the nearest one where a ball may count.
        place: `(g,)` the nearest place of the solid's surface at the same corners, by number.
        grids: `(solids,)` where the corners of each grid begin.
        limits: `(l,)` the deepest that was possible, at each place of the solid in each meeting.
        first_limit: `(M,)` where the limits of each meeting begin.
        unit: `(M,)` what depths are divided by.
    """

    mover: np.ndarray
    solid: np.ndarray
    mover_link: np.ndarray
    solid_link: np.ndarray
    balls: np.ndarray
    first_ball: np.ndarray
    around: np.ndarray
    corner: np.ndarray
    cell: np.ndarray
    sides: np.ndarray
    height: np.ndarray
    clear: np.ndarray
    place: np.ndarray
    grids: np.ndarray
    limits: np.ndarray
    first_limit: np.ndarray
    unit: np.ndarray


class _Meeting(NamedTuple):
    """One of the `Meetings`: the same fields, of its own mover and solid alone."""

    mover_link: int
    solid_link: int
    balls: np.ndarray
    around: np.ndarray
    corner: np.ndarray
    cell: float
    sides: np.ndarray
    grid: int


@inner
def _meeting(meetings, number):
    """One of the meetings."""
    mover, solid = meetings.mover[number], meetings.solid[number]
    return _Meeting(
        meetings.mover_link[number],
        meetings.solid_link[number],
        meetings.balls[meetings.first_ball[mover] : meetings.first_ball[mover + 1]],
        meetings.around[mover],
        meetings.corner[solid],
        meetings.cell[solid],
        meetings.sides[solid],
        meetings.grids[solid],
    )


@inner
def _from(mover, wearer, seen):
    """Fills in the `(3, 4)` pose of one link as another has it; both are `(4, 4)` poses."""
    for row in range(3):
        for column in range(4):
            seen[row, column] = 0.0
            for axis in range(3):
                off = wearer[axis, 3] if column == 3 else 0.0
                seen[row, column] += wearer[axis, row] * (mover[axis, column] - off)


@inner
def _at(X, x, y, z):
    """A point of a link, moved by a pose."""
    return (
        X[0, 0] * x + X[0, 1] * y + X[0, 2] * z + X[0, 3],
        X[1, 0] * x + X[1, 1] * y + X[1, 2] * z + X[1, 3],
        X[2, 0] * x + X[2, 1] * y + X[2, 2] * z + X[2, 3],
    )


@inner
def _apart(met, seen, clear):
    """Whether no ball of a mover can be near the surface of a solid.

    Args:
        met: the meeting of the two.
        seen: `(3, 4)` pose of the mover's link.
        clear: as in `Meetings`.
    """
    place = _at(seen, met.around[0], met.around[1], met.around[2])
    number, outside = 0, 0.0
    for axis in range(3):
        step = (place[axis] - met.corner[axis]) / met.cell
        inside = min(max(step, 0.0), float(met.sides[axis] - 1))
        outside = max(outside, abs(step - inside))
        number = number * met.sides[axis] + int(inside + 0.5)
    # The nearest corner is at most 0.87 cells away.
    return max(outside * met.cell, clear[met.grid + number] - met.cell) > met.around[3]


@inner
def _height(x, y, z, num_x, num_y, num_z, first, height):
    """Height above a solid at a place in cells of its grid, its slope, and the nearest corner.

    The height is infinite where it is unknown. A grid of numbers: to hand over the meeting for each
    ball takes twice the time.
    """
    if x < 0 or y < 0 or z < 0 or x >= num_x - 1 or y >= num_y - 1 or z >= num_z - 1:
        return np.inf, 0.0, 0.0, 0.0, 0
    i, j, k = int(x), int(y), int(z)
    x, y, z = x - i, y - j, z - k
    by_x, by_y = num_y * num_z, num_z
    at = first + i * by_x + j * by_y + k
    h000, h001 = height[at], height[at + 1]
    h010, h011 = height[at + by_y], height[at + by_y + 1]
    h100, h101 = height[at + by_x], height[at + by_x + 1]
    h110, h111 = height[at + by_x + by_y], height[at + by_x + by_y + 1]
    h00, h01 = h000 + z * (h001 - h000), h010 + z * (h011 - h010)
    h10, h11 = h100 + z * (h101 - h100), h110 + z * (h111 - h110)
    h0, h1 = h00 + y * (h01 - h00), h10 + y * (h11 - h10)
    found = h0 + x * (h1 - h0)
    if not found < np.inf:
        return np.inf, 0.0, 0.0, 0.0, 0
    by_z0 = (h001 - h000) + y * (h011 - h010 - h001 + h000)
    by_z1 = (h101 - h100) + y * (h111 - h110 - h101 + h100)
    nearest = at + (x > 0.5) * by_x + (y > 0.5) * by_y + (z > 0.5)
    return (
        found,
        h1 - h0,
        (h01 - h00) + x * (h11 - h10 - h01 + h00),
        by_z0 + x * (by_z1 - by_z0),
        nearest,
    )


@inner
def _worst(met, seen, height, place, limits, kept):
    """How much deeper than its limit the worst ball of a meeting is; -inf if none is near.

    Args:
        met: the meeting.
        seen: `(3, 4)` pose of the mover's link.
        height: as in `Meetings`.
        place: as in `Meetings`.
        limits: `(p,)` of the meeting.
        kept: `(2, 3)` is filled in with where the worst ball is, and the slope of the height.
    """
    worst = -np.inf
    balls, first, cell = met.balls, met.grid, met.cell
    c0, c1, c2 = met.corner[0], met.corner[1], met.corner[2]
    n0, n1, n2 = met.sides[0], met.sides[1], met.sides[2]
    for number in range(len(balls)):
        x, y, z = _at(seen, balls[number, 0], balls[number, 1], balls[number, 2])
        up, s0, s1, s2, at = _height(
            (x - c0) / cell, (y - c1) / cell, (z - c2) / cell, n0, n1, n2, first, height
        )
        if up == np.inf:
            continue
        over = balls[number, 3] - up - limits[place[at]]
        if over > worst:
            worst = over
            kept[0, 0], kept[0, 1], kept[0, 2] = x, y, z
            kept[1, 0], kept[1, 1], kept[1, 2] = s0 / cell, s1 / cell, s2 / cell
    return worst


@inner
def _deepen(met, seen, height, place, deepest):
    """Raises `(p,)` depths of a meeting to those of its balls; arguments are those of `_worst`."""
    balls, first, cell = met.balls, met.grid, met.cell
    c0, c1, c2 = met.corner[0], met.corner[1], met.corner[2]
    n0, n1, n2 = met.sides[0], met.sides[1], met.sides[2]
    for number in range(len(balls)):
        x, y, z = _at(seen, balls[number, 0], balls[number, 1], balls[number, 2])
        up, _, _, _, at = _height(
            (x - c0) / cell, (y - c1) / cell, (z - c2) / cell, n0, n1, n2, first, height
        )
        if up < np.inf:
            deepest[place[at]] = max(deepest[place[at]], balls[number, 3] - up)


@compiled
def raise_limits(meetings, poses, deepest):
    """Raises `(l,)` limits to the deepest of n postures, `(n, L, 4, 4)` poses of the links."""
    seen = np.empty((3, 4))
    height, place, clear = meetings.height, meetings.place, meetings.clear
    for number in range(len(meetings.mover)):
        met = _meeting(meetings, number)
        own = deepest[meetings.first_limit[number] :]
        for X in poses:
            _from(X[met.mover_link], X[met.solid_link], seen)
            if not _apart(met, seen, clear):
                _deepen(met, seen, height, place, own)


@compiled
def exceed(meetings, poses, over, kept):
    """Finds how much deeper than their limits M meetings are in n postures.

    Args:
        meetings: of M meetings.
        poses: `(n, L, 4, 4)` of the links.
        over: `(M, n)` is filled in, in units of depth; -inf where nothing is near.
        kept: `(M, n, 2, 3)` is filled in with where the worst ball is in the frame of the solid's
            link, and the slope of the height there.
    """
    seen = np.empty((3, 4))
    height, place, clear = meetings.height, meetings.place, meetings.clear
    for number in range(len(meetings.mover)):
        met = _meeting(meetings, number)
        limits = meetings.limits[meetings.first_limit[number] :]
        for row in range(len(poses)):
            X = poses[row]
            _from(X[met.mover_link], X[met.solid_link], seen)
            over[number, row] = -np.inf
            if not _apart(met, seen, clear):
                worst = _worst(met, seen, height, place, limits, kept[number, row])
                over[number, row] = worst / meetings.unit[number]


@compiled
def push(meetings, poses, twists, carries, over, kept, slope, square):
    """Adds up what readings change in what is missing to a margin.

    Args:
        meetings: of M meetings.
        poses: `(n, L, 4, 4)` of the links.
        twists: `(J, 6)` of the joints, as in `BodyModel`.
        carries: `(L, J)` bool, whether each joint carries each link.
        over: `(M, n)` what is missing, in units of depth; 0 where nothing is.
        kept: as in `exceed`.
        slope: `(n, J)` half of the derivatives of the sums of squares by the readings.
        square: `(n, J, J)` products of the derivatives of what is missing.
    """
    num = len(twists)
    by_q = np.empty(num)
    for meeting in range(len(over)):
        mover, wearer = meetings.mover_link[meeting], meetings.solid_link[meeting]
        unit = meetings.unit[meeting]
        for row in range(len(poses)):
            missing = over[meeting, row]
            if missing <= 0.0:
                continue
            # The place and the direction into the solid, in the frame of the base.
            X, own = poses[row, wearer], kept[meeting, row]
            x, y, z = _at(X, own[0, 0], own[0, 1], own[0, 2])
            h0, h1, h2 = _at(X, own[1, 0], own[1, 1], own[1, 2])
            h0, h1, h2 = X[0, 3] - h0, X[1, 3] - h1, X[2, 3] - h2
            for joint in range(num):
                by_q[joint] = 0.0
                if carries[mover, joint] != carries[wearer, joint]:
                    v0, v1, v2 = _speed(poses[row, joint], twists[joint], x, y, z)
                    sign = 1.0 if carries[mover, joint] else -1.0
                    by_q[joint] = sign * (h0 * v0 + h1 * v1 + h2 * v2) / unit
            for joint in range(num):
                slope[row, joint] += missing * by_q[joint]
                for other in range(num):
                    square[row, joint, other] += by_q[joint] * by_q[other]


@inner
def _speed(X, twist, x, y, z):
    """How fast a point of the base moves by a joint; X is the pose of its link.

    A joint's own axis stays where it is when the joint moves.
    """
    x, y, z = x - X[0, 3], y - X[1, 3], z - X[2, 3]
    w0 = X[0, 0] * twist[0] + X[0, 1] * twist[1] + X[0, 2] * twist[2]
    w1 = X[1, 0] * twist[0] + X[1, 1] * twist[1] + X[1, 2] * twist[2]
    w2 = X[2, 0] * twist[0] + X[2, 1] * twist[1] + X[2, 2] * twist[2]
    return (
        X[0, 0] * twist[3] + X[0, 1] * twist[4] + X[0, 2] * twist[5] + w1 * z - w2 * y,
        X[1, 0] * twist[3] + X[1, 1] * twist[4] + X[1, 2] * twist[5] + w2 * x - w0 * z,
        X[2, 0] * twist[3] + X[2, 1] * twist[4] + X[2, 2] * twist[5] + w0 * y - w1 * x,
    )
