"""Where receptors lie, from how touches at known places are shared among them.

The mean of the touches that a receptor feels lies where most touches are made: beside it, where
only one side of it is touched, by centimetres at the edge of what a toucher reaches. How the
receptors share a touch does not depend on where touches are made. Fields are taken for round bells
of one width, and a receptor's share for its bell over the sum of all of them: their middles are
those that explain all shares best (a softmax regression with quadratic scores).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

# Touches that are used, spread evenly over the skin, and the nearest receptors among which each is
# shared: more change nothing, and cost time.
_TOUCHES, _NEAREST = 2000, 32
# Touches about one that say how densely they lie, or which plane the skin has there.
_ABOUT, _PLANE = 20, 40
# How strongly middles are held to the sheet of the touches and to where they begin, in touches of a
# receptor. Where the skin is curved, they lie off the sheet: on a cube, a torus and a head places
# were off by 13, 2.0, 1.9 mm with 0.1, by 19, 3.2, 2.1 with 1, and lay far off the skin with 0.03.
_TO_SHEET, _TO_START = 0.1, 0.01
# Touches lie in a plane if they spread by less across it, relative to their longest spread.
_FLAT = 1e-6
# Times that the sheet and the nearest receptors are found anew, and steps between.
_ROUNDS, _STEPS = 3, 25
# By this share of a field's width places are off though touches are many, since fields are no such
# bells: on a cube, a torus and an infant 0.05 to 0.25 (root mean squares).
_OFF = 0.15
# Fewer receptors share nothing, and fewer touches tell nothing.
_FEWEST_RECEPTORS, _FEWEST_TOUCHES = 4, 50


@dataclass(frozen=True, slots=True, eq=False)
class _Shares:
    """How n touches are shared among the m receptors nearest to each; the unit is about a field.

    Attributes:
        y: `(n, 3)` places of touches.
        near: `(n, m)` those receptors, of S.
        share: `(n, m)` what each felt, relative to all m.
        sheet: `(S, 3)` a place on the skin near each receptor.
        normal: `(S, 3)` of the skin there.
        start: `(S, 3)` where receptors were thought to be.
    """

    y: np.ndarray
    near: np.ndarray
    share: np.ndarray
    sheet: np.ndarray
    normal: np.ndarray
    start: np.ndarray

    @property
    def hold(self) -> float:
        """Touches of a receptor."""
        return len(self.y) / len(self.start)

    def cost(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost of `(3 S + 1,)` middles and the logarithm of the width, and its derivatives."""
        middle, scale = parameters[:-1].reshape(-1, 3), np.exp(-2.0 * parameters[-1])
        expected, away, square = self.expected(middle, scale)
        off = expected - self.share
        by_middle = np.zeros_like(middle)
        for axis in range(3):
            pull = (scale * off * away[:, :, axis]).ravel()
            by_middle[:, axis] = np.bincount(self.near.ravel(), pull, minlength=len(middle))
        cost = -float((self.share * np.log(np.maximum(expected, 1e-300))).sum())
        height = np.einsum("sa,sa->s", middle - self.sheet, self.normal)
        moved = middle - self.start
        held = _TO_SHEET * np.square(height).sum() + _TO_START * np.square(moved).sum()
        cost += 0.5 * self.hold * held
        by_middle += self.hold * (_TO_SHEET * height[:, None] * self.normal + _TO_START * moved)
        return cost, np.append(by_middle.ravel(), scale * (off * square).sum())

    def expected(self, middle: np.ndarray, scale: float) -> tuple[np.ndarray, ...]:
        """Expected shares `(n, m)`, `(n, m, 3)` from middles to touches, and that squared."""
        away = self.y[:, None] - middle[self.near]
        square = np.square(away).sum(axis=2)
        score = -0.5 * scale * square
        bell = np.exp(score - score.max(axis=1, keepdims=True))
        return bell / bell.sum(axis=1, keepdims=True), away, square

    def variance(self, middle: np.ndarray, width: float) -> np.ndarray:
        """`(S,)` mean squared errors of middles by chance: a sandwich estimate."""
        expected, away, _ = self.expected(middle, 1.0 / width**2)
        away = away / width**2
        count, of = len(middle), self.near.ravel()
        inner, outer = np.empty((2, count, 3, 3))
        for a in range(3):
            for b in range(3):
                both = away[:, :, a] * away[:, :, b]
                weight = expected * (1.0 - expected) * both
                inner[:, a, b] = np.bincount(of, weight.ravel(), minlength=count)
                weight = np.square(expected - self.share) * both
                outer[:, a, b] = np.bincount(of, weight.ravel(), minlength=count)
        inner += self.hold * _TO_SHEET * self.normal[:, :, None] * self.normal[:, None]
        inner += self.hold * _TO_START * np.eye(3)
        inverse = np.linalg.inv(inner)
        return np.trace(inverse @ outer @ inverse, axis1=1, axis2=2)


