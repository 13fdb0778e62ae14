"""A chain of joints, each a general twist: where it carries a point, and the derivatives of that.

A twist `(w, v)` moves a point p by `exp(t (w, v)) p`, where t is the joint's reading: with `u = w x
p + v` and `n = |w|` that is

    p + t u + a1 w x u + a2 w x (w x u),   a1 = (1 - cos n t) / n^2,   a2 = (n t - sin n t) / n^3

which turns where w is not zero, slides along v where it is, and is smooth in between. The scale of
a joint's reading is part of its twist: no unit is assumed (Brockett 1984; Lynch and Park 2017,
3.3).
"""

import math

import numpy as np

from selftouch_drake.compiled import compiled, inner

# Square of an angle below which the coefficients are series: their error is below 1e-15 there.
_SMALL = 0.05


@inner
def coefficients(n2, t):
    """`a1` and `a2` of a turn with `|w|^2 = n2` by t, and `1 / n` times their derivatives by n."""
    t2 = t * t
    angle2 = n2 * t2
    if angle2 < _SMALL:
        a1 = t2 * (1 / 2 - angle2 * (1 / 24 - angle2 * (1 / 720 - angle2 / 40320)))
        a2 = t * t2 * (1 / 6 - angle2 * (1 / 120 - angle2 * (1 / 5040 - angle2 / 362880)))
        b1 = t2 * t2 * (-1 / 12 + angle2 * (1 / 180 - angle2 * (1 / 6720 - angle2 / 453600)))
        b2 = t * t2 * t2 * (-1 / 60 + angle2 * (1 / 1260 - angle2 * (1 / 60480)))
        return a1, a2, b1, b2
    n = math.sqrt(n2)
    a1 = (1 - math.cos(n * t)) / n2
    a2 = (n * t - math.sin(n * t)) / (n * n2)
    return a1, a2, (t * (t - n2 * a2) - 2 * a1) / n2, (t * a1 - 3 * a2) / n2


@inner
def moved(twist, a1, a2, t, x, y, z):
    """Point (x, y, z), moved by a twist whose coefficients at t are a1 and a2."""
    w0, w1, w2 = twist[0], twist[1], twist[2]
    u0 = w1 * z - w2 * y + twist[3]
    u1 = w2 * x - w0 * z + twist[4]
    u2 = w0 * y - w1 * x + twist[5]
    c0, c1, c2 = w1 * u2 - w2 * u1, w2 * u0 - w0 * u2, w0 * u1 - w1 * u0
    return (
        x + t * u0 + a1 * c0 + a2 * (w1 * c2 - w2 * c1),
        y + t * u1 + a1 * c1 + a2 * (w2 * c0 - w0 * c2),
        z + t * u2 + a1 * c2 + a2 * (w0 * c1 - w1 * c0),
    )


@compiled
def _places(q, twists, signs, point, place):
    for i in range(len(q)):
        x, y, z = point[i, 0], point[i, 1], point[i, 2]
        for joint in range(len(twists) - 1, -1, -1):
            twist, t = twists[joint], signs[joint] * q[i, joint]
            n2 = twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]
            a1, a2, _, _ = coefficients(n2, t)
            x, y, z = moved(twist, a1, a2, t, x, y, z)
        place[i, 0], place[i, 1], place[i, 2] = x, y, z


def places(
    q: np.ndarray, twists: np.ndarray, point: np.ndarray, signs: np.ndarray | None = None
) -> np.ndarray:
    """`(n, 3)` place of a point that a chain carries: `exp(t1 q1) ... exp(tL qL) point`.

    Args:
        q: `(n, L)` readings of the joints, from the place where the chain begins to the point.
        twists: `(L, 6)` w and v of each joint, per unit of its reading.
        point: `(3,)` where the point is when all readings are 0; `(n, 3)`: a point for each row.
        signs: `(L,)` 1, or -1 where the chain passes the joint backwards; all 1 by default.
    """
    q = np.ascontiguousarray(q, dtype=float)
    place = np.empty((len(q), 3))
    _places(q, *_chain(twists, signs), _points(point, len(q)), place)
    return place


