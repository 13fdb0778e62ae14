"""Dimensions of X/=_phi: of the skin, and of the space that it lies in (paper, sections I and II).

"The objective for the agent is to understand the characteristics, such as topology and space
dimension, of the movements of its end-effector." It supposes neither that its skin is a surface nor
that space has three dimensions. Both follow from distances between its kernels.

- *Skin.* Kernels are evenly spaced. The more dimensions, the faster their number grows with the
  distance around a kernel.
- *Space.* A line lies in a plane: its length alone does not show how it bends. A surface is laid
  out in three dimensions. If two fit the distances as well, up to noise, it is flat; if a fourth
  one makes them fit far better, three are too few.
"""

import numpy as np

from .layout import Embedding, curvature_corrected_mds, stress_embedding

# Values that separate two kinds were measured on rings, strips, spheres, cubes, tori, tubes, flat
# patches and forearms of 12 to 1000 kernels; the values of both kinds are given.

#: Ranks of the neighbours between which growth is measured around each kernel: near enough that
#: neither the far side of a thin part nor a rim counts.
_NEAR, _FAR = 2, 12

#: A skin has one dimension if it grows more slowly than this: lines 1.0 to 1.2, surfaces from 1.9.
_LINE = 1.5

#: A layout may be flat if its third eigenvalue is below this share of the first: tori have 0.15.
_THIN = 0.05

#: It is flat if the third dimension divides the stress of the unbent layout by less than this: flat
#: patches 1.1 to 2.1, a third of a sphere 3.9.
_FLAT = 2.2

#: A layout may lack a dimension if its fourth eigenvalue is above this share of the first: 0.03 to
#: 0.13 where the shape is right.
MISFIT = 0.15

#: It lacks one if a fourth divides the stress by more than this: bodies in space 1.0 to 1.1, a flat
#: torus 3.3. The layouts are not unbent: bent enough, even a flat torus fits.
_LACKING = 2.0

#: The dimension of a part is measured between the balls that hold these shares of all kernels: from
#: a few neighbours to where the body curves away. Larger balls give lower dimensions.
_SHARES = (0.01, 0.1)

#: Fewest neighbours in the smallest ball, on a line and on a surface; the first share of a small
#: body would hold fewer.
_LEAST_NEIGHBOURS = {1: 8, 2: 3}

#: The largest ball holds at least so many times as many kernels; a tenth of a small body does not.
_LEAST_GROWTH = 5

#: Fewest kernels on which growth can be measured; with fewer, no dimension is given.
LEAST_KERNELS = 50


def skin_dimension(distances: np.ndarray) -> int:
    """Whether the skin is a line (1) or a surface (2).

    The `(K, K)` geodesic distances by sensation are symmetric and finite. Of three kernels or fewer
    nothing is known: 2.
    """
    ranked = np.sort(distances, axis=1)
    far = min(_FAR, len(distances) - 1)
    if far <= _NEAR:
        return 2
    ratio = ranked[:, far] / np.maximum(ranked[:, _NEAR], np.finfo(float).tiny)
    growth = np.log(far / _NEAR) / np.maximum(np.log(np.median(ratio)), np.finfo(float).tiny)
    return 1 if growth < _LINE else 2


def space_dimension(edges: np.ndarray, distances: np.ndarray, layout: Embedding, skin: int) -> int:
    """The number of dimensions of the space that a part of the body needs: 2, 3 or 4.

    The `(K, K)` distances are shortest paths over `(E, 2)` edges that connect all points; the
    layout is of them, in `skin + 1` dimensions.
    """
    if skin == 1:
        return 2
    if layout.spectrum[2] < _THIN:
        flat, bent = (
            curvature_corrected_mds(edges, distances, dimension=dimension).stress
            for dimension in (2, 3)
        )
        return 2 if flat < _FLAT * bent else 3
    if layout.fourth_eigenvalue > MISFIT:
        lacking, full = (
            stress_embedding(distances, dimension=dimension).stress for dimension in (3, 4)
        )
        return 4 if lacking > _LACKING * full else 3
    return 3


def intrinsic_dimension(distances: np.ndarray, skin: int = 2) -> float:
    """Correlation dimension: the slope of log(number of kernels) against log(distance).

    Kernels are evenly spaced, so estimators that use nearest neighbours (TwoNN, maximum
    likelihood) do not apply: they assume random positions. On average a ball of radius r around a
    kernel holds c r^d others. It is about 1 for a line (skin 1), 1.8 to 2.4 for a surface (skin 2).
    The `(K, K)` geodesic distances are symmetric and finite.

    Raises:
        ValueError: there are fewer than 50 kernels.
    """
    num_kernels = len(distances)
    if num_kernels < LEAST_KERNELS:
        raise ValueError(
            f"num_targets is {num_kernels}: give at least {LEAST_KERNELS}, to estimate a dimension"
        )
    pairs = np.sort(distances[~np.eye(num_kernels, dtype=bool)])
    smallest = max(_SHARES[0], _LEAST_NEIGHBOURS[skin] / num_kernels)
    share = np.geomspace(smallest, max(_SHARES[1], _LEAST_GROWTH * smallest), 20)
    radius = pairs[(share * len(pairs)).astype(int)]
    return float(np.polyfit(np.log(radius), np.log(share), 1)[0])
