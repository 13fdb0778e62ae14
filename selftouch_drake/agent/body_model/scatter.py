"""The criterion of one group of touches, and its gradient by their places, compiled.

It is the log-determinant of the scatter of places within kernels, less that of the total scatter:
it has no scale, no place and no handedness, and cannot collapse. Wrong labels ruin a
log-determinant, so the scatter within kernels is that of a Student distribution: each touch has a
weight, and those far away have little. At the best scatter and the best weighted means the gradient
is that of fixed weights.

With few touches, sensations take the place of kernels: places should be a smooth function of them.

What is summed here is summed in double precision, in the order of the code. Sums are local numbers,
and what a loop only reads is read before it: an array that may overlap with another is read anew at
each turn.
"""

import math
from typing import NamedTuple

import numpy as np

from selftouch_drake.compiled import inner

# Added to both scatters, times the total variance.
_FLOOR = 1e-6
# Rounds of weights at each step; the scatter is carried on from step to step.
_ROUNDS = 2


class Scratch(NamedTuple):
    """Arrays that the criteria fill.

    Attributes:
        weights: `(N,)` of the touches.
        means: `(K, 3)` or more, of the kernels.
        matrices: `(4, 3, 3)`.
    """

    weights: np.ndarray
    means: np.ndarray
    matrices: np.ndarray


@inner
def _invert(S, inverse):
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
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    _means(x, weights, means, num_kernels, members)
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for i in range(kernel * members, (kernel + 1) * members):
            r0, r1, r2, u = x[0, i] - m0, x[1, i] - m1, x[2, i] - m2, weights[i]
            s00 += u * r0 * r0
            s01 += u * r0 * r1
            s02 += u * r0 * r2
            s11 += u * r1 * r1
            s12 += u * r1 * r2
            s22 += u * r2 * r2
    S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2] = s00, s01, s02, s11, s12, s22
    scale = members / (members - 1.0) / count
    for a in range(3):
        for b in range(a, 3):
            S[a, b] *= scale
            S[b, a] = S[a, b]


@inner
def _reweighed(x, weights, means, inverse, num_kernels, members, tail):
    """Weights of a Student distribution; returns the mean of its logarithms."""
    total = 0.0
    v00, v01, v02 = inverse[0, 0], inverse[0, 1], inverse[0, 2]
    v11, v12, v22 = inverse[1, 1], inverse[1, 2], inverse[2, 2]
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for i in range(kernel * members, (kernel + 1) * members):
            r0, r1, r2 = x[0, i] - m0, x[1, i] - m1, x[2, i] - m2
            d = (
                v00 * r0 * r0
                + v11 * r1 * r1
                + v22 * r2 * r2
                + 2 * (v01 * r0 * r1 + v02 * r0 * r2 + v12 * r1 * r2)
            )
            weights[i] = (tail + 3) / (tail + d)
            total += math.log(1 + d / tail)
    return (tail + 3) * total / (num_kernels * members)


@inner
def _spread(x, weights, count, center, S):
    """Weighted mean and scatter of all places."""
    total, c0, c1, c2 = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        u = weights[i]
        total += u
        c0 += u * x[0, i]
        c1 += u * x[1, i]
        c2 += u * x[2, i]
    c0, c1, c2 = c0 / total, c1 / total, c2 / total
    center[0], center[1], center[2] = c0, c1, c2
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        r0, r1, r2, u = x[0, i] - c0, x[1, i] - c1, x[2, i] - c2, weights[i]
        s00 += u * r0 * r0
        s01 += u * r0 * r1
        s02 += u * r0 * r2
        s11 += u * r1 * r1
        s12 += u * r1 * r2
        s22 += u * r2 * r2
    S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2] = s00, s01, s02, s11, s12, s22
    for a in range(3):
        for b in range(a, 3):
            S[a, b] /= total
            S[b, a] = S[a, b]
    return total


@inner
def criterion_of_kernels(x, slopes, within, sizes, tail, factor, scratch):
    """The criterion of one group, and its gradient by the places.

    Args:
        x: `(3, N)` places.
        slopes: `(3, N)` is filled.
        within: `(3, 3)` scatter within kernels that the last step found, all 0 at first; replaced.
        sizes: number of kernels in x, and of members of each.
        tail: degrees of freedom of the Student distribution; 0 for a Gaussian one.
        factor: weight of the group.
        scratch: `Scratch`.
    """
    weights, means, work = scratch
    inverse, total, total_inverse, center = work[0], work[1], work[2], work[3, 0]
    value = _settled(x, within, sizes, tail, scratch) - _invert(total, total_inverse)
    num_kernels, members = sizes
    count = num_kernels * members
    mass = 0.0
    for i in range(count):
        mass += weights[i]
    inner_factor = 2 * factor * members / (members - 1.0) / count
    outer_factor = 2 * factor / mass
    c0, c1, c2 = center[0], center[1], center[2]
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for a in range(3):
            v0, v1, v2 = inverse[a, 0], inverse[a, 1], inverse[a, 2]
            w0, w1, w2 = total_inverse[a, 0], total_inverse[a, 1], total_inverse[a, 2]
            for i in range(kernel * members, (kernel + 1) * members):
                towards_mean = v0 * (x[0, i] - m0) + v1 * (x[1, i] - m1) + v2 * (x[2, i] - m2)
                outwards = w0 * (x[0, i] - c0) + w1 * (x[1, i] - c1) + w2 * (x[2, i] - c2)
                slopes[a, i] = weights[i] * (inner_factor * towards_mean - outer_factor * outwards)
    return value


