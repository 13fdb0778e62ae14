"""Many hypotheses of a body at once: the criterion, its gradient by hand, and Adam, compiled.

A member of a population has twists, points of its touchers, and its own way from each group of
touches to what touched: so orders of joints compete. A *group* is a set of kernels that one toucher
touched on one part. Its criterion is the log-determinant of the scatter of places within kernels,
less that of the total scatter: it has no scale, no place and no handedness, and cannot collapse.

Wrong labels ruin a log-determinant, so the scatter within kernels is that of a Student
distribution: each touch has a weight, and those far away have little. At the best scatter and
the best weighted means the gradient is that of fixed weights.

Places are kept in tiles of structures of arrays, in single precision, because that is what the
compiler turns into vector instructions; sums over a tile may be taken in any order for the same
reason, which makes them differ in the last bits between kinds of processors, as BLAS does. All of
it is in one array: before a compiled loop runs as vectors it compares the addresses of what it
reads and writes, and with arrays of their own the last bits would depend on where these happen to
lie. What is summed in double precision keeps the order of the code.
"""

import math
from typing import NamedTuple

import numpy as np

from selftouch_drake.compiled import compiled, inner, inner_in_any_order

F, U = np.float32, np.uint64
#: Rows of a tile; draws are padded to a multiple.
TILE = 64
_T = U(TILE)
# Arrays of one tile at one joint: x, y, z, a1, a2.
_KEPT = U(5 * TILE)
# Adam's usual constants.
_BETA1, _BETA2, _TINY = 0.9, 0.999, 1e-9
# Added to both scatters, times the total variance.
_FLOOR = 1e-6
# Rounds of weights at each step; the scatter is carried on from step to step.
_ROUNDS = 2
_INV_PI, _PI_A, _PI_B = F(1 / math.pi), F(3.140625), F(math.pi - 3.140625)
_HALF, _ONE, _TWO = F(0.5), F(1), F(2)
_S1, _S2, _S3, _S4 = F(-1 / 6), F(1 / 120), F(-1 / 5040), F(1 / 362880)
_S5 = F(-1 / 39916800)
_C2, _C3, _C4, _C5, _C6 = F(1 / 24), F(1 / 720), F(1 / 40320), F(1 / 3628800), F(1 / 479001600)
_A1, _A2, _A3, _A4 = F(1 / 24), F(1 / 720), F(1 / 40320), F(1 / 3628800)
_B0, _B1, _B2, _B3, _B4 = F(1 / 6), F(1 / 120), F(1 / 5040), F(1 / 362880), F(1 / 39916800)
_D1, _D2, _D3, _D4 = F(1 / 12), F(1 / 180), F(1 / 6720), F(1 / 453600)
_E1, _E2, _E3, _E4 = F(1 / 60), F(1 / 1260), F(1 / 60480), F(1 / 4989600)


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
        precision: `(N, N)` of places that are a smooth function of sensations, with the mean taken
            out: it takes the place of kernels, for a single group; `(0, 0)` for kernels.
    """

    q: np.ndarray
    rows: np.ndarray
    num_kernels: np.ndarray
    members: np.integer
    weight: np.ndarray
    precision: np.ndarray


@inner_in_any_order
def _forward(room, at, out, read, sign, twist):
    """Moves the points of one tile by one joint: from `at` to `out`, keeping a1 and a2 at `out`."""
    w0, w1, w2 = F(twist[0]), F(twist[1]), F(twist[2])
    v0, v1, v2 = F(twist[3]), F(twist[4]), F(twist[5])
    n2 = w0 * w0 + w1 * w1 + w2 * w2
    n = F(math.sqrt(n2))
    largest = F(0)
    for i in range(_T):
        largest = max(largest, abs(room[read + i]))
    if n * largest < _ONE:
        for i in range(_T):
            t = sign * room[read + i]
            t2 = t * t
            s = t2 * n2
            room[out + U(3 * TILE) + i] = t2 * (_HALF - s * (_A1 - s * (_A2 - s * (_A3 - s * _A4))))
            room[out + U(4 * TILE) + i] = (
                t * t2 * (_B0 - s * (_B1 - s * (_B2 - s * (_B3 - s * _B4))))
            )
    else:
        i2 = _ONE / n2
        i3 = i2 / n
        for i in range(_T):
            angle = n * sign * room[read + i]
            k = F(math.floor(angle * _INV_PI + _HALF))
            y = (angle - k * _PI_A) - k * _PI_B
            flip = _ONE - _TWO * (k - _TWO * F(math.floor(k * _HALF)))
            y2 = y * y
            sine = flip * y * (_ONE + y2 * (_S1 + y2 * (_S2 + y2 * (_S3 + y2 * (_S4 + y2 * _S5)))))
            less = y2 * (_HALF - y2 * (_C2 - y2 * (_C3 - y2 * (_C4 - y2 * (_C5 - y2 * _C6)))))
            room[out + U(3 * TILE) + i] = (_ONE - flip + flip * less) * i2
            room[out + U(4 * TILE) + i] = (angle - sine) * i3
    for i in range(_T):
        t = sign * room[read + i]
        x, y, z = room[at + i], room[at + _T + i], room[at + U(2 * TILE) + i]
        a1, a2 = room[out + U(3 * TILE) + i], room[out + U(4 * TILE) + i]
        u0 = w1 * z - w2 * y + v0
        u1 = w2 * x - w0 * z + v1
        u2 = w0 * y - w1 * x + v2
        c0, c1, c2 = w1 * u2 - w2 * u1, w2 * u0 - w0 * u2, w0 * u1 - w1 * u0
        room[out + i] = x + t * u0 + a1 * c0 + a2 * (w1 * c2 - w2 * c1)
        room[out + _T + i] = y + t * u1 + a1 * c1 + a2 * (w2 * c0 - w0 * c2)
        room[out + U(2 * TILE) + i] = z + t * u2 + a1 * c2 + a2 * (w0 * c1 - w1 * c0)


@inner_in_any_order
def _backward(room, slopes, at, out, read, sign, twist, gradient):
    """Carries `dL/dplace` of one tile, at `slopes`, back from `out` to `at`; adds to `gradient`."""
    w0, w1, w2 = F(twist[0]), F(twist[1]), F(twist[2])
    v0, v1, v2 = F(twist[3]), F(twist[4]), F(twist[5])
    n2 = w0 * w0 + w1 * w1 + w2 * w2
    n = F(math.sqrt(n2))
    largest = F(0)
    for i in range(_T):
        largest = max(largest, abs(room[read + i]))
    series = n * largest < _ONE
    i2 = _ONE / max(n2, F(1e-20))
    m0, m1, m2, e0, e1, e2 = F(0), F(0), F(0), F(0), F(0), F(0)
    first = F(0)
    for i in range(_T):
        t = sign * room[read + i]
        x, y, z = room[at + i], room[at + _T + i], room[at + U(2 * TILE) + i]
        a1, a2 = room[out + U(3 * TILE) + i], room[out + U(4 * TILE) + i]
        g0, g1, g2 = room[slopes + i], room[slopes + _T + i], room[slopes + U(2 * TILE) + i]
        u0 = w1 * z - w2 * y + v0
        u1 = w2 * x - w0 * z + v1
        u2 = w0 * y - w1 * x + v2
        c0, c1, c2 = w1 * u2 - w2 * u1, w2 * u0 - w0 * u2, w0 * u1 - w1 * u0
        d0, d1, d2 = g1 * w2 - g2 * w1, g2 * w0 - g0 * w2, g0 * w1 - g1 * w0
        h0 = t * g0 + a1 * d0 + a2 * (d1 * w2 - d2 * w1)
        h1 = t * g1 + a1 * d1 + a2 * (d2 * w0 - d0 * w2)
        h2 = t * g2 + a1 * d2 + a2 * (d0 * w1 - d1 * w0)
        gc, dc = g0 * c0 + g1 * c1 + g2 * c2, d0 * c0 + d1 * c1 + d2 * c2
        t2 = t * t
        if series:
            s = t2 * n2
            b1 = -t2 * t2 * (_D1 - s * (_D2 - s * (_D3 - s * _D4)))
            b2 = -t * t2 * t2 * (_E1 - s * (_E2 - s * (_E3 - s * _E4)))
        else:
            b1 = (t * (t - n2 * a2) - _TWO * a1) * i2
            b2 = (t * a1 - F(3) * a2) * i2
        first += b1 * gc + b2 * dc
        m0 += (y * h2 - z * h1) + a1 * (u1 * g2 - u2 * g1)
        m1 += (z * h0 - x * h2) + a1 * (u2 * g0 - u0 * g2)
        m2 += (x * h1 - y * h0) + a1 * (u0 * g1 - u1 * g0)
        m0 += a2 * ((c1 * g2 - c2 * g1) + (u1 * d2 - u2 * d1))
        m1 += a2 * ((c2 * g0 - c0 * g2) + (u2 * d0 - u0 * d2))
        m2 += a2 * ((c0 * g1 - c1 * g0) + (u0 * d1 - u1 * d0))
        e0 += h0
        e1 += h1
        e2 += h2
        room[slopes + i] = g0 + h1 * w2 - h2 * w1
        room[slopes + _T + i] = g1 + h2 * w0 - h0 * w2
        room[slopes + U(2 * TILE) + i] = g2 + h0 * w1 - h1 * w0
    gradient[0] += m0 + first * w0
    gradient[1] += m1 + first * w1
    gradient[2] += m2 + first * w2
    gradient[3] += e0
    gradient[4] += e1
    gradient[5] += e2


@inner
def invert(S, inverse):
    """Inverse of a symmetric `(3, 3)`; returns the logarithm of its determinant."""
    a, b, c, d, e, f = S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = max(a * A + b * B + c * C, 1e-300)
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = A / determinant, B / determinant, C / determinant
    inverse[1, 0], inverse[1, 1] = inverse[0, 1], (a * f - c * c) / determinant
    inverse[1, 2] = (b * c - a * e) / determinant
    inverse[2, 0], inverse[2, 1] = inverse[0, 2], inverse[1, 2]
    inverse[2, 2] = (a * d - b * b) / determinant
    return math.log(determinant)


@inner
def _means(x, weights, means, num_kernels, members):
    """Weighted means of kernels."""
    for kernel in range(num_kernels):
        m0, m1, m2, total = 0.0, 0.0, 0.0, 0.0
        for i in range(kernel * members, (kernel + 1) * members):
            u = weights[i]
            total += u
            m0 += u * x[0, i]
            m1 += u * x[1, i]
            m2 += u * x[2, i]
        means[kernel, 0], means[kernel, 1], means[kernel, 2] = m0 / total, m1 / total, m2 / total


@inner
def _scatter(x, weights, means, num_kernels, members, S):
    """Weighted means of kernels, and the weighted scatter around them."""
    count = num_kernels * members
    S[:] = 0.0
    _means(x, weights, means, num_kernels, members)
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for i in range(kernel * members, (kernel + 1) * members):
            r0, r1, r2, u = x[0, i] - m0, x[1, i] - m1, x[2, i] - m2, weights[i]
            S[0, 0] += u * r0 * r0
            S[0, 1] += u * r0 * r1
            S[0, 2] += u * r0 * r2
            S[1, 1] += u * r1 * r1
            S[1, 2] += u * r1 * r2
            S[2, 2] += u * r2 * r2
    scale = members / (members - 1.0) / count
    for a in range(3):
        for b in range(a, 3):
            S[a, b] *= scale
            S[b, a] = S[a, b]


@inner
def _reweighed(x, weights, means, inverse, num_kernels, members, tail):
    """Weights of a Student distribution; returns the mean of its logarithms."""
    total = 0.0
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for i in range(kernel * members, (kernel + 1) * members):
            r0, r1, r2 = x[0, i] - m0, x[1, i] - m1, x[2, i] - m2
            d = (
                inverse[0, 0] * r0 * r0
                + inverse[1, 1] * r1 * r1
                + inverse[2, 2] * r2 * r2
                + 2 * (inverse[0, 1] * r0 * r1 + inverse[0, 2] * r0 * r2 + inverse[1, 2] * r1 * r2)
            )
            weights[i] = (tail + 3) / (tail + d)
            total += math.log(1 + d / tail)
    return (tail + 3) * total / (num_kernels * members)


@inner
def _spread(x, weights, count, center, S):
    """Weighted mean and scatter of all places."""
    total = 0.0
    center[:] = 0.0
    S[:] = 0.0
    for i in range(count):
        u = weights[i]
        total += u
        center[0] += u * x[0, i]
        center[1] += u * x[1, i]
        center[2] += u * x[2, i]
    center[0], center[1], center[2] = center[0] / total, center[1] / total, center[2] / total
    for i in range(count):
        r0, r1, r2, u = x[0, i] - center[0], x[1, i] - center[1], x[2, i] - center[2], weights[i]
        S[0, 0] += u * r0 * r0
        S[0, 1] += u * r0 * r1
        S[0, 2] += u * r0 * r2
        S[1, 1] += u * r1 * r1
        S[1, 2] += u * r1 * r2
        S[2, 2] += u * r2 * r2
    for a in range(3):
        for b in range(a, 3):
            S[a, b] /= total
            S[b, a] = S[a, b]
    return total


@inner
def _criterion(x, slopes, weights, means, within, num_kernels, members, tail, factor, work):
    """The criterion of one group, and its gradient by the places.

    Args:
        x: `(3, N)` places.
        slopes: `(3, N)` is filled.
        weights: `(N,)` is filled.
        means: `(K, 3)` is filled.
        within: `(3, 3)` scatter within kernels that the last step found, all 0 at first; replaced.
        num_kernels: in x.
        members: of each.
        tail: degrees of freedom of the Student distribution; 0 for a Gaussian one.
        factor: weight of the group.
        work: `(4, 3, 3)` scratch.
    """
    count = num_kernels * members
    inverse, total, total_inverse, center = work[0], work[1], work[2], work[3, 0]
    weights[:count] = 1.0
    rounds = 1
    if tail > 0:
        rounds += _ROUNDS
        if within[0, 0] > 0:
            # The scatter of the last step, around plain means, tells far touches at once.
            _means(x, weights, means, num_kernels, members)
            invert(within, inverse)
            _reweighed(x, weights, means, inverse, num_kernels, members, tail)
            rounds -= 1
    far = 0.0
    log_within = 0.0
    for _turn in range(rounds):
        _scatter(x, weights, means, num_kernels, members, within)
        _spread(x, weights, count, center, total)
        floor = _FLOOR * (total[0, 0] + total[1, 1] + total[2, 2])
        for a in range(3):
            within[a, a] += floor
            total[a, a] += floor
        log_within = invert(within, inverse)
        if tail > 0:
            far = _reweighed(x, weights, means, inverse, num_kernels, members, tail)
    log_total = invert(total, total_inverse)
    mass = 0.0
    for i in range(count):
        mass += weights[i]
    inner_factor = 2 * factor * members / (members - 1.0) / count
    outer_factor = 2 * factor / mass
    for kernel in range(num_kernels):
        for i in range(kernel * members, (kernel + 1) * members):
            u = weights[i]
            r0, r1, r2 = (
                x[0, i] - means[kernel, 0],
                x[1, i] - means[kernel, 1],
                x[2, i] - means[kernel, 2],
            )
            t0, t1, t2 = x[0, i] - center[0], x[1, i] - center[1], x[2, i] - center[2]
            for a in range(3):
                slopes[a, i] = u * (
                    inner_factor * (inverse[a, 0] * r0 + inverse[a, 1] * r1 + inverse[a, 2] * r2)
                    - outer_factor
                    * (
                        total_inverse[a, 0] * t0
                        + total_inverse[a, 1] * t1
                        + total_inverse[a, 2] * t2
                    )
                )
    return log_within + far - log_total


@inner
def _applied(precision, x, out):
    """The symmetric precision times the places, `(3, N)` both."""
    number = len(precision)
    out[:, :number] = 0.0
    for i in range(number):
        row = precision[i]
        x0, x1, x2 = x[0, i], x[1, i], x[2, i]
        # Each sum keeps its order, and the loop still becomes vectors.
        for j in range(number):
            out[0, j] += row[j] * x0
            out[1, j] += row[j] * x1
            out[2, j] += row[j] * x2


@inner
def _smooth_criterion(x, slopes, weights, precision, factor, work):
    """The criterion of places that should be smooth in the sensations, and its gradient.

    Args:
        x: `(3, N)` places.
        slopes: `(3, N)` is filled.
        weights: `(N,)` is filled with ones.
        precision: `(N, N)`.
        factor: weight of the group.
        work: `(4, 3, 3)` scratch.
    """
    count = len(precision)
    within, inverse, total, total_inverse = work[0], work[1], work[2], work[3]
    center = np.zeros(3)
    weights[:count] = 1.0
    _spread(x, weights, count, center, total)
    _applied(precision, x, slopes)
    for a in range(3):
        for b in range(3):
            product = 0.0
            for i in range(count):
                product += x[a, i] * slopes[b, i]
            within[a, b] = product / count
    floor = _FLOOR * (total[0, 0] + total[1, 1] + total[2, 2])
    for a in range(3):
        within[a, a] += floor
        total[a, a] += floor
    value = invert(within, inverse) - invert(total, total_inverse)
    step = 2 * factor / count
    for i in range(count):
        s0, s1, s2 = slopes[0, i], slopes[1, i], slopes[2, i]
        t0, t1, t2 = x[0, i] - center[0], x[1, i] - center[1], x[2, i] - center[2]
        for a in range(3):
            slopes[a, i] = step * (
                (inverse[a, 0] * s0 + inverse[a, 1] * s1 + inverse[a, 2] * s2)
                - (total_inverse[a, 0] * t0 + total_inverse[a, 1] * t1 + total_inverse[a, 2] * t2)
            )
    return value


@inner
def _descend(value, slope, mean, square, rate, step):
    """One step of Adam on flat arrays."""
    c1, c2 = 1 - _BETA1 ** (step + 1), 1 - _BETA2 ** (step + 1)
    for i in range(len(value)):
        mean[i] = _BETA1 * mean[i] + (1 - _BETA1) * slope[i]
        square[i] = _BETA2 * square[i] + (1 - _BETA2) * slope[i] * slope[i]
        value[i] -= rate * (mean[i] / c1) / (math.sqrt(square[i] / c2) + _TINY)


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
    q, rows = draws.q, draws.rows
    steps, num_groups, num_rows = rows.shape
    num_members, num_joints = twists.shape[0], twists.shape[1]
    num_points, longest, members = points.shape[1], ways.joint.shape[2], draws.members
    num_tiles = num_rows // TILE
    stride = U(longest + 1) * _KEPT
    # Places of all tiles, readings of all groups, slopes of one tile.
    of_readings = U(num_tiles) * stride
    tile_slopes = of_readings + U(num_groups * num_joints * num_rows)
    room = np.zeros(tile_slopes + U(3 * TILE), F)
    x, slopes, weights = np.zeros((3, num_rows)), np.zeros((3, num_rows)), np.zeros(num_rows)
    means, work = np.zeros((num_rows, 3)), np.zeros((4, 3, 3))
    within = np.zeros((num_members, num_groups, 3, 3))
    history = np.zeros((num_members, num_groups))
    by_twist, by_point = np.zeros((num_joints, 6)), np.zeros((num_points, 3))
    moments = np.zeros((num_members, 2, num_joints * 6))
    point_moments = np.zeros((num_members, 2, num_points * 3))
    for step in range(steps):
        now = rate * 0.5 * (1 + math.cos(math.pi * step / steps))
        for group in range(num_groups):
            for joint in range(num_joints):
                read = of_readings + U((group * num_joints + joint) * num_rows)
                for i in range(num_rows):
                    room[read + U(i)] = q[joint, rows[step, group, i]]
        for b in range(num_members):
            by_twist[:] = 0
            by_point[:] = 0
            for group in range(num_groups):
                length, toucher = ways.length[b, group], ways.toucher[group]
                of_group = of_readings + U(group * num_joints * num_rows)
                for tile in range(num_tiles):
                    at = U(tile) * stride
                    tip = at + U(length) * _KEPT
                    for axis in range(3):
                        p = F(points[b, toucher, axis])
                        for i in range(_T):
                            room[tip + U(axis * TILE) + i] = p
                    for k in range(length - 1, -1, -1):
                        joint = ways.joint[b, group, k]
                        read = of_group + U(joint * num_rows + tile * TILE)
                        _forward(
                            room, at + U(k + 1) * _KEPT, at + U(k) * _KEPT, read,
                            F(ways.sign[b, group, k]), twists[b, joint],
                        )  # fmt: skip
                    for axis in range(3):
                        for i in range(_T):
                            x[axis, tile * TILE + i] = room[at + U(axis * TILE) + i]
                if len(draws.precision) > 0:
                    value = _smooth_criterion(
                        x, slopes, weights, draws.precision, draws.weight[group], work
                    )
                else:
                    value = _criterion(
                        x, slopes, weights, means, within[b, group],
                        draws.num_kernels[group], members, tail, draws.weight[group], work,
                    )  # fmt: skip
                share = max(0.05, 1.0 / (step + 1))
                history[b, group] += share * (value - history[b, group])
                if rate == 0:
                    continue
                used = draws.num_kernels[group] * members
                slopes[:, used:] = 0
                for tile in range((used + TILE - 1) // TILE):
                    at = U(tile) * stride
                    for axis in range(3):
                        for i in range(_T):
                            slope = F(slopes[axis, tile * TILE + i])
                            room[tile_slopes + U(axis * TILE) + i] = slope
                    for k in range(length):
                        joint = ways.joint[b, group, k]
                        read = of_group + U(joint * num_rows + tile * TILE)
                        _backward(
                            room, tile_slopes, at + U(k + 1) * _KEPT, at + U(k) * _KEPT, read,
                            F(ways.sign[b, group, k]), twists[b, joint], by_twist[joint],
                        )  # fmt: skip
                    for axis in range(3):
                        total = F(0)
                        for i in range(_T):
                            total += room[tile_slopes + U(axis * TILE) + i]
                        by_point[toucher, axis] += total
            if rate > 0:
                _descend(
                    twists[b].ravel(), by_twist.ravel(), moments[b, 0], moments[b, 1], now, step
                )
                _descend(
                    points[b].ravel(), by_point.ravel(), point_moments[b, 0], point_moments[b, 1],
                    now, step,
                )  # fmt: skip
    return history