def middles_of_fields(
    y: np.ndarray, felt: csr_array, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where receptors of one part lie, and the standard errors of that.

    Args:
        y: `(n, 3)` places of touches.
        felt: `(n, S)` what receptors read.
        start: `(S, 3)` where they lie, roughly.

    Returns:
        `(S, 3)` places and `(S,)` root mean squared errors, in the unit of `y`. What is given, and
        NaN, where there are too few receptors or touches.
    """
    count = len(start)
    kept = np.flatnonzero(np.asarray(felt.sum(axis=1)).ravel() > 0)
    if count < _FEWEST_RECEPTORS or len(kept) < _FEWEST_TOUCHES:
        return start, np.full(count, np.nan)
    kept = kept[_evenly(y[kept], _TOUCHES)]
    # Receptors overlap with their next ones.
    size = float(np.median(cKDTree(start).query(start, k=4)[0][:, 3])) / np.sqrt(2.0)
    size = max(size, 1e-9 * float(np.ptp(y, axis=0).max()))
    y, begun, pressed = y[kept] / size, start / size, np.maximum(felt[kept].toarray(), 0.0)
    tree, middle, width = cKDTree(y), begun, 0.0
    for _ in range(_ROUNDS):
        near = cKDTree(middle).query(y, k=min(_NEAREST, count))[1]
        share = np.take_along_axis(pressed, near, axis=1)
        some = share.sum(axis=1) > 0
        if not some.any():
            return start, np.full(count, np.nan)
        share = share[some] / share[some].sum(axis=1, keepdims=True)
        shares = _Shares(y[some], near[some], share, *_sheet(tree, middle), begun)
        found = minimize(
            shares.cost,
            np.append(middle.ravel(), width),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _STEPS},
        ).x
        middle, width = found[:-1].reshape(-1, 3), found[-1]
    error = shares.variance(middle, np.exp(width)) + np.square(_OFF * np.exp(width))
    return size * middle, size * np.sqrt(error)


def _evenly(y: np.ndarray, number: int) -> np.ndarray:
    """At most so many rows of `(n, 3)` places, spread evenly over a surface."""
    if len(y) <= number:
        return np.arange(len(y))
    far = cKDTree(y).query(y, k=_ABOUT)[0][:, -1]
    share = np.cumsum(far**2)
    chosen = np.searchsorted(share, share[-1] * (np.arange(number) + 0.5) / number)
    return np.unique(np.minimum(chosen, len(y) - 1))


def _sheet(tree: cKDTree, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(S, 3)` the middle of the touches nearest to each place, and the normal of their plane."""
    near = np.asarray(tree.data)[tree.query(middle, k=min(_PLANE, tree.n))[1]]
    mean = near.mean(axis=1)
    _, size, along = np.linalg.svd(near - mean[:, None], full_matrices=False)
    # In a plane the skin is a line, and its normal lies in the plane.
    flat = size[:, 2] < _FLAT * size[:, 0]
    return mean, np.where(flat[:, None], along[:, 1], along[:, 2])
