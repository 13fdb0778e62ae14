"""Changes of a way that touches decide, and the receptors' places: robust least squares.

Offsets of joints are always looked for. Other numbers are taken one at a time, the one that explains
most first, until all that are left would explain no more than chance does. Changes that no touch
shows, given those that are taken already, stay as they are: a skin whose receptors are unknown tells
no length, and not where it lies itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from selftouch_drake.agent.given_model.fields import Fields
from selftouch_drake.agent.given_model.skin import TouchedSkin
from selftouch_drake.agent.given_model.way import Change, GivenWay

#: rad and m, within which changes are expected. Those that touches leave wider than the second
#: numbers cannot be observed.
_EXPECTED, _UNOBSERVABLE = {True: 0.3, False: 0.1}, {True: 0.02, False: 0.01}
# Receptors that hardly any touch felt are within a metre of where they are looked for.
_NEAR = 1.0
# Residuals are scaled, and neighbours are looked for, so many times; each time steps are taken.
_NUM_ROUNDS, _NUM_STEPS = 8, 12
# How often changes are added, and rounds after each addition.
_MOST_ADDITIONS, _ADDED_ROUNDS = 4, 3
#: All that is left explains more than chance if that is less likely.
_CHANCE = 1e-4
# Square of the share of its motion that a change has for itself, beside others and similarities:
# below it, it is none. Rounding leaves 1e-9.
_STILL = 1e-3
# What explains less, in squares of standard errors, is no reason to prefer a change to others.
_WORTH = 4.0
#: A receptor is suspected whose residuals are so many times the usual ones.
_SUSPECT = 4.0
#: By how much errors exceed what residuals tell, since the model of fields is not exact: measured
#: on a torus and a turning torus, three sets of 300 touches each.
_MODEL_ERROR = 2.4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refit:
    """What touches say of a way and of S receptors.

    Attributes:
        way: as it was refitted.
        changes: C that were looked for.
        amounts: `(C,)` rad or m.
        sigma: `(C,)` standard errors, as if what is not looked for were as it is given.
        untold: changes that no touch shows beside the others.
        places: `(S, 3)` m, receptors in the frame of their link.
        place_sigma: `(S, 3)` standard errors.
        normals: `(S, 3)` outward normals of the skin there.
        suspect: `(S,)` bool, receptors whose readings do not fit their place.
    """

    way: GivenWay
    changes: Sequence[Change]
    amounts: np.ndarray
    sigma: np.ndarray
    untold: Sequence[Change]
    places: np.ndarray
    place_sigma: np.ndarray
    normals: np.ndarray
    suspect: np.ndarray


def refitted(
    way: GivenWay, q: np.ndarray, sensation: np.ndarray, radius: float, verbose=False
) -> Refit:
    """Refits a way.

    Args:
        way: as it is given.
        q: `(n, L)` rad or m, as its joints were read.
        sensation: `(n, S)` readings; each row and each column has one above 0.
        radius: m, of the ball that touches.
    """
    every = way.changes()
    skin = TouchedSkin(q, radius, sensation.sum(axis=1), way)
    fields = Fields.of(way, [change for change in every if change.is_offset], skin, sensation)
    v = _fitted(fields, fields.start(), _NUM_ROUNDS)
    offsets, untold = _told(fields, v, every, offsets_alone=True)
    fields = Fields.of(way, offsets, skin, sensation)
    v = _fitted(fields, fields.start(), _NUM_ROUNDS)
    for _ in range(_MOST_ADDITIONS):
        looked_for, untold = _told(fields, v, every, verbose=verbose)
        if {id(c) for c in looked_for} == {id(c) for c in fields.changes}:
            break
        scales, near = fields.scales, fields.skin
        fields = Fields.of(way, looked_for, near, sensation)
        fields.scales = scales
        v = _fitted(fields, fields.start(), _NUM_ROUNDS)
    return _summed_up(fields, v, untold)


def _prior(fields: Fields) -> np.ndarray:
    """`(P,)` inverse variances of what is expected of the unknowns."""
    changes = [_EXPECTED[change.turns] ** -2 for change in fields.changes]
    places = np.full(3 * fields.num_receptors, _NEAR**-2)
    return np.r_[changes, 0.0, 0.0, places, np.zeros(len(fields.skin.q))]


def _fitted(fields: Fields, v: np.ndarray, rounds: int) -> np.ndarray:
    prior = _prior(fields)
    for _ in range(rounds):
        v = fields.minimised(v, prior, _NUM_STEPS)
        fields.rescaled(v)
    return v


def _told(
    fields: Fields, v: np.ndarray, every: Sequence[Change], *, offsets_alone: bool = False, verbose=False
) -> tuple[list[Change], list[Change]]:
    """The changes that touches tell: those of now, and those that are needed; and the untold.

    All is judged by the equations of now, as if they were linear, in units of the standard errors
    beyond which nothing is observed: there, a change that is observed has more than 1.

    Args:
        fields: with the changes of now.
        v: its unknowns.
        every: all changes.
        offsets_alone: asks which offsets can be observed, whether they are needed or not.
    """
    wide, v = fields.with_changes(v, every)
    matrix, toward, squares = wide.normal(v, _prior(wide))
    number = len(every)
    rest = cho_factor(matrix[number:, number:])
    across = cho_solve(rest, matrix[number:, :number])
    unit = np.array([_UNOBSERVABLE[change.turns] for change in every])
    F = matrix[:number, :number] - matrix[:number, number:] @ across
    F *= unit[:, None] * unit
    g = unit * (toward[:number] - across.T @ toward[number:])
    free = max(2 * len(fields.touch) - len(v), 1) / _MODEL_ERROR**2
    # Judged by what all changes together would leave.
    rough = free / squares
    error = (squares - rough * _explained(F * rough, g)[0]) / free
    F, g = F / error, g / error
    G = _moves(wide, v)
    keep = {id(c) for c in fields.changes if c.is_offset} if not offsets_alone else set()
    # As if no change had been made yet.
    g = g - F @ (wide.parted(v)[0] / unit)
    chosen: list[int] = []
    for n in [n for n, change in enumerate(every) if id(change) in keep]:
        F, g = _swept(F, g, n)
        G = _swept(G, g, n)[0]
        chosen.append(n)
    left = [n for n in range(number) if n not in chosen and F[n, n] > 1.0 and G[n, n] > _STILL]
    explained, rank = _explained(F[np.ix_(left, left)], g[left])
    if verbose:
        print(len(chosen), "left", len(left), "rank", rank, "chi2", explained)
    needed = not offsets_alone and explained > chi2.isf(_CHANCE, max(rank, 1))
    while True:
        left = [n for n in range(number) if n not in chosen and F[n, n] > 1.0 and G[n, n] > _STILL]
        some = left if needed else [n for n in left if every[n].is_offset and offsets_alone]
        if not some:
            break
        gain = g[some] ** 2 / np.diag(F)[some]
        if offsets_alone or gain.max() < _WORTH:
            gain = np.diag(F)[some]
        best = some[int(gain.argmax())]
        F, g = _swept(F, g, best)
        G = _swept(G, g, best)[0]
        chosen.append(best)
    # What the chosen ones leave, the others may leave as well: whatever is left is untold.
    untold = [n for n in range(number) if n not in chosen and not (F[n, n] > 1.0 and G[n, n] > _STILL)]
    return [every[n] for n in sorted(chosen)], [every[n] for n in untold]


def _moves(fields: Fields, v: np.ndarray) -> np.ndarray:
    """`(C, C)` how changes move the toucher's places, but for similarities of all of them.

    Rows and columns are in units of what each change moves alone: 1 on the diagonal for what no
    similarity moves alike.
    """
    amounts, q = fields.parted(v)[0], fields.skin.q
    middle = fields.changed(v).places(q)
    away = middle - middle.mean(axis=0)
    slopes = []
    for number in range(len(amounts)):
        moved = amounts + 1e-6 * np.eye(1, len(amounts), number)[0]
        slopes.append((fields.way.changed(fields.changes, moved).places(q) - middle).ravel() / 1e-6)
    slope = np.stack(slopes, axis=1)
    slope /= np.maximum(np.linalg.norm(slope, axis=0), 1e-12)
    turned = [np.cross(axis, away).ravel() for axis in np.eye(3)]
    shifted = [np.broadcast_to(axis, away.shape).ravel() for axis in np.eye(3)]
    alike = np.linalg.qr(np.stack([*turned, *shifted, away.ravel()], axis=1))[0]
    slope -= alike @ (alike.T @ slope)
    return slope.T @ slope


def _explained(F: np.ndarray, g: np.ndarray) -> tuple[float, int]:
    """By how much the squared residuals fall, and the directions of changes that are observed."""
    values, vectors = np.linalg.eigh(F)
    kept = values > 1.0
    along = vectors[:, kept].T @ g
    return float(np.square(along) @ (1.0 / values[kept])), int(kept.sum())


def _swept(F: np.ndarray, g: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Equations with one unknown eliminated; its row and column are 0."""
    return F - np.outer(F[n], F[n]) / F[n, n], g - F[n] * (g[n] / F[n, n])


def _summed_up(fields: Fields, v: np.ndarray, untold: Sequence[Change]) -> Refit:
    num, m = len(fields.changes), len(fields.touch)
    matrix, _, squares = fields.normal(v, _prior(fields))
    # Residuals of neighbours err alike, so residuals alone make standard errors too small.
    error = squares / max(2 * m - len(v), 1) * _MODEL_ERROR**2
    sigma = np.sqrt(error * np.maximum(np.diag(np.linalg.inv(matrix)), 0.0))
    readings = np.square(fields.residuals(v)[:m])
    off = np.bincount(fields.receptor, readings) / np.bincount(fields.receptor)
    amounts, softness, _, places, _ = fields.parted(v)
    way = fields.changed(v)
    touched, normals = fields.skin.touched(way, float(softness))
    nearest = np.linalg.norm(places[:, None] - touched, axis=2).argmin(axis=1)
    return Refit(
        way=way, changes=fields.changes, amounts=amounts, sigma=sigma[:num],
        untold=untold, places=places,
        place_sigma=sigma[num + 2 :][: 3 * fields.num_receptors].reshape(-1, 3),
        normals=normals[nearest],
        suspect=np.sqrt(off) > _SUSPECT * np.sqrt(np.median(off)),
    )  # fmt: skip
