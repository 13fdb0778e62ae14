"""Where motor kernel sets truly touch, and how well what the agent found fits the body it has.

The experimenter's side: reads the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist, pdist

from selftouch_drake.agent.representation.quotient import LEAST_OF_PART, QuotientRepresentation
from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.experience.store import Contacts
from selftouch_drake.geometry.receptors import ReceptiveFields

#: Share of touches at one place from which on the quotient space is the surface of the skin. With
#: two fingers on one hand it is the space of their poses: 71 % of the touches of two fingers 6 cm
#: apart, and 92 % of two that are 34 cm apart, are at one place.
LEAST_SINGLE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KernelTruth:
    """Where the K kernels of a representation truly are.

    Attributes:
        skin: `(K,)` number of the skin that most of a kernel's contacts are on.
        positions: `(K, 3)` m, the median of its contacts on that skin, in the frame of its link.
        spread: `(K,)` m, root mean square distance of these contacts from their mean.
        share_single: of all configurations of the kernels, those without two contacts there.
    """

    skin: np.ndarray
    positions: np.ndarray
    spread: np.ndarray
    share_single: float

    @property
    def is_surface(self) -> bool:
        """Whether a kernel is a place on a skin, so that a shape can be compared with it."""
        return self.share_single >= LEAST_SINGLE

    def on_surface(self, fields: Sequence[ReceptiveFields]) -> "KernelTruth":
        """The same kernels at the places of the skins' surfaces where receptors feel them.

        A contact lies inside the skin, which gives way: 1.5 cm deep in a skin of 3 cm.
        """
        positions = self.positions.copy()
        for number, field in enumerate(fields):
            here = self.skin == number
            vertices, weights = field.parts_at(positions[here])
            positions[here] = np.einsum("nv,nvi->ni", weights, field.vertices[vertices])
        return replace(self, positions=positions)


def kernel_truth(
    representation: QuotientRepresentation, contacts: Contacts, receptor_skin: np.ndarray
) -> "KernelTruth":
    """Where each motor kernel set truly touches.

    The contacts are those of each row of `kernel_q`, as `ExperienceReader.take_contacts` gives them
    for `kernel_row`. Where a skin presses a skin, a touch has one on either: that of the kernel's
    strongest receptor counts, by `(S,)` the skin of each.

    Raises:
        ValueError: there are contacts of another number of rows, or a kernel has none at all.
    """
    if len(contacts) != len(representation.kernel_row):
        raise ValueError(
            f"contacts has {len(contacts)} rows, the kernels "
            f"{len(representation.kernel_row)}; give one for each of kernel_row"
        )
    skin, positions, spread, num_several = [], [], [], 0
    of_row = contacts.row
    strongest = receptor_skin[representation.target_sensations.argmax(axis=1)]
    for kernel in range(representation.num_targets):
        rows = representation.members(kernel)
        here = slice(*contacts.offsets[[rows.start, rows.stop]])
        if here.start == here.stop:
            raise ValueError(
                f"kernel {kernel} has no contact; the truth belongs to another experience"
            )
        touched = contacts.skin[here]
        own = strongest[kernel]
        pressed = int(own if own in touched else np.bincount(touched).argmax())
        p_LC = contacts.p_LC[here][touched == pressed].astype(float)
        num_several += int(np.sum(np.bincount(of_row[here][touched == pressed]) > 1))
        skin.append(pressed)
        positions.append(np.median(p_LC, axis=0))
        spread.append(np.sqrt(p_LC.var(axis=0).sum()))
    return KernelTruth(
        skin=np.array(skin),
        positions=np.array(positions),
        spread=np.array(spread),
        share_single=1.0 - num_several / len(contacts),
    )


def neighbour_agreement(set_distance: np.ndarray, positions: np.ndarray) -> float:
    """Share of the 6 nearest kernels by `(K, K)` mu that are truly, `(K, 3)` m, among 12."""
    found = _nearest(set_distance, 6)
    true = _nearest(cdist(positions, positions), 12)
    hits = [np.isin(a, b).mean() for a, b in zip(found, true, strict=True)]
    return float(np.mean(hits))


def trustworthiness(near: np.ndarray, true: np.ndarray, num_neighbours: int = 12) -> float:
    """Whether kernels that are near by one distance are near by another (Venna and Kaski, 2001).

    With the two distances swapped this is continuity. Both together measure, at the scale of
    `num_neighbours` kernels, what the paper's theorem says: that the map between the quotient
    spaces is continuous both ways.

    Args:
        near: `(K, K)` the distance that names the neighbours.
        true: `(K, K)` the distance that judges them.
        num_neighbours: nearest kernels that are judged; fewer than half of K.

    Returns:
        1 if all are among as many nearest by `true`; less the farther down the list they are; 0.5
        or so for neighbours drawn at random.
    """
    K, k = len(true), num_neighbours
    rank = np.argsort(_nearest(true, K), axis=1) + 1
    excess = np.maximum(np.take_along_axis(rank, _nearest(near, k), axis=1) - k, 0).sum()
    return float(1 - 2 * excess / (K * k * (2 * K - 3 * k - 1)))


def distance_distortion(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """How much `(K, K)` distances along the recovered body are off, after one scale for all.

    The shares are the median over pairs of kernels, and what nineteen pairs of twenty are below;
    pairs that are truly at distance 0 are left out.
    """
    pairs = np.triu(true, 1) > 0
    ratio = found[pairs] / true[pairs]
    off = np.abs(ratio / np.median(ratio) - 1)
    return float(np.median(off)), float(np.quantile(off, 0.95))


def shape_rms_fraction(embedding: np.ndarray, positions: np.ndarray) -> float:
    """Root mean square distance after `align`, over the largest distance between positions."""
    residual = align(embedding, positions) - positions
    return float(np.sqrt(np.square(residual).sum(axis=1).mean()) / pdist(positions).max())


def parts_on_skins(part: np.ndarray, truth: "KernelTruth") -> dict[int, np.ndarray]:
    """The kernels by which the agent's body shows each skin: of the part with most of its kernels.

    Returns:
        `(n,)` kernels by the number of each skin that some part, `(K,)` as the agent found it, has
        enough on for a shape.
    """
    found = {}
    for skin in np.unique(truth.skin):
        here = np.flatnonzero(truth.skin == skin)
        most = int(np.bincount(part[here]).argmax())
        kernels = here[part[here] == most]
        if len(kernels) >= LEAST_OF_PART:
            found[int(skin)] = kernels
    return found


def shape_errors(positions: np.ndarray, part: np.ndarray, truth: "KernelTruth") -> dict[int, float]:
    """`shape_rms_fraction` of the part that shows each skin, of `parts_on_skins`, if recovered.

    The `(K, 3)` positions are where the agent lays out the kernels, each part in a pose of its own;
    NaN in parts that it did not recover.
    """
    return {
        skin: shape_rms_fraction(positions[kernels], truth.positions[kernels])
        for skin, kernels in parts_on_skins(part, truth).items()
        if np.isfinite(positions[kernels]).all()
    }


def _nearest(distance: np.ndarray, count: int) -> np.ndarray:
    without_self = distance + np.diag(np.full(len(distance), np.inf))
    return np.argsort(without_self, axis=1, kind="stable")[:, :count]
