"""From hydroelastic contact surfaces to receptor readings: the sensor model, phi."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.robot.faces import Faces
from selftouch_drake.robot.pairs import Toucher, WornSkin
from selftouch_drake.robot.soft_skin import SoftSkin, press_faces, soft_skin


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touches:
    """Sensations at N instants, and the C contacts that cause them.

    Attributes:
        sensation: `(N, S)` N, the readings of all skins in order; exactly zero without contact.
        row: `(C,)` the instant of each contact, ascending.
        skin: `(C,)` number of the pressed skin.
        toucher: `(C,)` number of what presses it: touchers are counted first, then skins.
        p_LC: `(C, 3)` m, centre of pressure in the frame of the pressed skin's link.
    """

    sensation: np.ndarray
    row: np.ndarray
    skin: np.ndarray
    toucher: np.ndarray
    p_LC: np.ndarray

    @staticmethod
    def of(
        sensation: np.ndarray,
        row: np.ndarray,
        skin: np.ndarray,
        toucher: np.ndarray,
        total: np.ndarray,
    ) -> "Touches":
        """Sorts contacts and merges those of one toucher with one skin at one instant.

        The total of each is `(C, 4)` N and N m: force, and the sum of force times position in the
        frame of the pressed skin's link. Contacts without force are left out.
        """
        # Mostly there is one contact at an instant, and the instants are in order.
        if not (row[1:] > row[:-1]).all():
            order = np.lexsort([toucher, skin, row])
            key = np.stack([row, skin, toucher], axis=1)[order]
            first = np.flatnonzero(np.any(np.diff(key, axis=0, prepend=-1) != 0, axis=1))
            total = np.add.reduceat(total[order], first, axis=0)
            row, skin, toucher = key[first].T
        pressed = total[:, 0] > 0
        return Touches(
            sensation=sensation,
            row=row[pressed],
            skin=skin[pressed],
            toucher=toucher[pressed],
            p_LC=total[pressed, 1:] / total[pressed, :1],
        )

    def of_rows(self, rows: np.ndarray) -> "Touches":
        """The touches at some of the instants, given in ascending order."""
        number = np.full(len(self.sensation), -1)
        number[rows] = np.arange(len(rows))
        kept = number[self.row] >= 0
        return Touches(
            sensation=self.sensation[rows],
            row=number[self.row[kept]],
            skin=self.skin[kept],
            toucher=self.toucher[kept],
            p_LC=self.p_LC[kept],
        )

    def and_also(self, other: "Touches") -> "Touches":
        """The touches at the same instants with the contacts of other touchers added."""
        columns = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("toucher", "skin", "row", "p_LC")
        }
        order = np.lexsort([columns[name] for name in ("toucher", "skin", "row")])
        return Touches(
            sensation=self.sensation + other.sensation,
            **{name: column[order] for name, column in columns.items()},
        )


class SensorModel:
    """Computes the readings of all skins of a robot from contact surfaces.

    A receptor integrates the pressure on its skin, weighted by its receptive field. The fields of a
    skin sum to one, so its readings sum to the total normal force on it. If two soft skins press
    each other, both feel the contact.

    Args:
        skins: in the order of their readings.
        touchers: what else has a number as `Touches.toucher`; all others are -1.
    """

    def __init__(self, skins: Sequence[WornSkin], touchers: Sequence[Toucher] = ()):
        self._models = [skin.model for skin in skins]
        # Of the skins that something has pressed so far.
        self._soft: dict[int, SoftSkin] = {}
        self._skin_of = {skin.geometry_id: k for k, skin in enumerate(skins)}
        self._toucher_of = {g: t for t, each in enumerate(touchers) for g in each.geometry_ids}
        self._toucher_of |= {g: len(touchers) + skin for g, skin in self._skin_of.items()}
        ends = np.cumsum([0, *(model.fields.num_receptors for model in self._models)]).tolist()
        #: The slice of a sensation that holds the readings of each skin.
        self.columns_of_skin = [slice(a, b) for a, b in itertools.pairwise(ends)]
        #: S, number of receptors of all skins together.
        self.num_receptors = self.columns_of_skin[-1].stop

    def touches(self, surfaces: Iterable[tuple[int, Faces]], X_WL: np.ndarray) -> "Touches":
        """The touches that contact surfaces cause at N instants.

        Args:
            surfaces: each with its instant, in any order; those that press no skin are left out.
            X_WL: `(N, skins, 3, 4)` poses of the links that wear the skins.
        """
        sensation = np.zeros((len(X_WL), self.num_receptors))
        contacts, totals = [], []
        for row, faces in surfaces:
            for skin, toucher, total in self.press(faces, X_WL[row], sensation[row]):
                contacts.append((row, skin, toucher))
                totals.append(total)
        row_of, skin_of, toucher_of = np.array(contacts, dtype=int).reshape(-1, 3).T
        return Touches.of(sensation, row_of, skin_of, toucher_of, np.reshape(totals, (-1, 4)))

    def press(
        self, faces: Faces, X_WL: np.ndarray, felt: np.ndarray
    ) -> list[tuple[int, int, np.ndarray]]:
        """Adds what a contact surface causes to what is `felt` `(S,)` N.

        The links have poses `(skins, 3, 4)`. Returns skin, toucher and total as in `Touches.of`,
        for each skin that is pressed.
        """
        found = []
        for pressed, pressing in (faces.ends, faces.ends[::-1]):
            if (skin := self._skin_of.get(pressed)) is None:
                continue
            if skin not in self._soft:
                first = self.columns_of_skin[skin].start
                self._soft[skin] = soft_skin(self._models[skin], first)
            X, total = np.ascontiguousarray(X_WL[skin]), np.zeros(4)
            press_faces(self._soft[skin], faces.centroid, faces.force, X, felt, total)
            # Without a number is, for instance, the floor of a user's own diagram.
            found.append((skin, self._toucher_of.get(pressing, -1), total))
        return found