@compiled
def _turns(q, twists, signs, turn):
    only = np.zeros(6)
    for i in range(len(q)):
        own = turn[i]
        for axis in range(3):
            own[axis, axis] = 1.0
        for joint in range(len(twists) - 1, -1, -1):
            twist, t = twists[joint], signs[joint] * q[i, joint]
            only[0], only[1], only[2] = twist[0], twist[1], twist[2]
            n2 = twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]
            a1, a2, _, _ = coefficients(n2, t)
            for axis in range(3):
                own[0, axis], own[1, axis], own[2, axis] = moved(
                    only, a1, a2, t, own[0, axis], own[1, axis], own[2, axis]
                )


def turns(q: np.ndarray, twists: np.ndarray, signs: np.ndarray | None = None) -> np.ndarray:
    """`(n, 3, 3)` rotation of what a chain carries; arguments are those of `places`."""
    q = np.ascontiguousarray(q, dtype=float)
    turn = np.zeros((len(q), 3, 3))
    _turns(q, *_chain(twists, signs), turn)
    return turn


@inner
def _passed(q, twists, signs, point, points, known):
    """Fills in where a point is after each joint of a chain, and the coefficients of the joints."""
    length = len(twists)
    for axis in range(3):
        points[length, axis] = point[axis]
    for joint in range(length - 1, -1, -1):
        twist, t = twists[joint], signs[joint] * q[joint]
        n2 = twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]
        a1, a2, b1, b2 = coefficients(n2, t)
        known[joint, 0], known[joint, 1], known[joint, 2], known[joint, 3] = a1, a2, b1, b2
        x, y, z = points[joint + 1, 0], points[joint + 1, 1], points[joint + 1, 2]
        x, y, z = moved(twist, a1, a2, t, x, y, z)
        points[joint, 0], points[joint, 1], points[joint, 2] = x, y, z


@inner
def _by_reading(twist, sign, at, g0, g1, g2):
    """How fast a point at `at` moves along g by a joint's reading: with w x p + v."""
    w0, w1, w2 = twist[0], twist[1], twist[2]
    x0, x1, x2 = at[0], at[1], at[2]
    return sign * (
        g0 * (w1 * x2 - w2 * x1 + twist[3])
        + g1 * (w2 * x0 - w0 * x2 + twist[4])
        + g2 * (w0 * x1 - w1 * x0 + twist[5])
    )


@compiled
def _derivatives(q, twists, signs, point, place, by_twist, by_point, by_q):
    length = len(twists)
    points = np.empty((length + 1, 3))
    known = np.empty((length, 4))
    for i in range(len(q)):
        _passed(q[i], twists, signs, point[i], points, known)
        place[i, 0], place[i, 1], place[i, 2] = points[0, 0], points[0, 1], points[0, 2]
        for axis in range(3):
            g0, g1, g2 = 1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2)
            for joint in range(length):
                twist, t = twists[joint], signs[joint] * q[i, joint]
                w0, w1, w2 = twist[0], twist[1], twist[2]
                a1, a2 = known[joint, 0], known[joint, 1]
                x, y, z = points[joint + 1, 0], points[joint + 1, 1], points[joint + 1, 2]
                u0 = w1 * z - w2 * y + twist[3]
                u1 = w2 * x - w0 * z + twist[4]
                u2 = w0 * y - w1 * x + twist[5]
                c0, c1, c2 = w1 * u2 - w2 * u1, w2 * u0 - w0 * u2, w0 * u1 - w1 * u0
                by_q[i, axis, joint] = _by_reading(twist, signs[joint], points[joint], g0, g1, g2)
                # g x w, and h: the gradient with respect to v.
                d0, d1, d2 = g1 * w2 - g2 * w1, g2 * w0 - g0 * w2, g0 * w1 - g1 * w0
                h0 = t * g0 + a1 * d0 + a2 * (d1 * w2 - d2 * w1)
                h1 = t * g1 + a1 * d1 + a2 * (d2 * w0 - d0 * w2)
                h2 = t * g2 + a1 * d2 + a2 * (d0 * w1 - d1 * w0)
                along = known[joint, 2] * (g0 * c0 + g1 * c1 + g2 * c2) + known[joint, 3] * (
                    d0 * c0 + d1 * c1 + d2 * c2
                )
                grad = by_twist[i, axis, joint]
                grad[0] = (
                    (y * h2 - z * h1)
                    + a1 * (u1 * g2 - u2 * g1)
                    + a2 * ((c1 * g2 - c2 * g1) + (u1 * d2 - u2 * d1))
                    + along * w0
                )
                grad[1] = (
                    (z * h0 - x * h2)
                    + a1 * (u2 * g0 - u0 * g2)
                    + a2 * ((c2 * g0 - c0 * g2) + (u2 * d0 - u0 * d2))
                    + along * w1
                )
                grad[2] = (
                    (x * h1 - y * h0)
                    + a1 * (u0 * g1 - u1 * g0)
                    + a2 * ((c0 * g1 - c1 * g0) + (u0 * d1 - u1 * d0))
                    + along * w2
                )
                grad[3], grad[4], grad[5] = h0, h1, h2
                # g is carried to the next joint: g + h x w.
                g0 += h1 * w2 - h2 * w1
                g1 += h2 * w0 - h0 * w2
                g2 += h0 * w1 - h1 * w0
            by_point[i, axis, 0], by_point[i, axis, 1], by_point[i, axis, 2] = g0, g1, g2


