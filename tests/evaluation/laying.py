"""Touches that tests place on skins by hand."""

import numpy as np

from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.experience.store import Contacts
from selftouch_drake.geometry import farthest, receptors


def skin_fields(surface, num_receptors=30):
    """Fields of receptors on a surface."""
    p_LS = receptors.place_receptors(surface, num_receptors, seed=0)
    return receptors.receptive_fields(surface, p_LS)


class Hand:
    """Places touches on skins, with one or more contacts each."""

    def __init__(self):
        self._rows = []

    def touch(self, *contacts):
        """Adds one touch: skin, toucher and position (m) of each contact."""
        self._rows.append(sorted(contacts, key=lambda contact: contact[:2]))
        return self

    def touch_all(self, places, skin=0, toucher=0):
        """Adds one touch for each position `(n, 3)` m."""
        for place in places:
            self.touch((skin, toucher, place))
        return self

    def contacts(self):
        """All touches, in their order."""
        counts = [len(row) for row in self._rows]
        every = [contact for row in self._rows for contact in row]
        return Contacts(
            offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            skin=np.array([skin for skin, _, _ in every], dtype=np.int8),
            toucher=np.array([toucher for _, toucher, _ in every], dtype=np.int8),
            p_LC=np.array([place for _, _, place in every], dtype=np.float32).reshape(-1, 3),
        )


def places(fields, number, seed=0, *, where=lambda p: np.ones(len(p), dtype=bool)):
    """`(number, 3)` m, positions spread just below a surface, where `where` is true."""
    rng = np.random.default_rng(seed)
    a, b, c = fields.vertices[fields.faces].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    found = np.zeros((0, 3))
    while len(found) < number:
        face = rng.choice(len(fields.faces), 2 * number, p=area / area.sum())
        corners = fields.vertices[fields.faces[face]]
        p = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), len(face)), corners)
        found = np.concatenate([found, p[where(p)]])
    return 0.98 * found[:number]


def kernels_on(touched, skins=None, number=60):
    """Kernels spread over the places `(n, 3)` that were touched on each skin."""
    positions, skin = [], []
    for s, p in enumerate(touched):
        chosen = farthest.farthest_points(
            lambda k, p=p: np.linalg.norm(p - p[k], axis=1), min(number, len(p))
        )
        positions.append(p[chosen])
        skin.append(np.full(len(chosen), s if skins is None else skins[s]))
    positions = np.concatenate(positions)
    return KernelTruth(
        skin=np.concatenate(skin),
        positions=positions,
        spread=np.full(len(positions), 0.01),
        share_single=1.0,
    )
