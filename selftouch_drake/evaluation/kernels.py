"""Where motor kernel sets truly touch. The experimenter's side: reads the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.representation import QuotientRepresentation
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
        share_single: of all configurations of the kernels, those with one contact alone.
    """

    skin: np.ndarray
    positions: np.ndarray
    spread: np.ndarray
    share_single: float

    @property
    def is_surface(self) -> bool:
        """Whether a kernel is a place on a skin, so that a shape can be compared with it."""
        return self.share_single >= LEAST_SINGLE

    def on_surface(self, fields: Sequence[ReceptiveFields]) -> KernelTruth:
        """The same kernels at the places of the skins' surfaces where receptors feel them.

        A contact lies inside the skin, which gives way: 1.5 cm deep in a skin of 3 cm.
        """
        positions = self.positions.copy()
        for number, field in enumerate(fields):
            here = self.skin == number
            vertices, weights = field.parts_at(positions[here])
            positions[here] = np.einsum("nv,nvi->ni", weights, field.vertices[vertices])
        return replace(self, positions=positions)


def kernel_truth(representation: QuotientRepresentation, contacts: Contacts) -> KernelTruth:
    """Where each motor kernel set truly touches.

    The contacts are those of each row of `kernel_q`, as `ExperienceReader.take_contacts` gives them
    for `kernel_row`.

    Raises:
        ValueError: there are contacts of another number of rows, or a kernel has none at all.
    """
    if len(contacts) != len(representation.kernel_row):
        raise ValueError(
            f"contacts has {len(contacts)} rows, the kernels "
            f"{len(representation.kernel_row)}; give one for each of kernel_row"
        )
    skin, positions, spread = [], [], []
    for kernel in range(representation.num_targets):
        rows = representation.members(kernel)
        here = slice(*contacts.offsets[[rows.start, rows.stop]])
        if here.start == here.stop:
            raise ValueError(
                f"kernel {kernel} has no contact; the truth belongs to another experience"
            )
        pressed = int(np.bincount(contacts.skin[here]).argmax())
        p_LC = contacts.p_LC[here][contacts.skin[here] == pressed].astype(float)
        skin.append(pressed)
        positions.append(np.median(p_LC, axis=0))
        spread.append(np.sqrt(p_LC.var(axis=0).sum()))
    return KernelTruth(
        skin=np.array(skin),
        positions=np.array(positions),
        spread=np.array(spread),
        share_single=float(np.mean(np.diff(contacts.offsets) == 1)),
    )