def derivatives(
    q: np.ndarray, twists: np.ndarray, point: np.ndarray, signs: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The places, and their derivatives in closed form; arguments are those of `places`.

    Returns:
        place: `(n, 3)`.
        by_twist: `(n, 3, L, 6)` derivatives with respect to the twists.
        by_point: `(n, 3, 3)` with respect to the point: also the rotation of its link.
        by_q: `(n, 3, L)` with respect to the readings.
    """
    q = np.ascontiguousarray(q, dtype=float)
    length = len(twists)
    place, by_point = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    by_twist, by_q = np.empty((len(q), 3, length, 6)), np.empty((len(q), 3, length))
    tip = _points(point, len(q))
    _derivatives(q, *_chain(twists, signs), tip, place, by_twist, by_point, by_q)
    return place, by_twist, by_point, by_q


@inner
def slope(q, twists, signs, point, points, known, place, by_q, turn):
    """Fills in a row of `slopes`; `points` `(L + 1, 3)` and `known` `(L, 4)` are room to work."""
    _passed(q, twists, signs, point, points, known)
    place[0], place[1], place[2] = points[0, 0], points[0, 1], points[0, 2]
    for axis in range(3):
        g0, g1, g2 = 1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2)
        for joint in range(len(twists)):
            twist, t = twists[joint], signs[joint] * q[joint]
            w0, w1, w2 = twist[0], twist[1], twist[2]
            a1, a2 = known[joint, 0], known[joint, 1]
            by_q[axis, joint] = _by_reading(twist, signs[joint], points[joint], g0, g1, g2)
            # g is carried to the next joint.
            d0, d1, d2 = g1 * w2 - g2 * w1, g2 * w0 - g0 * w2, g0 * w1 - g1 * w0
            h0 = t * g0 + a1 * d0 + a2 * (d1 * w2 - d2 * w1)
            h1 = t * g1 + a1 * d1 + a2 * (d2 * w0 - d0 * w2)
            h2 = t * g2 + a1 * d2 + a2 * (d0 * w1 - d1 * w0)
            g0 += h1 * w2 - h2 * w1
            g1 += h2 * w0 - h0 * w2
            g2 += h0 * w1 - h1 * w0
        turn[axis, 0], turn[axis, 1], turn[axis, 2] = g0, g1, g2


@compiled
def _slopes(q, twists, signs, point, place, by_q, turn):
    points = np.empty((len(twists) + 1, 3))
    known = np.empty((len(twists), 4))
    for i in range(len(q)):
        slope(q[i], twists, signs, point[i], points, known, place[i], by_q[i], turn[i])


def slopes(
    q: np.ndarray, twists: np.ndarray, point: np.ndarray, signs: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `derivatives`, without those by the twists: `place`, `by_q` and the link's rotation."""
    q = np.ascontiguousarray(q, dtype=float)
    place, turn = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    by_q = np.empty((len(q), 3, len(twists)))
    _slopes(q, *_chain(twists, signs), _points(point, len(q)), place, by_q, turn)
    return place, by_q, turn


def exponentials(twists: np.ndarray) -> np.ndarray:
    """`(n, 4, 4)` rigid motions `exp(twist)` of `(n, 6)` twists."""
    twists = np.asarray(twists, dtype=float).reshape(-1, 6)
    motions = np.zeros((len(twists), 4, 4))
    motions[:, 3, 3] = 1
    _exponentials(np.ascontiguousarray(twists), motions)
    return motions


@compiled
def _exponentials(twists, motions):
    turn = np.zeros(6)
    for i in range(len(twists)):
        twist, motion = twists[i], motions[i]
        n2 = twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]
        a1, a2, _, _ = coefficients(n2, 1.0)
        x, y, z = moved(twist, a1, a2, 1.0, 0.0, 0.0, 0.0)
        motion[0, 3], motion[1, 3], motion[2, 3] = x, y, z
        turn[0], turn[1], turn[2] = twist[0], twist[1], twist[2]
        for axis in range(3):
            x, y, z = moved(
                turn, a1, a2, 1.0, 1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2)
            )
            motion[0, axis], motion[1, axis], motion[2, axis] = x, y, z


