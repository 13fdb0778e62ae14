"""Places of receptors and touches from which receptors feel which touches (naive).

A receptor feels a touch if it is near. So receptors and touches are laid out together: the log
odds that receptor i feels touch n are `a_n + b_i - |x_n - p_i|^2 / 2`, where a is how wide a touch
is and b how sensitive a receptor (multidimensional unfolding; Coombs 1950). How often a place is
touched matters to counts of shared touches, which make seldom touched places too small; here it
does not.

Three suppositions help where touches are few: receptors are much alike, they are about evenly
spread, and the place of a touch changes smoothly with the joints, where these tell the place.
"""

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from selftouch_drake.quotient.layout import one_thread

#: Weights of the suppositions: sensitivities of receptors, widths of touches, distances of touches
#: from where their joints put them, and `1 / d^2` of receptors that are d apart. Chosen on three
#: recordings of a Nao (`benchmarks/others/nao.py`): ten times as much changes errors by about 5 %.
_ALIKE, _WIDTHS, _BY_JOINTS, _EVEN = 1.0, 0.1, 3.0, 3.0

#: Added to squared distances, so that equal places repel each other finitely.
_TINY = 1e-4


@one_thread
def unfold(
    active: np.ndarray, start: np.ndarray, by_joints: np.ndarray | None, num_iterations: int
) -> tuple[np.ndarray, float]:
    """Lays out receptors and touches.

    Args:
        active: `(n, S)` 0 or 1, which receptors feel a touch; each row and column has a 1.
        start: `(S, d)` places of receptors to start from, in any unit.
        by_joints: `(n, n)` predicts a quantity of touches from their joints, given all of it; None
            where joints do not tell the place.
        num_iterations: of L-BFGS.

    Returns:
        `(S, d)` places of the receptors, in widths of a receptor's field; and what the layout
        leaves unexplained, as a share: 1 explains nothing.
    """
    (n, num), d = active.shape, start.shape[1]
    centre = (active @ start) / active.sum(axis=1)[:, None]
    within = active @ np.square(start).sum(axis=1) / active.sum(axis=1) - (centre**2).sum(axis=1)
    several = active.sum(axis=1) > 2
    unit = np.sqrt(np.maximum(within[several if several.any() else slice(None)].mean(), _TINY))
    ends = np.cumsum([num * d, n * d, n])

    def parted(v: np.ndarray) -> tuple[np.ndarray, ...]:
        p, x, a, b = np.split(v, ends)
        return p.reshape(num, d), x.reshape(n, d), a, b

    def odds(p: np.ndarray, x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return x @ p.T + (a - (x**2).sum(axis=1) / 2)[:, None] + (b - (p**2).sum(axis=1) / 2)

    def loss(v: np.ndarray) -> tuple[float, np.ndarray]:
        p, x, a, b = parted(v)
        log_odds = odds(p, x, a, b)
        total = float(np.logaddexp(0.0, log_odds).sum() - (active * log_odds).sum())
        off = expit(log_odds) - active
        of_p = off.T @ x - off.sum(axis=0)[:, None] * p
        of_x = off @ p - off.sum(axis=1)[:, None] * x
        wide = a - a.mean()
        total += _ALIKE * (b @ b) / 2 + _WIDTHS * (wide @ wide) / 2
        apart = p[:, None] - p
        near = 1.0 / (np.square(apart).sum(axis=2) + _TINY)
        np.fill_diagonal(near, 0.0)
        total += _EVEN * near.sum() / 2
        of_p -= 2.0 * _EVEN * np.einsum("ij,ijd->id", near**2, apart)
        if by_joints is not None:
            missed = (x - x.mean(axis=0)) - by_joints @ (x - x.mean(axis=0))
            total += _BY_JOINTS * float(((x - x.mean(axis=0)) * missed).sum()) / 2
            of_x += _BY_JOINTS * (missed - missed.mean(axis=0))
        of_a, of_b = off.sum(axis=1) + _WIDTHS * wide, off.sum(axis=0) + _ALIKE * b
        return total, np.concatenate([of_p.ravel(), of_x.ravel(), of_a, of_b])

    first = np.concatenate(
        [(start / unit).ravel(), (centre / unit).ravel(), np.ones(n), np.zeros(num)]
    )
    found = minimize(loss, first, jac=True, method="L-BFGS-B", options={"maxiter": num_iterations})
    log_odds, share = odds(*parted(found.x)), active.mean(axis=0)
    left = np.logaddexp(0.0, log_odds).sum() - (active * log_odds).sum()
    chance = np.logaddexp(0.0, logit := np.log(share / (1.0 + 1e-9 - share))) - share * logit
    return parted(found.x)[0], float(left / (n * chance.sum()))
