"""Which changes of a way touches tell, and which they ask for.

All is judged by the equations at what was found so far, as if these were linear. Changes are taken
one after the other; what those taken before explain, or move alike, does not count for the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from selftouch_drake.agent.given_model.fields import Fields
from selftouch_drake.agent.given_model.way import Change, GivenWay

# Standard errors, rad and m, beyond which a change is not observed.
_UNOBSERVED = {"rad": 0.02, "m": 0.01}
# Square of the share of its motion that a change has for itself, beside others and similarities:
# below it, it is not observed. Rounding leaves 1e-9; below 1e-5, equations were no longer linear.
_OWN = 1e-3
#: All that is left explains more than chance does if that is less likely.
CHANCE = 1e-4
# What explains less, in squares of standard errors, is no reason to prefer a change to others.
_WORTH = 4.0
# For derivatives by differences, rad or m.
_STEP = 1e-6


@dataclass(slots=True)
class Selection:
    """Equations of C changes, in units of the standard errors beyond which nothing is observed.

    Attributes:
        information: `(C, C)` that is left beside the changes taken; above 1 where one is observed.
        gradient: `(C,)` likewise, as if no change had been made yet.
        motion: `(C, C)` squared shares of the changes' motions that are left.
        taken: numbers of changes, in order.
    """

    information: np.ndarray
    gradient: np.ndarray
    motion: np.ndarray
    taken: list[int]

    @staticmethod
    def of(fields: Fields, v: np.ndarray, prior: np.ndarray, inflation: float) -> "Selection":
        """At unknowns of fields whose changes are all there are.

        Args:
            fields: of all changes.
            v: `(P,)` its unknowns.
            prior: `(P,)` inverse variances.
            inflation: by how much errors exceed what residuals tell.
        """
        matrix, toward, squares = fields.normal(v, prior)
        number = len(fields.changes)
        across = cho_solve(cho_factor(matrix[number:, number:]), matrix[number:, :number])
        unit = np.array([_UNOBSERVED[change.unit] for change in fields.changes])
        information = matrix[:number, :number] - matrix[:number, number:] @ across
        information *= unit[:, None] * unit
        gradient = unit * (toward[:number] - across.T @ toward[number:])
        free = max(2 * len(fields.touch) - len(v), 1)
        # Errors are those that all changes together would leave.
        error = inflation**2 * squares / free
        gain = explained(information / error, gradient / error)[0] * error
        error = inflation**2 * max(squares - gain, 1e-12) / free
        amounts = fields.parted(v)[0]
        gradient = gradient - information @ (amounts / unit)
        motion = _motion(fields.way, fields.changes, amounts, fields.skin.q)
        return Selection(information / error, gradient / error, motion, [])

    def take(self, n: int) -> None:
        """Takes a change: what it explains and moves is gone."""
        own, moves = self.information[n] / self.information[n, n], self.motion[n]
        self.gradient = self.gradient - own * self.gradient[n]
        self.information = self.information - np.outer(own, self.information[n])
        self.motion = self.motion - np.outer(moves, moves) / moves[n]
        self.taken.append(n)

    def observed(self) -> list[int]:
        """Changes that touches tell beside those taken."""
        told = (np.diag(self.information) > 1.0) & (np.diag(self.motion) > _OWN)
        return [n for n in np.flatnonzero(told).tolist() if n not in self.taken]

    def take_observed(self, among: Sequence[int], *, needed_first: bool = False) -> None:
        """Takes what is observed of some changes, that which is observed best first.

        If `needed_first`, changes that explain most come before them.
        """
        while left := [n for n in self.observed() if n in among]:
            information = np.diag(self.information)[left]
            gain = self.gradient[left] ** 2 / information
            by = gain if needed_first and gain.max() > _WORTH else information
            self.take(left[int(by.argmax())])

    def asks(self) -> bool:
        """Whether all that is observed explains more than chance does."""
        left = self.observed()
        if not left:
            return False
        gain, rank = explained(self.information[np.ix_(left, left)], self.gradient[left])
        return bool(gain > chi2.isf(CHANCE, max(rank, 1)))


def explained(information: np.ndarray, gradient: np.ndarray) -> tuple[float, int]:
    """By how much squared residuals fall, and the number of directions that are observed."""
    values, vectors = np.linalg.eigh(information)
    kept = values > 1.0
    along = vectors[:, kept].T @ gradient
    return float(np.square(along) @ (1.0 / values[kept])), int(kept.sum())


def _motion(
    way: GivenWay, changes: Sequence[Change], amounts: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """`(C, C)` how changes move the toucher's places, but for similarities of all of them.

    Each is relative to all that the change moves: a diagonal of 1 is for what no similarity does.
    """
    places = way.changed(changes, amounts).places(q)
    slopes = []
    for number in range(len(changes)):
        moved = amounts + _STEP * np.eye(1, len(changes), number)[0]
        slopes.append((way.changed(changes, moved).places(q) - places).ravel())
    slope = np.stack(slopes, axis=1) / _STEP
    slope /= np.maximum(np.linalg.norm(slope, axis=0), 1e-12)
    away = places - places.mean(axis=0)
    turned = [np.cross(axis, away).ravel() for axis in np.eye(3)]
    shifted = [np.broadcast_to(axis, away.shape).ravel() for axis in np.eye(3)]
    alike = np.linalg.qr(np.stack([*turned, *shifted, away.ravel()], axis=1))[0]
    slope -= alike @ (alike.T @ slope)
    return slope.T @ slope
