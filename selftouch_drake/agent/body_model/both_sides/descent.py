"""Many hypotheses of a body at once: their loss, its slopes by hand, and Adam, compiled.

A hypothesis is one row of numbers: `(J, 3)` axes, `(J, 3)` points on the axes, then for each *end*
(a skin, or a single point such as a fingertip) the `(K, 3)` coefficients of its places. Its *order*
says which column of the readings turns which of its joints.

The loss of a hypothesis is a sum of

- for each posture of each recording, twice its weight times `log(1 + (r / (g sigma))^2)`, where r
  is the distance of what touched from what was touched and g the unit of length, by which the
  grain of all skins together is met;
- for each skin, how far distances of receptors are off their grain (a pseudo-Huber loss of
  logarithms), and how much nearer than a contact those lie that share no touch;
- small costs of coefficients and of far centres, and one that holds g at 1.
"""

import math
from typing import NamedTuple

import numpy as np

from selftouch_drake.compiled import compiled, inner, inner_in_any_order

F = np.float32
# Scatter of single pairs about the grain, as a logarithm: most are within a factor of 1.7.
SCATTER = 0.35
# Weight of the grain for each receptor, and of receptors that lie too near, relative to it.
GRAIN, TOO_NEAR = 3.0, 0.5
# Costs of coefficients, of the points on axes, and of a unit that is not 1.
COEFFICIENT, CENTRE, UNIT = 0.02, 0.002, 500.0
# Twice the weight of a posture.
_POSTURE = F(2)
# Losses are told in hundreds.
SCALE = 0.01
# Adam's usual constants.
_BETA1, _BETA2, _TINY = 0.9, 0.999, 1e-8


class Data(NamedTuple):
    """What all hypotheses are compared with.

    Attributes:
        cos: `(J, N)` float32 cosines of the readings of all postures of all recordings.
        sin: `(J, N)` float32.
        share: `(2, K, N)` float32 mean basis of the receptors felt above and below.
        weight: `(N,)` float32 of each posture.
        begin: `(R + 1,)` where each recording begins among the postures.
        ends: `(R, 2)` the ends that met in each recording.
        way: `(E, L)` joints from the trunk to each end, padded.
        length: `(E,)` number of joints on the way.
        offset: `(E,)` where the coefficients of an end begin in a row.
        size: `(E,)` number of its coefficients.
        basis: `(E, K, n)` float32 of the receptors of each skin; zeros for a point.
        number: `(E,)` receptors; 0 for a point.
        near: `(m, 2)` pairs of receptors of all skins.
        spacing: `(m,)` float32 logarithm of their distance by the grain.
        far: `(k, 2)` pairs that share no touch.
        used: `(J,)` whether any recording has the joint on its ways.
    """

    cos: np.ndarray
    sin: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    begin: np.ndarray
    ends: np.ndarray
    way: np.ndarray
    length: np.ndarray
    offset: np.ndarray
    size: np.ndarray
    basis: np.ndarray
    number: np.ndarray
    near: np.ndarray
    spacing: np.ndarray
    far: np.ndarray
    used: np.ndarray


class _Room(NamedTuple):
    """Room to work in.

    Attributes:
        kept: `(2, L, 3, N)` points before each turn, relative to its centre.
        point: `(2, 3, N)` points, then slopes.
        axis: `(J, 3)` unit axes.
        by_axis: `(J, 3)` slopes by them.
        place: `(E, 3, n)` of receptors.
        by_place: `(E, 3, n)` slopes by them.
        off: `(E, 3, m)` logarithms of drawn distances, less those of the grain.
    """

    kept: np.ndarray
    point: np.ndarray
    axis: np.ndarray
    by_axis: np.ndarray
    place: np.ndarray
    by_place: np.ndarray
    off: np.ndarray


@inner
def _room(data, drawn):
    num_joints, num_ends = len(data.cos), len(data.size)
    longest, most = data.way.shape[1], 0
    for r in range(len(data.ends)):
        most = max(most, data.begin[r + 1] - data.begin[r])
    return _Room(
        np.empty((2, longest, 3, most), F),
        np.empty((2, 3, most), F),
        np.empty((num_joints, 3), F),
        np.empty((num_joints, 3), F),
        np.empty((num_ends, 3, data.basis.shape[2]), F),
        np.empty((num_ends, 3, data.basis.shape[2]), F),
        np.empty((num_ends, 3, drawn), F),
    )


@inner_in_any_order
def _mixed(coefficients, share, first, number, out):
    """Writes places: flat coefficients `(K, 3)`, times `number` columns of shares `(K, N)`."""
    size = len(coefficients) // 3
    for axis in range(3):
        row = out[axis]
        for n in range(number):
            row[n] = F(0)
        for k in range(size):
            c, own = F(coefficients[3 * k + axis]), share[k, first : first + number]
            for n in range(number):
                row[n] += c * own[n]


