"""Receptors where touch finds them, beside the places that a file gives them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# A receptor is elsewhere if it is off by this share of the distance to its next neighbour in the
# file, and by so many standard errors.
_SPACING, _ERRORS = 0.5, 4.0
_ROUNDS = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """Receptors beside a file; S of them.

    Attributes:
        places: `(S, 3)` m, of the file, moved on the skin as a whole.
        off: `(S,)` m, how far receptors are found from there; NaN for those that were not found.
        shift: `(3,)` m, by which the skin as a whole has moved, at its middle.
        turn: rad, by which it has turned.
        scale: by which it has grown.
        elsewhere: receptors that are not where the file says.
        read_as: for each of these, the receptor at whose place it is found, or -1.
    """

    places: np.ndarray
    off: np.ndarray
    shift: np.ndarray
    turn: float
    scale: float
    elsewhere: np.ndarray
    read_as: np.ndarray

    def cycles(self) -> list[list[int]]:
        """Receptors that read in each other's place, in rounds: two are exchanged."""
        at = dict(zip(self.elsewhere.tolist(), self.read_as.tolist(), strict=True))
        found, seen = [], set()
        for start in at:
            ring = [start]
            while (following := at.get(ring[-1], -1)) not in (-1, *ring):
                ring.append(following)
            if following == start and start not in seen:
                found.append(ring)
                seen |= set(ring)
        return found


def compared(found: np.ndarray, sigma: np.ndarray, given: np.ndarray) -> Compared:
    """Compares places of receptors with those of a file.

    Args:
        found: `(S, 3)` m; NaN for receptors that were not found.
        sigma: `(S, 3)` standard errors.
        given: `(S, 3)` m, in the file.
    """
    known = np.flatnonzero(np.isfinite(found).all(axis=1))
    weight = np.ones(len(known))
    moved = given[known]
    turn, shift, scale = np.eye(3), np.zeros(3), 1.0
    for _ in range(_ROUNDS):
        turn, scale, shift = similarity(given[known], found[known], weight)
        moved = scale * given[known] @ turn.T + shift
        off = np.linalg.norm(found[known] - moved, axis=1)
        # Receptors that are elsewhere must not pull the others along.
        weight = 1.0 / (1.0 + np.square(off / max(1.5 * np.median(off), 1e-6))) ** 2
    places = scale * given @ turn.T + shift
    off = np.linalg.norm(found - places, axis=1)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    np.fill_diagonal(apart, np.inf)
    error = np.linalg.norm(sigma, axis=1)
    with np.errstate(invalid="ignore"):
        far = (off > _SPACING * apart.min(axis=1)) & (off > _ERRORS * error)
    elsewhere = np.flatnonzero(far)
    to_all = np.linalg.norm(found[elsewhere][:, None] - places, axis=2)
    at = to_all.argmin(axis=1) if len(elsewhere) else np.zeros(0, dtype=int)
    near = to_all[np.arange(len(at)), at] < _SPACING * apart.min(axis=1)[at]
    middle = given[known].mean(axis=0)
    return Compared(
        places=places,
        off=off,
        shift=scale * turn @ middle + shift - middle,
        turn=float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))),
        scale=scale,
        elsewhere=elsewhere,
        read_as=np.where(near, at, -1),
    )


def told(compared: Compared, names: Sequence[str], groups: Sequence[str] | None) -> list[str]:
    """A sentence for each ring of receptors that read in each other's place.

    Args:
        compared: the receptors beside the file.
        names: `(S,)`.
        groups: `(S,)` the triangle, or other group, of each; None if nobody knows.
    """
    found = []
    triangles: dict[str, list[list[int]]] = {}
    for ring in compared.cycles():
        own = {groups[n] for n in ring} if groups is not None else set()
        if len(ring) == 3 and len(own) == 1:
            triangles.setdefault(own.pop(), []).append(ring)
        elif len(ring) == 2:
            found.append(f"receptors {names[ring[0]]} and {names[ring[1]]} are exchanged")
        else:
            those = ", ".join(names[n] for n in ring)
            what = "are turned by 120 degrees, or" if len(ring) == 3 else ""
            found.append(f"receptors {those} {what} read in each other's place".replace("  ", " "))
    for group, rings in triangles.items():
        those = ", ".join(names[n] for ring in rings for n in ring)
        found.append(f"triangle {group} is turned by 120 degrees (receptors {those})")
    return found


def doubts(compared: Compared, names: Sequence[str]) -> list[str]:
    """A sentence for each receptor that lies elsewhere alone; it may be felt by few touches only.

    Arguments are as in `told`.
    """
    ringed = {n for ring in compared.cycles() for n in ring}
    found = []
    for n, at in zip(compared.elsewhere.tolist(), compared.read_as.tolist(), strict=True):
        if n not in ringed:
            where = f", where {names[at]} is" if at >= 0 else ""
            found.append(f"receptor {names[n]} is {1e3 * compared.off[n]:.0f} mm away{where}")
    return found


def similarity(
    start: np.ndarray, end: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Rotation, scale and shift that carry weighted points nearest to others (Umeyama 1991)."""
    share = weight / weight.sum()
    centres = share @ start, share @ end
    a, b = start - centres[0], end - centres[1]
    U, size, Vt = np.linalg.svd((share[:, None] * b).T @ a)
    side = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    turn = (U * side) @ Vt
    scale = float((size * side).sum() / (share @ np.square(a).sum(axis=1)))
    return turn, scale, centres[1] - scale * turn @ centres[0]
