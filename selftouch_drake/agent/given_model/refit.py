"""Changes of a way that touches decide, and the receptors' places: robust least squares.

Offsets of joints are always looked for. Only where these leave more than chance does, all other
numbers are looked for that touches tell beside them, those that explain most first. What no touch
tells beside the others stays as it is: a skin whose receptors are unknown tells no length, and not
where it lies itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from selftouch_drake.agent.given_model.fields import Fields
from selftouch_drake.agent.given_model.selection import Selection
from selftouch_drake.agent.given_model.skin import TouchedSkin
from selftouch_drake.agent.given_model.way import Change, GivenWay

# rad and m, within which changes are expected; and receptors that hardly any touch felt.
_EXPECTED, _NEAR = {"rad": 0.3, "m": 0.1}, 1.0
# Residuals are scaled, and neighbours are looked for, so many times; each time steps are taken.
# It ends where usual residuals change by a smaller share.
_NUM_ROUNDS, _NUM_STEPS, _SETTLED = 8, 12, 0.005
#: What moved by fewer standard errors may not have moved at all; and the chance, of all these
#: together, below which they did.
SIGNIFICANT, _TOGETHER = 3.0, 0.05
# How often changes are selected anew.
_MOST_SELECTIONS = 4
# A receptor is suspected whose residuals are so many times the usual ones.
_SUSPECT = 4.0
#: By how much errors exceed what residuals tell, since the model of fields is not exact: of
#: receptors, measured on a torus and a turning torus, three sets of 300 touches each; and of
#: changes, where 20 numbers were changed, eight sets of 300 touches on a torus.
PLACE_ERROR, CHANGE_ERROR = 2.4, 1.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refit:
    """What touches say of a way and of S receptors.

    Attributes:
        way: as it was refitted.
        changes: C that were looked for.
        amounts: `(C,)` rad or m.
        sigma: `(C,)` standard errors, as if what was not looked for were as it is given.
        untold: changes that no touch tells beside the others.
        places: `(S, 3)` m, receptors in the frame of their link.
        place_sigma: `(S, 3)` standard errors.
        normals: `(S, 3)` outward normals of the skin there.
        suspect: `(S,)` bool, receptors whose readings do not fit their place.
    """

    way: GivenWay
    changes: Sequence[Change]
    amounts: np.ndarray
    sigma: np.ndarray
    kept: np.ndarray
    untold: Sequence[Change]
    places: np.ndarray
    place_sigma: np.ndarray
    normals: np.ndarray
    suspect: np.ndarray


def refitted(way: GivenWay, q: np.ndarray, sensation: np.ndarray, radius: float) -> Refit:
    """Refits a way.

    Args:
        way: as it is given.
        q: `(n, L)` rad or m, as its joints were read.
        sensation: `(n, S)` readings; each row and each column has one above 0.
        radius: m, of the ball that touches.

    Raises:
        LinAlgError: the touches leave receptors or changes open.
    """
    every = way.changes()
    offsets = [n for n, change in enumerate(every) if change.is_offset]
    skin = TouchedSkin(q, radius, sensation.sum(axis=1), way)
    fields = Fields.of(way, [every[n] for n in offsets], skin, sensation)
    v = _fitted(fields, fields.start())
    selection = _selection(fields, v, every)
    selection.take_observed(offsets)
    asked, before = sorted(selection.taken), offsets
    for _ in range(_MOST_SELECTIONS):
        looked_for = [every[n] for n in asked]
        if set(before) <= set(asked):
            fields, v = fields.with_changes(v, looked_for)
        else:  # What is not told has moved the receptors: they start anew.
            fields = Fields.of(way, looked_for, fields.skin, sensation, fields.scales)
            v = fields.start()
        v = _fitted(fields, v)
        selection = _selection(fields, v, every)
        selection.take_observed([n for n in asked if n in offsets])
        if selection.asks():
            selection.take_observed(range(len(every)), needed_first=True)
        if sorted(selection.taken) == asked:
            break
        asked, before = sorted(selection.taken), asked
    told = {*asked, *selection.observed()}
    found = _summed_up(fields, v, [every[n] for n in range(len(every)) if n not in told])
    kept = _kept(fields, v, found)
    if kept.all():
        return found
    fields, v = fields.with_changes(v, [c for c, k in zip(found.changes, kept, strict=True) if k])
    fewer = _summed_up(fields, _fitted(fields, v), found.untold)
    amounts, sigma = found.amounts.copy(), found.sigma.copy()
    amounts[kept], sigma[kept] = fewer.amounts, fewer.sigma
    return replace(fewer, changes=found.changes, amounts=amounts, sigma=sigma, kept=kept)


def _selection(fields: Fields, v: np.ndarray, every: Sequence[Change]) -> Selection:
    wide, v = fields.with_changes(v, every)
    return Selection.of(wide, v, _prior(wide), PLACE_ERROR)


def _prior(fields: Fields) -> np.ndarray:
    """`(P,)` inverse variances of what is expected of the unknowns."""
    changes = [_EXPECTED[change.unit] ** -2 for change in fields.changes]
    places = np.full(3 * fields.num_receptors, _NEAR**-2)
    return np.r_[changes, 0.0, 0.0, places, np.zeros(len(fields.skin.q))]


def _fitted(fields: Fields, v: np.ndarray) -> np.ndarray:
    """The unknowns that fit best; neighbours and usual residuals are those that belong to them."""
    prior = _prior(fields)
    for _ in range(_NUM_ROUNDS):
        before = np.array(fields.scales)
        v = fields.minimised(v, prior, _NUM_STEPS)
        fields.rescaled(v)
        if np.abs(np.log(fields.scales / before)).max() < _SETTLED:
            break
    return v


def _kept(fields: Fields, v: np.ndarray, found: Refit) -> np.ndarray:
    """`(C,)` bool, changes that are made: all, unless few moved and the others, together, did not.

    Noise of many numbers that did not move makes a model worse where nothing was touched.
    """
    matrix, _, squares = fields.normal(v, _prior(fields))
    error = CHANGE_ERROR**2 * squares / max(2 * len(fields.touch) - len(v), 1)
    still = np.abs(found.amounts) < SIGNIFICANT * found.sigma
    still &= ~np.array([change.is_offset for change in found.changes], dtype=bool)
    others = len(still) - sum(change.is_offset for change in found.changes)
    if still.sum() < others / 2 or not still.any():
        return np.ones(len(still), dtype=bool)
    spread = error * np.linalg.inv(matrix)[: len(still), : len(still)][np.ix_(still, still)]
    moved = found.amounts[still] @ np.linalg.solve(spread, found.amounts[still])
    return ~still if moved < chi2.isf(_TOGETHER, still.sum()) else np.ones(len(still), dtype=bool)


def _summed_up(fields: Fields, v: np.ndarray, untold: Sequence[Change]) -> Refit:
    num, m = len(fields.changes), len(fields.touch)
    matrix, _, squares = fields.normal(v, _prior(fields))
    # Residuals of neighbours err alike, so residuals alone make standard errors too small.
    error = squares / max(2 * m - len(v), 1)
    sigma = np.sqrt(error * np.maximum(np.diag(np.linalg.inv(matrix)), 0.0))
    readings = np.square(fields.residuals(v)[:m])
    off = np.bincount(fields.receptor, readings) / np.bincount(fields.receptor)
    amounts, softness, _, places, _ = fields.parted(v)
    way = fields.changed(v)
    touched, normals = fields.skin.touched(way, float(softness))
    nearest = np.linalg.norm(places[:, None] - touched, axis=2).argmin(axis=1)
    place_sigma = PLACE_ERROR * sigma[num + 2 :][: 3 * fields.num_receptors].reshape(-1, 3)
    return Refit(
        way=way,
        changes=fields.changes,
        amounts=amounts,
        sigma=CHANGE_ERROR * sigma[:num],
        kept=np.ones(num, dtype=bool),
        untold=untold,
        places=places,
        place_sigma=place_sigma,
        normals=normals[nearest],
        suspect=np.sqrt(off) > _SUSPECT * np.sqrt(np.median(off)),
    )