@inner_in_any_order
def _mixed_back(slopes, share, first, number, by_coefficient):
    size = len(by_coefficient) // 3
    for axis in range(3):
        row = slopes[axis]
        for k in range(size):
            total, own = F(0), share[k, first : first + number]
            for n in range(number):
                total += row[n] * own[n]
            by_coefficient[3 * k + axis] += total


@inner_in_any_order
def _turn(point, kept, n0, n1, n2, c0, c1, c2, cos, sin):
    """Turns `(3, N)` points about an axis; keeps them relative to its centre."""
    px, py, pz = point[0], point[1], point[2]
    kx, ky, kz = kept[0], kept[1], kept[2]
    for n in range(len(cos)):
        x, y, z, c, s = px[n] - c0, py[n] - c1, pz[n] - c2, cos[n], sin[n]
        kx[n], ky[n], kz[n] = x, y, z
        along = (x * n0 + y * n1 + z * n2) * (F(1) - c)
        px[n] = c0 + x * c + (n1 * z - n2 * y) * s + n0 * along
        py[n] = c1 + y * c + (n2 * x - n0 * z) * s + n1 * along
        pz[n] = c2 + z * c + (n0 * y - n1 * x) * s + n2 * along


@inner_in_any_order
def _turn_back(slope, kept, n0, n1, n2, cos, sin, by_axis, by_centre):
    """Carries slopes `(3, N)` back through a turn; adds to those by its axis and its centre."""
    gx, gy, gz = slope[0], slope[1], slope[2]
    kx, ky, kz = kept[0], kept[1], kept[2]
    s0, s1, s2, t0, t1, t2 = F(0), F(0), F(0), F(0), F(0), F(0)
    for n in range(len(cos)):
        x, y, z, g0, g1, g2 = kx[n], ky[n], kz[n], gx[n], gy[n], gz[n]
        c, s = cos[n], sin[n]
        rest = F(1) - c
        across = (g0 * n0 + g1 * n1 + g2 * n2) * rest
        along = (x * n0 + y * n1 + z * n2) * rest
        t0 += s * (y * g2 - z * g1) + along * g0 + across * x
        t1 += s * (z * g0 - x * g2) + along * g1 + across * y
        t2 += s * (x * g1 - y * g0) + along * g2 + across * z
        h0 = g0 * c - s * (n1 * g2 - n2 * g1) + n0 * across
        h1 = g1 * c - s * (n2 * g0 - n0 * g2) + n1 * across
        h2 = g2 * c - s * (n0 * g1 - n1 * g0) + n2 * across
        s0 += g0 - h0
        s1 += g1 - h1
        s2 += g2 - h2
        gx[n], gy[n], gz[n] = h0, h1, h2
    by_axis[0] += t0
    by_axis[1] += t1
    by_axis[2] += t2
    by_centre[0] += s0
    by_centre[1] += s1
    by_centre[2] += s2


@inner
def _carried(row, order, data, room, recording, num):
    """Writes where both ends of a recording are, in the trunk's frame."""
    num_joints, first = len(data.cos), data.begin[recording]
    for side in range(2):
        end = data.ends[recording, side]
        offset, point = data.offset[end], room.point[side]
        _mixed(row[offset : offset + 3 * data.size[end]], data.share[side], first, num, point)
        for k in range(data.length[end] - 1, -1, -1):
            joint = data.way[end, k]
            axis, centre, read = room.axis[joint], 3 * (num_joints + joint), order[joint]
            _turn(
                point, room.kept[side, k], axis[0], axis[1], axis[2],
                F(row[centre]), F(row[centre + 1]), F(row[centre + 2]),
                data.cos[read, first : first + num], data.sin[read, first : first + num],
            )  # fmt: skip


@inner
def _compared(data, room, recording, num, inverse):
    """Loss of a recording, its slope by `inverse`, and slopes in place of the points."""
    a, b = room.point[0], room.point[1]
    first, loss, by_inverse = data.begin[recording], 0.0, 0.0
    for n in range(num):
        x, y, z = a[0, n] - b[0, n], a[1, n] - b[1, n], a[2, n] - b[2, n]
        r2 = x * x + y * y + z * z
        q, weight = F(1) + r2 * inverse, _POSTURE * data.weight[first + n]
        loss += weight * math.log(q)
        slope = weight / q
        by_inverse += slope * r2
        slope *= F(2) * inverse
        a[0, n], a[1, n], a[2, n] = slope * x, slope * y, slope * z
        b[0, n], b[1, n], b[2, n] = -slope * x, -slope * y, -slope * z
    return loss, by_inverse