@compiled
def carry(motions, order, parent, poses):
    """Fills in the poses of links, each moved by its own joint and carried by another link.

    Args:
        motions: `(n, J, 4, 4)` of each joint.
        order: joints to fill in, each after that which carries it.
        parent: `(J,)` the link that carries each joint's own; -1 is the last one.
        poses: `(n, L, 4, 4)`, those of the links that carry the first ones filled in.
    """
    for row in range(len(motions)):
        for joint in order:
            own, below, above = motions[row, joint], poses[row, parent[joint]], poses[row, joint]
            for i in range(4):
                for j in range(4):
                    above[i, j] = 0.0
                    for k in range(4):
                        above[i, j] += below[i, k] * own[k, j]


def adjoint(motion: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """`(..., 6)` twists seen from another frame: `motion @ exp(twist) @ inv(motion)`.

    Args:
        motion: `(4, 4)` rigid motion, or a similarity whose rotation has any scale and handedness.
        twist: `(..., 6)`.
    """
    turn, offset = motion[:3, :3], motion[:3, 3]
    scale = np.cbrt(np.abs(np.linalg.det(turn)))
    # A mirror image turns the other way round.
    w = np.sign(np.linalg.det(turn)) * twist[..., :3] @ (turn / scale).T
    return np.concatenate([w, twist[..., 3:] @ turn.T + np.cross(offset, w)], axis=-1)


def shifted(
    twists: np.ndarray, center: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same chain for readings `q`, from its twists for `(q - center) / scale`.

    Args:
        twists: `(L, 6)` from the place where the chain begins.
        center: `(L,)` of the readings.
        scale: `(L,)` of the readings.

    Returns:
        `(L, 6)` twists for `q`, in the frame of all at `q = 0`, and `(4, 4)` what carries a point
        from the former frame of all to this one.
    """
    carried = np.eye(4)
    out = np.empty((len(twists), 6))
    for joint, twist in enumerate(np.asarray(twists, dtype=float)):
        out[joint] = adjoint(carried, twist / scale[joint])
        carried = carried @ exponentials(-twist * center[joint] / scale[joint])[0]
    return out, carried


def _points(point: np.ndarray, number: int) -> np.ndarray:
    """`(number, 3)` points of a point or of so many."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(point, dtype=float), (number, 3)))


def _chain(twists: np.ndarray, signs: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    twists = np.ascontiguousarray(twists, dtype=float).reshape(-1, 6)
    return twists, np.ones(len(twists)) if signs is None else np.array(signs, dtype=float)
