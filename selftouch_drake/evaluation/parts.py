"""The true parts of what can be touched of a robot's skins, and their holes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from selftouch_drake.agent.representation.quotient import LEAST_OF_PART
from selftouch_drake.evaluation.coverage import vertex_areas
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.experience.store import Contacts
from selftouch_drake.geometry.patches import betti_of_patch, parts_by_vertex, touched_patch
from selftouch_drake.geometry.receptors import ReceptiveFields

#: Two patches on different skins are one part if a receptor on one and a receptor on the other feel
#: at the same time, in at least this share of the touches of the one that feels more seldom. So do
#: neighbours on one skin: sensations do not separate them. Between the torso of an infant and its
#: upper arms, which its fists press together, the share is 0.5 at most; where a fingertip is caught
#: between two skins it is a few percent.
_LEAST_SHARED = 0.6
# Touches that a receptor needs for its share to mean anything.
_LEAST_TOUCHES = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TruePart:
    """One connected part of what was touched.

    Attributes:
        skins: numbers of the skins it is on.
        kernels: `(n,)` the kernels that truly lie on it.
        betti: numbers of components, loops and voids of its surface, a patch with a rim where the
            rest of the skin was not touched; None if it runs over several skins.
    """

    skins: tuple[int, ...]
    kernels: np.ndarray
    betti: tuple[int, int, int] | None


class TouchCounts:
    """How often each vertex of each skin was touched, and which patches were touched at once.

    Args:
        fields: of each skin.
        contacts: of all touches, in batches of any size.

    Attributes:
        ends: `(skins + 1,)` where the vertices of each skin begin, numbered through all skins.
        total: `(V,)` touches of the vertices of all skins.
        counts: those of each skin, parts of `total`.
        together: `(n, 2)` vertices of two skins that one toucher pressed at once.
    """

    def __init__(self, fields: Sequence[ReceptiveFields], contacts: Iterable[Contacts]):
        self._trees = [cKDTree(f.vertices) for f in fields]
        self.ends = np.cumsum([0, *(len(f.vertices) for f in fields)])
        self.total = np.zeros(self.ends[-1], dtype=int)
        self.counts = np.split(self.total, self.ends[1:-1])
        together = [np.zeros((0, 2), dtype=int), *map(self._count, contacts)]
        self.together = np.concatenate(together)

    def _count(self, contacts: Contacts) -> np.ndarray:
        """Counts the contacts of some touches; returns the vertices that were pressed at once."""
        vertex = self.vertices(contacts.skin, contacts.p_LC)
        self.total += np.bincount(vertex, minlength=len(self.total))
        # One toucher on two skins at once: contacts are sorted by row, skin and toucher.
        row, toucher = contacts.row, contacts.toucher
        order = np.lexsort((contacts.skin, toucher, row))
        a, b = order[:-1], order[1:]
        same = (row[a] == row[b]) & (toucher[a] == toucher[b])
        return np.stack([vertex[a[same]], vertex[b[same]]], axis=1)

    def vertices(self, skin: np.ndarray, p_LC: np.ndarray) -> np.ndarray:
        """`(C,)` the vertex nearest to each point, numbered through all skins."""
        found = np.zeros(len(skin), dtype=int)
        for number, tree in enumerate(self._trees):
            here = skin == number
            if here.any():
                found[here] = self.ends[number] + tree.query(p_LC[here])[1]
        return found


def true_parts(
    fields: Sequence[ReceptiveFields], counts: TouchCounts, truth: KernelTruth
) -> list[TruePart]:
    """The parts that an agent could find: connected patches of skin that were touched.

    What is smaller than a disc as wide as kernels are apart is neither a hole nor a part. Parts
    with too few kernels for a shape are left out, as the agent leaves them out. The part with the
    most kernels comes first.
    """
    patch_of, num_patches = _touched_patches(fields, counts, truth)
    group = _joined_patches(patch_of, counts, num_patches, fields)
    patch_of_kernel = _nearest_patches(fields, counts, truth, patch_of)
    parts = []
    for number in np.unique(group):
        patches = np.flatnonzero(group == number)
        kernels = np.flatnonzero(np.isin(patch_of_kernel, patches))
        if len(kernels) < LEAST_OF_PART:
            continue
        masks = np.split(np.isin(patch_of, patches), counts.ends[1:-1])
        skins = tuple(skin for skin, mask in enumerate(masks) if mask.any())
        betti = None
        if len(skins) == 1:
            faces, mask = fields[skins[0]].faces, masks[skins[0]]
            betti = betti_of_patch(faces[mask[faces].all(axis=1)])
        parts.append(TruePart(skins=skins, kernels=kernels, betti=betti))
    return sorted(parts, key=lambda part: -len(part.kernels))


def _touched_patches(
    fields: Sequence[ReceptiveFields], counts: TouchCounts, truth: KernelTruth
) -> tuple[np.ndarray, int]:
    """`(V,)` the touched patch of each vertex of all skins, -1 for none; the number of patches."""
    patch_of = np.full(counts.ends[-1], -1)
    num_patches = 0
    for skin, field in enumerate(fields):
        touches = counts.counts[skin]
        area = vertex_areas(field.vertices, field.faces)[touches > 0].sum()
        num_kernels = max(int(np.sum(truth.skin == skin)), 1)
        a, b, _ = field.vertices[field.faces].swapaxes(0, 1)
        mean_edge = np.linalg.norm(b - a, axis=1).mean()
        radius = max(np.sqrt(area / num_kernels), 1.5 * mean_edge)
        mask = touched_patch(field.vertices, field.faces, touches, radius=radius)
        inside = field.faces[mask[field.faces].all(axis=1)]
        label, _ = parts_by_vertex(inside, len(field.vertices))
        used = np.unique(inside)
        number, of_vertex = np.unique(label[used], return_inverse=True)
        patch_of[counts.ends[skin] + used] = num_patches + of_vertex
        num_patches += len(number)
    return patch_of, num_patches


def _nearest_patches(
    fields: Sequence[ReceptiveFields],
    counts: TouchCounts,
    truth: KernelTruth,
    patch_of: np.ndarray,
) -> np.ndarray:
    """`(K,)` the patch that each kernel lies on, -1 on a skin that was not touched.

    A kernel at the ragged rim of a patch belongs to the patch that is nearest.
    """
    vertex = counts.vertices(truth.skin, truth.positions)
    patch = np.full(len(truth.skin), -1)
    for skin, field in enumerate(fields):
        on_skin = patch_of[counts.ends[skin] : counts.ends[skin + 1]]
        here = truth.skin == skin
        touched = np.flatnonzero(on_skin >= 0)
        if len(touched):
            place = field.vertices[vertex[here] - counts.ends[skin]]
            _, nearest = cKDTree(field.vertices[touched]).query(place)
            patch[here] = on_skin[touched[nearest]]
    return patch


def _joined_patches(
    patch_of: np.ndarray, counts: TouchCounts, num_patches: int, fields: Sequence[ReceptiveFields]
) -> np.ndarray:
    """`(patches,)` the part of each patch; a vertex is on one of `(V,)` `patch_of`, or -1."""
    # `(V, S)`, which vertices are in the field of each receptor.
    in_field = block_diag([field.vertex_weights > 0 for field in fields], format="csr").astype(int)
    touches = counts.total
    one, other = np.concatenate([counts.together, counts.together[:, ::-1]]).T
    at_once = coo_array((np.ones(len(one)), (one, other)), shape=(len(touches),) * 2)
    pressed = np.asarray(in_field.T @ touches)
    # `(S, S)` how often two receptors felt at once.
    together = (in_field.T @ at_once.tocsr() @ in_field).tocoo()
    rarer = np.minimum(pressed[together.row], pressed[together.col])
    often = (rarer >= _LEAST_TOUCHES) & (together.data >= _LEAST_SHARED * rarer)
    # A receptor is on the patch that most of its touches are on.
    kept = np.flatnonzero(patch_of >= 0)
    on_patch = coo_array((touches[kept], (kept, patch_of[kept])), shape=(len(touches), num_patches))
    own = np.asarray((in_field.T @ on_patch.tocsr()).todense()).argmax(axis=1)
    pairs = own[np.stack([together.row[often], together.col[often]])]
    joined = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(num_patches,) * 2)
    return connected_components(joined, directed=False)[1]