@inner
def _carried_back(order, data, room, recording, num, slopes):
    num_joints, first = len(data.cos), data.begin[recording]
    for side in range(2):
        end = data.ends[recording, side]
        offset, slope = data.offset[end], room.point[side]
        for k in range(data.length[end]):
            joint = data.way[end, k]
            axis, centre, read = room.axis[joint], 3 * (num_joints + joint), order[joint]
            _turn_back(
                slope, room.kept[side, k], axis[0], axis[1], axis[2],
                data.cos[read, first : first + num], data.sin[read, first : first + num],
                room.by_axis[joint], slopes[centre : centre + 3],
            )  # fmt: skip
        own = slopes[offset : offset + 3 * data.size[end]]
        _mixed_back(slope, data.share[side], first, num, own)


@inner
def _log_distances(place, pairs, drawn, shift, out):
    """Writes logarithms of drawn distances, less `shift` of the pair."""
    for i in range(len(drawn)):
        first, second = pairs[drawn[i], 0], pairs[drawn[i], 1]
        x, y = place[0, first] - place[0, second], place[1, first] - place[1, second]
        z = place[2, first] - place[2, second]
        out[i] = math.log(math.sqrt(x * x + y * y + z * z + F(1e-12)) + F(1e-3))
        if len(shift) > 0:
            out[i] -= shift[drawn[i]]


@inner
def _log_distance_back(place, first, second, slope, by_place):
    x, y = place[0, first] - place[0, second], place[1, first] - place[1, second]
    z = place[2, first] - place[2, second]
    distance = math.sqrt(x * x + y * y + z * z + F(1e-12))
    slope = F(slope) / (distance * (distance + F(1e-3)))
    by_place[0, first] += slope * x
    by_place[1, first] += slope * y
    by_place[2, first] += slope * z
    by_place[0, second] -= slope * x
    by_place[1, second] -= slope * y
    by_place[2, second] -= slope * z


@inner
def _unit(row, data, draws, room):
    """Logarithm of the unit of length: by how much all skins are larger than their grain."""
    none = np.empty(0, F)
    unit, skins = 0.0, 0
    for end in range(len(data.size)):
        if data.number[end] == 0:
            continue
        offset, place, number = data.offset[end], room.place[end], data.number[end]
        _mixed(row[offset : offset + 3 * data.size[end]], data.basis[end], 0, number, place)
        for kind in range(2):
            drawn = draws[end, kind]
            _log_distances(place, data.near, drawn, data.spacing, room.off[end, kind])
        _log_distances(place, data.far, draws[end, 2], none, room.off[end, 2])
        unit += np.float64(room.off[end, 0].mean())
        skins += 1
    return unit / max(skins, 1), skins


@inner
def _grain(end, data, draws, room, unit):
    """Loss of a skin's grain, its slope by the unit, and slopes in place of `room.off`."""
    off, weight = room.off[end], GRAIN * data.number[end]
    drawn = off.shape[1]
    loss, by_unit = 0.0, 0.0
    for kind in range(2):
        for i in range(drawn):
            u = (off[kind, i] - unit) / SCATTER
            root = math.sqrt(1 + u * u)
            loss += weight * (root - 1) / (2 * drawn)
            slope = weight * u / (root * SCATTER) / (2 * drawn)
            by_unit -= slope
            off[kind, i] = slope
    for i in range(drawn):
        lacking, slope = unit - off[2, i], TOO_NEAR * weight / SCATTER / drawn
        if len(data.far) == 0 or lacking <= 0:
            off[2, i] = 0
            continue
        loss += slope * lacking
        by_unit += slope
        off[2, i] = -slope
    return loss, by_unit


@inner
def _grain_back(end, data, draws, room, by_unit, slopes):
    off, place, by_place = room.off[end], room.place[end], room.by_place[end]
    by_place[:] = 0
    for kind in range(2):
        extra = by_unit if kind == 0 else 0.0
        for i in range(off.shape[1]):
            pair = data.near[draws[end, kind, i]]
            _log_distance_back(place, pair[0], pair[1], off[kind, i] + extra, by_place)
    for i in range(off.shape[1]):
        if off[2, i] != 0:
            pair = data.far[draws[end, 2, i]]
            _log_distance_back(place, pair[0], pair[1], off[2, i], by_place)
    own = slopes[data.offset[end] : data.offset[end] + 3 * data.size[end]]
    _mixed_back(by_place, data.basis[end], 0, data.number[end], own)


