"""How far receptors feel, from the touches that each of them feels."""

import numpy as np
from scipy.sparse import csr_array

# Of so many touches a receptor says how far it feels.
_FEWEST = 10


def field_reach(place: np.ndarray, touches: np.ndarray, felt: csr_array) -> float:
    """Radius of a typical field: where touches are spread evenly over a disc of it; NaN if unknown.

    On a torus and a cube it was 1 and 4 % too small.

    Args:
        place: `(S, 3)` of receptors of one part; NaN for others.
        touches: `(n, 3)` places of what touches that part; NaN where unknown.
        felt: `(n, S)` what receptors read.
    """
    pressed = felt.tocoo()
    far = np.linalg.norm(touches[pressed.row] - place[pressed.col], axis=1)
    kept = (pressed.data > 0) & np.isfinite(far)
    count = np.bincount(pressed.col[kept], minlength=len(place))
    square = np.bincount(pressed.col[kept], np.square(far[kept]), minlength=len(place))
    enough = count >= _FEWEST
    if not enough.any():
        return np.nan
    # The mean square over a disc is half of its radius, squared.
    return float(np.median(np.sqrt(2 * square[enough] / count[enough])))
