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
_C2, _C3, _C4, _C5 = F(1 / 24), F(-1 / 720), F(1 / 40320), F(-1 / 3628800)
_C6 = F(1 / 479001600)
_B3, _B4, _B5 = F(1 / 5040), F(-1 / 362880), F(1 / 39916800)
_D1, _D2, _D3, _D4 = F(-1 / 12), F(1 / 180), F(-1 / 6720), F(1 / 453600)
_E1, _E2, _E3, _E4 = F(-1 / 60), F(1 / 1260), F(-1 / 60480), F(1 / 4989600)


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
            places[out + U(3 * TILE) + i] = t2 * (_HALF - s * (_C2 + s * (_C3 + s * (_C4 + s * _C5))))
            places[out + U(4 * TILE) + i] = (
                t * t2 * (-_S1 - s * (_S2 + s * (-_B3 * F(-1) * F(-1) + s * (-_B4 * F(-1)))))
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
            less = y2 * (_HALF - y2 * (_C2 + y2 * (_C3 + y2 * (_C4 + y2 * (_C5 + y2 * _C6)))))
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
