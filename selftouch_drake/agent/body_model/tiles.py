"""One joint moves a tile of points, and carries slopes back, compiled to vector instructions.

A joint moves each point along its twist (`chain.py`); here the same is in single precision, with
the series of small angles, and with the derivative by hand. Points are kept in tiles of structures
of arrays, because that is what the compiler turns into vector instructions; sums over a tile may be
taken in any order for the same reason, which makes them differ in the last bits between kinds of
processors, as BLAS does.

All tiles are in one array, `room`, and each function is told where in it to read and write: before
a compiled loop runs as vectors it compares the addresses of what it reads and writes, and with
arrays of their own the last bits would depend on where these happen to lie.
"""

import math

import numpy as np

from selftouch_drake.compiled import inner_in_any_order

F, U = np.float32, np.uint64
#: Rows of a tile; draws are padded to a multiple.
TILE = 64
_T = U(TILE)
#: Entries of one tile at one joint: x, y, z, and the factors a1, a2 of the joint after it.
KEPT = U(5 * TILE)

# Numba freezes these. An angle is reduced by a multiple of pi, which is kept in two parts.
_INV_PI, _PI_A, _PI_B = F(1 / math.pi), F(3.140625), F(math.pi - 3.140625)
_HALF, _ONE, _TWO = F(0.5), F(1), F(2)
# Series of sine and of 1 - cosine, on half a turn.
_S1, _S2, _S3, _S4 = F(-1 / 6), F(1 / 120), F(-1 / 5040), F(1 / 362880)
_S5 = F(-1 / 39916800)
_C2, _C3, _C4, _C5, _C6 = F(1 / 24), F(1 / 720), F(1 / 40320), F(1 / 3628800), F(1 / 479001600)
# Series of a1 = (1 - cos) / angle^2 and a2 = (angle - sin) / angle^3 near no angle, and of their
# derivatives.
_A1, _A2, _A3, _A4 = F(1 / 24), F(1 / 720), F(1 / 40320), F(1 / 3628800)
_B0, _B1, _B2, _B3, _B4 = F(1 / 6), F(1 / 120), F(1 / 5040), F(1 / 362880), F(1 / 39916800)
_D1, _D2, _D3, _D4 = F(1 / 12), F(1 / 180), F(1 / 6720), F(1 / 453600)
_E1, _E2, _E3, _E4 = F(1 / 60), F(1 / 1260), F(1 / 60480), F(1 / 4989600)


@inner_in_any_order
def moved_by_joint(room, at, out, read, sign, twist):
    """Moves the points of one tile by one joint: from `at` to `out`, keeping a1 and a2 at `out`.

    Args:
        room: all tiles.
        at: where the `3 x TILE` points begin.
        out: where they are written, and a1 and a2 behind them.
        read: where the `TILE` readings of the joint begin.
        sign: -1 where the joint is passed backwards.
        twist: `(6,)` of the joint.
    """
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
def carried_back(room, slopes, at, out, read, sign, twist, gradient):
    """Carries `dL/dplace` of one tile, at `slopes`, back from `out` to `at`; adds to `gradient`.

    `gradient` is `(6,)`, by the twist; the rest is as in `moved_by_joint`.
    """
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
