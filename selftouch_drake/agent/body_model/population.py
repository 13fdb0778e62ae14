"""Many hypotheses of a body at once: the criterion, its gradient by hand, and Adam, compiled.

A member of a population has twists, points of its touchers, and its own way from each group of
touches to what touched: so orders of joints compete. A *group* is a set of kernels that one toucher
touched on one part. Its criterion is the log-determinant of the scatter of places within kernels,
less that of the total scatter: it has no scale, no place and no handedness, and cannot collapse.

Wrong labels ruin a log-determinant, so the scatter within kernels is that of a Student
distribution: each touch has a weight, and those far away have little. At the best scatter and
the best weighted means the gradient is that of fixed weights.

Places are kept in tiles of structures of arrays, in single precision, because that is what the
compiler turns into vector instructions; sums may be taken in any order for the same reason, which
makes them differ in the last bits between kinds of processors, as BLAS does.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_SUMS = {"reassoc", "contract", "nsz", "arcp"}
_kernel = numba.njit(**_OPTIONS, fastmath=_SUMS)
_inner = numba.njit(**(_OPTIONS | {"no_cpython_wrapper": True}), fastmath=_SUMS)

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
    """

    q: np.ndarray
    rows: np.ndarray
    num_kernels: np.ndarray
    members: int
    weight: np.ndarray


@_inner
def _forward(places, readings, at, out, read, sign, twist):
    """Moves the points of one tile by one joint: from `at` to `out`, keeping a1 and a2 at `out`."""
    w0, w1, w2 = F(twist[0]), F(twist[1]), F(twist[2])
    v0, v1, v2 = F(twist[3]), F(twist[4]), F(twist[5])
    n2 = w0 * w0 + w1 * w1 + w2 * w2
    n = F(math.sqrt(n2))
    largest = F(0)
    for i in range(_T):
        largest = max(largest, abs(readings[read + i]))
    if n * largest < _ONE:
        for i in range(_T):
            t = sign * readings[read + i]
            t2 = t * t
            s = t2 * n2
            places[out + U(3 * TILE) + i] = t2 * (_HALF - s * (_A1 - s * (_A2 - s * (_A3 - s * _A4))))
            places[out + U(4 * TILE) + i] = (
                t * t2 * (_B0 - s * (_B1 - s * (_B2 - s * (_B3 - s * _B4))))
            )
    else:
        i2 = _ONE / n2
        i3 = i2 / n
        for i in range(_T):
            angle = n * sign * readings[read + i]
            k = F(math.floor(angle * _INV_PI + _HALF))
            y = (angle - k * _PI_A) - k * _PI_B
            flip = _ONE - _TWO * (k - _TWO * F(math.floor(k * _HALF)))
            y2 = y * y
            sine = flip * y * (_ONE + y2 * (_S1 + y2 * (_S2 + y2 * (_S3 + y2 * (_S4 + y2 * _S5)))))
            less = y2 * (_HALF - y2 * (_C2 - y2 * (_C3 - y2 * (_C4 - y2 * (_C5 - y2 * _C6)))))
            places[out + U(3 * TILE) + i] = (_ONE - flip + flip * less) * i2
            places[out + U(4 * TILE) + i] = (angle - sine) * i3
    for i in range(_T):
        t = sign * readings[read + i]
        x, y, z = places[at + i], places[at + _T + i], places[at + U(2 * TILE) + i]
        a1, a2 = places[out + U(3 * TILE) + i], places[out + U(4 * TILE) + i]
        u0 = w1 * z - w2 * y + v0
        u1 = w2 * x - w0 * z + v1
        u2 = w0 * y - w1 * x + v2
        c0, c1, c2 = w1 * u2 - w2 * u1, w2 * u0 - w0 * u2, w0 * u1 - w1 * u0
        places[out + i] = x + t * u0 + a1 * c0 + a2 * (w1 * c2 - w2 * c1)
        places[out + _T + i] = y + t * u1 + a1 * c1 + a2 * (w2 * c0 - w0 * c2)
        places[out + U(2 * TILE) + i] = z + t * u2 + a1 * c2 + a2 * (w0 * c1 - w1 * c0)


@_inner
def _backward(places, readings, slopes, at, out, read, sign, twist, gradient):
    """Carries `dL/dplace` of one tile, in `slopes`, back from `out` to `at`; adds to `gradient`."""
    w0, w1, w2 = F(twist[0]), F(twist[1]), F(twist[2])
    v0, v1, v2 = F(twist[3]), F(twist[4]), F(twist[5])
    n2 = w0 * w0 + w1 * w1 + w2 * w2
    n = F(math.sqrt(n2))
    largest = F(0)
    for i in range(_T):
        largest = max(largest, abs(readings[read + i]))
    series = n * largest < _ONE
    i2 = _ONE / max(n2, F(1e-20))
    m0, m1, m2, e0, e1, e2 = F(0), F(0), F(0), F(0), F(0), F(0)
    first, second = F(0), F(0)
    for i in range(_T):
        t = sign * readings[read + i]
        x, y, z = places[at + i], places[at + _T + i], places[at + U(2 * TILE) + i]
        a1, a2 = places[out + U(3 * TILE) + i], places[out + U(4 * TILE) + i]
        g0, g1, g2 = slopes[i], slopes[_T + i], slopes[U(2 * TILE) + i]
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
        slopes[i] = g0 + h1 * w2 - h2 * w1
        slopes[_T + i] = g1 + h2 * w0 - h0 * w2
        slopes[U(2 * TILE) + i] = g2 + h0 * w1 - h1 * w0
    first += second
    gradient[0] += m0 + first * w0
    gradient[1] += m1 + first * w1
    gradient[2] += m2 + first * w2
    gradient[3] += e0
    gradient[4] += e1
    gradient[5] += e2


@_inner
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


@_inner
def _scatter(x, weights, means, num_kernels, members, tail, S, inverse):
    """One round of weighted means and scatter; returns the criterion of the scatter within."""
    count = num_kernels * members
    S[:] = 0.0
    for kernel in range(num_kernels):
        total, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0
        for i in range(kernel * members, (kernel + 1) * members):
            u = weights[i]
            total += u
            m0 += u * x[0, i]
            m1 += u * x[1, i]
            m2 += u * x[2, i]
        m0, m1, m2 = m0 / total, m1 / total, m2 / total
        means[kernel, 0], means[kernel, 1], means[kernel, 2] = m0, m1, m2
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
