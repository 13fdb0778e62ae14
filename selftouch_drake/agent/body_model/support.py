"""The surface of what touches: a support function, and the skin's normal where it touches.

A convex toucher touches a skin with outward normal n at the point of its surface that lies farthest
along u = -n: its centre plus the gradient of its support function h at u. Here h is the radius of a
ball plus `c' (u' B u)` over five matrices B without a trace. The ball's radius cannot be known from
touch: a ball that rolls on a skin feels as a point does on the parallel surface.
"""

import numpy as np
from scipy.spatial import cKDTree

#: The five traceless symmetric matrices B of a toucher's shape: its support function is the sum of
#: `c * u' B u` over the coefficients c.
SHAPE_BASIS = np.array(
    [
        np.diag([1.0, -1.0, 0.0]),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(3.0),
        [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    ]
)
# Neighbours of a kernel whose normals are blended, and that which tells how far the blend reaches.
_BLENDED, _REACH = 8, 3
# Added to the spread of neighbours, which has a trace of 1: a flat patch has some thickness. From
# 0.05 to 0.2 it makes no difference.
_ROUND = 0.1


def bulge_slopes(direction: np.ndarray) -> np.ndarray:
    """`(n, 3, 5)` derivatives of `bulge` by the coefficients of the shape.

    Args:
        direction: `(n, 3)` as in `bulge`.
    """
    known = np.nan_to_num(direction)
    along = np.einsum("nb,kab->nak", known, SHAPE_BASIS)
    height = np.einsum("nak,na->nk", along, known)
    return 2.0 * along - height[:, None, :] * known[:, :, None]


def bulge(shape: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """How far a toucher's surface differs from that of a ball, where it touches.

    Args:
        shape: `(5,)` coefficients over `SHAPE_BASIS`.
        direction: `(n, 3)` unit vectors in the frame of the toucher's link, from it into the skin:
            the skin's outward normal reversed. NaN where unknown.

    Returns:
        `(n, 3)` gradient of the support function there; 0 where the direction is unknown.
    """
    B = np.tensordot(shape, SHAPE_BASIS, axes=1)
    along = direction @ B
    found = 2.0 * along - np.sum(along * direction, axis=1, keepdims=True) * direction
    return np.where(np.isnan(direction), 0.0, found)


def shape_moved(motion: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """`(5,)` the same shape after a similarity `(4, 4)`, maybe a mirror image, of its frame."""
    linear = motion[:3, :3]
    size = np.cbrt(abs(np.linalg.det(linear)))
    B = linear @ np.tensordot(shape, SHAPE_BASIS, axes=1) @ linear.T / size
    # Each B of the basis has a squared norm of 2, and they are at right angles.
    return np.tensordot(SHAPE_BASIS, B, axes=2) / 2


def beside(place: np.ndarray, part: np.ndarray, asked: np.ndarray | None = None) -> np.ndarray:
    """`(K, 9)` each kernel and the kernels nearest to it on its part; -1 where there are no more.

    Args:
        place: `(K, 3)` places of kernels; NaN where unknown.
        part: `(K,)` part of each kernel.
        asked: kernels that are looked at: others have -1. All by default.
    """
    near = np.full((len(place), _BLENDED + 1), -1)
    known = np.isfinite(place).all(axis=1)
    wanted = known.copy()
    if asked is not None:
        wanted[:] = False
        wanted[asked] = known[asked]
    for number in np.unique(part[wanted]):
        kernels = np.flatnonzero((part == number) & known)
        if len(kernels) < 2:
            continue
        own = np.flatnonzero((part == number) & wanted)
        count = min(_BLENDED + 1, len(kernels))
        near[own, :count] = kernels[cKDTree(place[kernels]).query(place[own], k=count)[1]]
    return near


def nearest_toucher(
    places: np.ndarray, kernel_place: np.ndarray, kernel_part: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """`(n,)` which of several touchers lies nearest to the kernel that was felt.

    The kernels about tell how far a kernel reaches, which is farther along the skin than across it:
    with two fingers of one hand half as many touches go to the wrong one as by plain distances.

    Args:
        places: `(U, n, 3)` of the touchers; NaN where one cannot have touched.
        kernel_place: `(K, 3)`.
        kernel_part: `(K,)`.
        target: `(n,)` target sensations.
    """
    asked, number = np.unique(target, return_inverse=True)
    near = beside(kernel_place, kernel_part, asked)[asked]
    weight = (near >= 0).astype(float)
    # A kernel without neighbours is round.
    away = np.where(weight[:, :, None] > 0, kernel_place[near] - kernel_place[asked][:, None], 0.0)
    spread = np.einsum("kn,kna,knb->kab", weight, away, away)
    size = np.maximum(np.trace(spread, axis1=1, axis2=2), 1e-300)
    measure = np.linalg.inv(spread / size[:, None, None] + _ROUND * np.eye(3))[number]
    away = places - kernel_place[target]
    far = np.einsum("una,nab,unb->un", away, measure, away)
    return np.nan_to_num(far, nan=np.inf).argmin(axis=0)


def smoothed(normal: np.ndarray, near: np.ndarray, rounds: int = 2) -> np.ndarray:
    """`(K, 3)` normals that are means of their own and their neighbours'; NaN where unknown.

    A plane through few kernels is a poor normal where the skin is as curved as a thin arm's.

    Args:
        normal: `(K, 3)` with one side.
        near: `(K, N)` as in `beside`.
        rounds: of smoothing.
    """
    known = np.isfinite(normal).all(axis=1)
    weight = ((near >= 0) & known[near]).astype(float)
    weight[:, 0] *= 2
    for _ in range(rounds):
        mean = np.einsum("kn,kna->ka", weight, np.nan_to_num(normal)[near])
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            normal = np.where(known[:, None] & (size > 1e-9), mean / size, normal)
    return normal


def blended_normals(
    place: np.ndarray, normal: np.ndarray, near: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """`(n, 3)` normals of one part's skin at some places, blended from those of the kernels about.

    The places alone say which kernels these are, and not what was felt: a place that depended on
    what was felt could be fitted to anything.

    Args:
        place: `(K, 3)` places of kernels; NaN for unknown ones and for those of other parts.
        normal: `(K, 3)` outward normals; NaN where unknown.
        near: `(K, N)` as in `beside`.
        at: `(n, 3)` places.

    Returns:
        Unit vectors; NaN where the place is NaN or no kernel about has a normal.
    """
    known = np.isfinite(normal).all(axis=1) & np.isfinite(place).all(axis=1)
    here = np.isfinite(at).all(axis=1)
    found = np.full(at.shape, np.nan)
    kernels = np.flatnonzero(known)
    if len(kernels) == 0 or not here.any():
        return found
    own = kernels[cKDTree(place[kernels]).query(at[here])[1]]
    about = near[own]
    apart = ((at[here][:, None] - place[about]) ** 2).sum(axis=2)
    reach = ((place[about[:, min(_REACH, near.shape[1] - 1)]] - place[own]) ** 2).sum(axis=1)
    lowest = np.nanmin(np.where(about >= 0, apart, np.inf), axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.exp(-0.5 * (apart - lowest) / reach[:, None])
    weight = np.where((about >= 0) & known[about] & np.isfinite(weight), weight, 0.0)
    mean = np.einsum("nk,nka->na", weight, np.nan_to_num(normal)[about])
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        found[here] = np.where(size > 1e-9, mean / size, normal[own])
    return found