@inner
def _settled(x, within, sizes, tail, scratch):
    """Turns weights and scatters to fit each other; returns the criterion but for the total.

    It fills all of `scratch`: weights, means, and as matrices the inverse of the scatter within
    kernels, the total scatter, and at last the centre of all places; `within` is replaced.
    """
    num_kernels, members = sizes
    count = num_kernels * members
    weights, means, work = scratch
    inverse, total, center = work[0], work[1], work[3, 0]
    weights[:count] = 1.0
    rounds = 1
    if tail > 0:
        rounds += _ROUNDS
        if within[0, 0] > 0:
            # The scatter of the last step, around plain means, tells far touches at once.
            _means(x, weights, means, num_kernels, members)
            _invert(within, inverse)
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
        log_within = _invert(within, inverse)
        if tail > 0:
            far = _reweighed(x, weights, means, inverse, num_kernels, members, tail)
    return log_within + far


@inner
def _applied(precision, x, out):
    """The symmetric precision times the places, `(3, N)` both."""
    number = len(precision)
    whole = number - number % 4
    x0, x1, x2, out0, out1, out2 = x[0], x[1], x[2], out[0], out[1], out[2]
    out[:, :number] = 0.0
    # Four rows at once, so that sums are read and written a quarter as often: each keeps its order,
    # and the loop still becomes vectors.
    for i in range(0, whole, 4):
        a, b, c, d = precision[i], precision[i + 1], precision[i + 2], precision[i + 3]
        a0, b0, c0, d0 = x0[i], x0[i + 1], x0[i + 2], x0[i + 3]
        a1, b1, c1, d1 = x1[i], x1[i + 1], x1[i + 2], x1[i + 3]
        a2, b2, c2, d2 = x2[i], x2[i + 1], x2[i + 2], x2[i + 3]
        for j in range(number):
            out0[j] = out0[j] + a[j] * a0 + b[j] * b0 + c[j] * c0 + d[j] * d0
            out1[j] = out1[j] + a[j] * a1 + b[j] * b1 + c[j] * c1 + d[j] * d1
            out2[j] = out2[j] + a[j] * a2 + b[j] * b2 + c[j] * c2 + d[j] * d2
    for i in range(whole, number):
        row, a0, a1, a2 = precision[i], x0[i], x1[i], x2[i]
        for j in range(number):
            out0[j] += row[j] * a0
            out1[j] += row[j] * a1
            out2[j] += row[j] * a2


@inner
def criterion_of_sensations(x, slopes, precision, factor, scratch):
    """The criterion of places that should be smooth in the sensations, and its gradient.

    Args:
        x: `(3, N)` places.
        slopes: `(3, N)` is filled.
        precision: `(N, N)`, as in `Draws`.
        factor: weight of the group.
        scratch: `Scratch`.
    """
    weights, work = scratch.weights, scratch.matrices
    count = len(precision)
    within, inverse, total, total_inverse = work[0], work[1], work[2], work[3]
    center = np.zeros(3)
    weights[:count] = 1.0
    _spread(x, weights, count, center, total)
    _applied(precision, x, slopes)
    for a in range(3):
        p0, p1, p2 = 0.0, 0.0, 0.0
        for i in range(count):
            p0 += x[a, i] * slopes[0, i]
            p1 += x[a, i] * slopes[1, i]
            p2 += x[a, i] * slopes[2, i]
        within[a, 0], within[a, 1], within[a, 2] = p0 / count, p1 / count, p2 / count
    floor = _FLOOR * (total[0, 0] + total[1, 1] + total[2, 2])
    for a in range(3):
        within[a, a] += floor
        total[a, a] += floor
    value = _invert(within, inverse) - _invert(total, total_inverse)
    step = 2 * factor / count
    v00, v01, v02 = inverse[0, 0], inverse[0, 1], inverse[0, 2]
    v11, v12, v22 = inverse[1, 1], inverse[1, 2], inverse[2, 2]
    w00, w01, w02 = total_inverse[0, 0], total_inverse[0, 1], total_inverse[0, 2]
    w11, w12, w22 = total_inverse[1, 1], total_inverse[1, 2], total_inverse[2, 2]
    c0, c1, c2 = center[0], center[1], center[2]
    for i in range(count):
        s0, s1, s2 = slopes[0, i], slopes[1, i], slopes[2, i]
        t0, t1, t2 = x[0, i] - c0, x[1, i] - c1, x[2, i] - c2
        slopes[0, i] = step * ((v00 * s0 + v01 * s1 + v02 * s2) - (w00 * t0 + w01 * t1 + w02 * t2))
        slopes[1, i] = step * ((v01 * s0 + v11 * s1 + v12 * s2) - (w01 * t0 + w11 * t1 + w12 * t2))
        slopes[2, i] = step * ((v02 * s0 + v12 * s1 + v22 * s2) - (w02 * t0 + w12 * t1 + w22 * t2))
    return value
