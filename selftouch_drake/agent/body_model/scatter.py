"""The criterion of one group of touches, and its gradient by their places, compiled.

It is the log-determinant of the scatter of places within kernels, less that of the total scatter:
it has no scale, no place and no handedness, and cannot collapse. Wrong labels ruin a
log-determinant, so the scatter within kernels is that of a Student distribution: each touch has a
weight, and those far away have little. At the best scatter and the best weighted means the gradient
is that of fixed weights.

With few touches, sensations take the place of kernels: places should be a smooth function of them.

What is summed here is summed in double precision, in the order of the code.
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
def _add_square(S, u, r0, r1, r2):
    """Adds u times the square of a vector to the upper half of `(3, 3)` S."""
    S[0, 0] += u * r0 * r0
    S[0, 1] += u * r0 * r1
    S[0, 2] += u * r0 * r2
    S[1, 1] += u * r1 * r1
    S[1, 2] += u * r1 * r2
    S[2, 2] += u * r2 * r2


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
            _add_square(S, u, r0, r1, r2)
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
        _add_square(S, u, r0, r1, r2)
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
    for kernel in range(num_kernels):
        m0, m1, m2 = means[kernel, 0], means[kernel, 1], means[kernel, 2]
        for i in range(kernel * members, (kernel + 1) * members):
            u, r0, r1, r2 = weights[i], x[0, i] - m0, x[1, i] - m1, x[2, i] - m2
            t0, t1, t2 = x[0, i] - center[0], x[1, i] - center[1], x[2, i] - center[2]
            for a in range(3):
                towards_mean = inverse[a, 0] * r0 + inverse[a, 1] * r1 + inverse[a, 2] * r2
                outwards = (
                    total_inverse[a, 0] * t0 + total_inverse[a, 1] * t1 + total_inverse[a, 2] * t2
                )
                slopes[a, i] = u * (inner_factor * towards_mean - outer_factor * outwards)
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
        for b in range(3):
            product = 0.0
            for i in range(count):
                product += x[a, i] * slopes[b, i]
            within[a, b] = product / count
    floor = _FLOOR * (total[0, 0] + total[1, 1] + total[2, 2])
    for a in range(3):
        within[a, a] += floor
        total[a, a] += floor
    value = _invert(within, inverse) - _invert(total, total_inverse)
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