@inner
def _costs(row, data, inverse_unit2, slopes):
    """Costs of coefficients and centres, with their slope by the unit."""
    cost, num_joints = 0.0, len(data.cos)
    for end in range(len(data.size)):
        if data.number[end] > 0:
            for i in range(data.offset[end] + 3, data.offset[end] + 3 * data.size[end]):
                cost += COEFFICIENT * row[i] * row[i] * inverse_unit2
                slopes[i] += 2 * COEFFICIENT * row[i] * inverse_unit2
    for joint in range(num_joints):
        if data.used[joint]:
            for i in range(3 * (num_joints + joint), 3 * (num_joints + joint) + 3):
                cost += CENTRE * row[i] * row[i] * inverse_unit2
                slopes[i] += 2 * CENTRE * row[i] * inverse_unit2
    return cost, -2 * cost


@inner
def _loss(row, order, data, draws, sigma, room, slopes, parts):
    """Loss of one hypothesis; fills in its slopes, and the loss of each recording in `parts`."""
    num_joints = len(data.cos)
    slopes[:] = 0
    room.by_axis[:] = 0
    for joint in range(num_joints):
        x, y, z = row[3 * joint], row[3 * joint + 1], row[3 * joint + 2]
        norm = math.sqrt(x * x + y * y + z * z)
        room.axis[joint, 0] = x / norm
        room.axis[joint, 1] = y / norm
        room.axis[joint, 2] = z / norm
    unit, skins = _unit(row, data, draws, room)
    inverse_unit2 = math.exp(-2 * unit)
    inverse = F(inverse_unit2 / sigma**2)
    loss, by_inverse = 0.0, 0.0
    for recording in range(len(data.ends)):
        num = data.begin[recording + 1] - data.begin[recording]
        _carried(row, order, data, room, recording, num)
        own, slope = _compared(data, room, recording, num, inverse)
        _carried_back(order, data, room, recording, num, slopes)
        parts[recording] = own / max(num, 1)
        loss += own
        by_inverse += slope
    cost, by_unit = _costs(row, data, inverse_unit2, slopes)
    loss += cost + UNIT * unit * unit
    by_unit += 2 * UNIT * unit - 2 * inverse * by_inverse
    for end in range(len(data.size)):
        if data.number[end] > 0:
            own, slope = _grain(end, data, draws, room, unit)
            loss += own
            by_unit += slope
    for end in range(len(data.size)):
        if data.number[end] > 0:
            share = by_unit / (skins * draws.shape[2])
            _grain_back(end, data, draws, room, share, slopes)
    for joint in range(num_joints):
        axis, by = room.axis[joint], room.by_axis[joint]
        along = by[0] * axis[0] + by[1] * axis[1] + by[2] * axis[2]
        own = row[3 * joint : 3 * joint + 3]
        norm = math.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
        for i in range(3):
            slopes[3 * joint + i] += (by[i] - along * axis[i]) / norm
    for i in range(len(slopes)):
        slopes[i] *= F(SCALE)
    return SCALE * loss


@compiled
def losses(rows, orders, data, draws, sigma, slopes, parts):
    """`(B,)` losses of hypotheses; fills in slopes `(B, P)` and the loss per posture `(B, R)`.

    Args:
        rows: `(B, P)` float32 hypotheses.
        orders: `(B, J)` column of the readings that turns each joint.
        data: what they are compared with.
        draws: `(E, 3, m)` pairs of receptors that are looked at: near ones by trust, near ones
            alike, and far ones.
        sigma: scale of the residuals, in diameters of a contact.
        slopes: filled in.
        parts: filled in.
    """
    room = _room(data, draws.shape[2])
    out = np.empty(len(rows))
    for b in range(len(rows)):
        out[b] = _loss(rows[b], orders[b], data, draws, sigma, room, slopes[b], parts[b])
    return out


@compiled
def descend(rows, orders, data, draws, rates, sigmas, free):
    """Moves hypotheses downhill by Adam, in place.

    Args:
        rows: `(B, P)` float32 hypotheses; changed.
        orders: `(B, J)`.
        data: what they are compared with.
        draws: `(steps, E, 3, m)` pairs of receptors for each step.
        rates: `(steps,)` rate of each step.
        sigmas: `(steps,)` scale of the residuals in each step.
        free: `(P,)` whether a number may change.
    """
    room = _room(data, draws.shape[3])
    number = rows.shape[1]
    slopes, parts = np.empty(number, F), np.empty(len(data.ends))
    for b in range(len(rows)):
        mean, square, row = np.zeros(number), np.zeros(number), rows[b]
        for step in range(len(rates)):
            _loss(row, orders[b], data, draws[step], sigmas[step], room, slopes, parts)
            c1, c2 = 1 - _BETA1 ** (step + 1), 1 - _BETA2 ** (step + 1)
            for i in range(number):
                if free[i]:
                    mean[i] = _BETA1 * mean[i] + (1 - _BETA1) * slopes[i]
                    square[i] = _BETA2 * square[i] + (1 - _BETA2) * slopes[i] ** 2
                    row[i] -= rates[step] * (mean[i] / c1) / (math.sqrt(square[i] / c2) + _TINY)
