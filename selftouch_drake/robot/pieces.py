"""Piecewise polynomials in compiled code: a path, the progress along it, and their slopes."""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, PPoly

from selftouch_drake.robot.compiled import compiled, inner


class Pieces(NamedTuple):
    """A function of one variable with D values, a polynomial on each of M pieces.

    Attributes:
        ends: `(M + 1,)` where the pieces start and end.
        terms: `(M, D, n)` coefficients of the powers of the distance from the start of each piece,
            from the 0th on.
    """

    ends: np.ndarray
    terms: np.ndarray

    @staticmethod
    def of_path(path: BSpline) -> Pieces:
        """A clamped B-spline."""
        ends = path.t[path.k : len(path.t) - path.k]
        terms = [path(ends[:-1], power) / factorial(power) for power in range(path.k + 1)]
        return Pieces(ends, np.stack(terms, axis=-1))

    @staticmethod
    def of_progress(progress: PPoly) -> Pieces:
        """A function with one value."""
        return Pieces(progress.x, np.ascontiguousarray(progress.c[::-1].T)[:, None])

    def as_progress(self) -> PPoly:
        """The inverse of `of_progress`."""
        return PPoly(self.terms[:, 0, ::-1].T, self.ends)


@compiled
def follow(path, progress, time_s, s, q, v):
    """Writes a motion along a path, which never goes back.

    Args:
        path: `Pieces` of J joints over path length.
        progress: `Pieces` of path length over time.
        time_s: `(T,)` s, rising.
        s: `(T,)` path length, written.
        q: `(T, J)` positions, written.
        v: `(T, J)` their velocities, written.
    """
    along, at = np.empty((1, 3)), np.empty((path.terms.shape[1], 3))
    part, piece, farthest = np.int64(0), np.int64(0), path.ends[0]
    for i in range(len(time_s)):
        part = _evaluate(progress, time_s[i], part, along)
        farthest = max(farthest, min(along[0, 0], path.ends[-1]))
        piece = _evaluate(path, farthest, piece, at)
        s[i] = farthest
        for joint in range(len(at)):
            q[i, joint], v[i, joint] = at[joint, 0], at[joint, 1] * along[0, 1]


@compiled
def shares_along(path, progress, checks, velocity_limit, acceleration_limit):
    """The largest shares of the limits of velocity and acceleration that any joint uses.

    Args:
        path: `Pieces` of J joints over path length.
        progress: `Pieces` of path length over time.
        checks: number of samples on each piece of the progress.
        velocity_limit: `(J,)`.
        acceleration_limit: `(J,)`.
    """
    along, at = np.empty((1, 3)), np.empty((path.terms.shape[1], 3))
    piece, fastest, hardest = np.int64(0), 0.0, 0.0
    for part in range(len(progress.terms)):
        start, end = progress.ends[part], progress.ends[part + 1]
        last = part == len(progress.terms) - 1
        for check in range(checks + 1 if last else checks):
            _evaluate(progress, start + check * ((end - start) / checks), part, along)
            s = max(path.ends[0], min(along[0, 0], path.ends[-1]))
            piece = _evaluate(path, s, piece, at)
            for joint in range(len(at)):
                speed = at[joint, 1] * along[0, 1]
                rise = at[joint, 2] * along[0, 1] ** 2 + at[joint, 1] * along[0, 2]
                fastest = max(fastest, abs(speed) / velocity_limit[joint])
                hardest = max(hardest, abs(rise) / acceleration_limit[joint])
    return fastest, hardest


@compiled
def averaged(progress, time_s, before, mean):
    """Writes the mean of a function at several times before each time.

    Before its start and after its end, the function stays as it is there.

    Args:
        progress: `Pieces` of one value over time.
        time_s: `(T,)` s.
        before: `(n,)` s.
        mean: `(T,)`, written.
    """
    part = np.int64(0)
    for i in range(len(time_s)):
        total = 0.0
        for earlier in before:
            when = min(max(time_s[i] - earlier, progress.ends[0]), progress.ends[-1])
            part = _piece(progress, when, part)
            away, value = when - progress.ends[part], 0.0
            for power in range(progress.terms.shape[2] - 1, -1, -1):
                value = value * away + progress.terms[part, 0, power]
            total += value
        mean[i] = total / len(before)


@compiled
def clamped(step, value, terms):
    """Writes the cubic spline through evenly spaced values, with slope 0 at both ends.

    Args:
        step: between two values.
        value: `(M + 1,)`.
        terms: `(M, 4)` as of `Pieces`, written.
    """
    num = len(terms)
    # The second derivative is continuous: slope[i - 1] + 4 slope[i] + slope[i + 1] = right.
    slope, share = np.zeros(num + 1), np.zeros(num + 1)
    for i in range(1, num):
        right = 3 * (value[i + 1] - value[i - 1]) / step
        share[i] = 1 / (4 - share[i - 1])
        slope[i] = (right - slope[i - 1]) * share[i]
    for i in range(num - 1, 0, -1):
        slope[i] -= share[i] * slope[i + 1]
    for i in range(num):
        mean = (value[i + 1] - value[i]) / step
        terms[i, 0], terms[i, 1] = value[i], slope[i]
        terms[i, 2] = (3 * mean - 2 * slope[i] - slope[i + 1]) / step
        terms[i, 3] = (slope[i] + slope[i + 1] - 2 * mean) / step**2


@inner
def _piece(function, x, near):
    """The piece that x is on, found from one that is near."""
    while near + 1 < len(function.terms) and x >= function.ends[near + 1]:
        near += 1
    while near > 0 and x < function.ends[near]:
        near -= 1
    return near


@inner
def _evaluate(function, x, piece, out):
    """Writes values and their first and second derivatives at x into `(D, 3)`.

    Returns the piece that x is on; `piece` is near it.
    """
    piece = _piece(function, x, piece)
    away = x - function.ends[piece]
    for d in range(function.terms.shape[1]):
        value = slope = bend = 0.0
        for power in range(function.terms.shape[2] - 1, -1, -1):
            bend = bend * away + slope
            slope = slope * away + value
            value = value * away + function.terms[piece, d, power]
        out[d, 0], out[d, 1], out[d, 2] = value, slope, 2 * bend
    return piece
