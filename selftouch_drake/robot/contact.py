"""From hydroelastic contact surfaces to receptor readings: the sensor model, phi."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId

from selftouch_drake.geometry import ReceptiveFields


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
    ) -> Touches:
        """Sorts contacts and merges those of one toucher with one skin at one instant.

        Args:
            sensation: `(N, S)` N.
            row: `(C,)` the instant of each contact.
            skin: `(C,)` number of the pressed skin.
            toucher: `(C,)` number of what presses it.
            total: `(C, 4)` N and N m: force, and the sum of force times position in the frame of
                the pressed skin's link. Contacts without force are left out.
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

    def of_rows(self, rows: np.ndarray) -> Touches:
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

    def and_also(self, other: Touches) -> Touches:
        """The touches at the same instants with the contacts of other touchers added."""
        order = np.lexsort(
            [
                np.concatenate([getattr(self, name), getattr(other, name)])
                for name in ("toucher", "skin", "row")
            ]
        )
        return Touches(
            sensation=self.sensation + other.sensation,
            **{
                name: np.concatenate([getattr(self, name), getattr(other, name)])[order]
                for name in ("row", "skin", "toucher", "p_LC")
            },
        )


@dataclass(slots=True)
class PressedFaces:
    """Faces of contact surfaces, gathered over many instants to be processed together.

    These are lists because the inner loop of babbling adds a few faces at a time. Pressure is
    linear on a face, so its value at the centroid times the area is the exact integral.

    Attributes:
        p_WQ: centroid `(3,)` of each face, m, in the world.
        force: pressure integrated over each face, N.
        num_faces: number of faces of each contact.
        row: instant of each contact.
        skin: number of the pressed skin of each contact.
        toucher: number of what presses it, for each contact.
    """

    p_WQ: list[np.ndarray] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    num_faces: list[int] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    skin: list[int] = field(default_factory=list)
    toucher: list[int] = field(default_factory=list)

    def add(self, row: int, skin: int, toucher: int, surface: ContactSurface) -> None:
        """Adds all faces of a contact surface that presses on a skin."""
        pressure = (
            surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()
        ).EvaluateCartesian
        centroid, area = surface.centroid, surface.area
        faces = range(surface.num_faces())
        points = [centroid(face) for face in faces]
        self.p_WQ += points
        self.force += [
            pressure(face, p) * area(face) for face, p in zip(faces, points, strict=True)
        ]
        self.num_faces.append(len(points))
        self.row.append(row)
        self.skin.append(skin)
        self.toucher.append(toucher)


class SensorModel:
    """Computes the readings of all skins of a robot from contact surfaces.

    A receptor integrates the pressure on its skin, weighted by its receptive field. The fields of a
    skin sum to one, so its readings sum to the total normal force on it. If two soft skins press
    each other, both feel the contact.

    Args:
        fields: receptive fields of each skin, in the frame of its link.
        skin_ids: geometry of each skin.
        toucher_ids: geometries of each toucher.
    """

    def __init__(
        self,
        fields: Sequence[ReceptiveFields],
        skin_ids: Sequence[GeometryId],
        toucher_ids: Sequence[Iterable[GeometryId]] = (),
    ):
        self._fields = tuple(fields)
        self._skin_of = {geometry_id: k for k, geometry_id in enumerate(skin_ids)}
        self._toucher_of: Mapping[GeometryId, int] = {
            geometry_id: t
            for t, ids in enumerate(toucher_ids)
            for geometry_id in ids
            if geometry_id not in self._skin_of
        }
        self._num_touchers = len(toucher_ids)
        self._ends = np.cumsum([0, *(f.num_receptors for f in fields)])
        self._sizes = [len(f.vertices) for f in fields]
        self._spread = [f.vertex_weights.T.tocsr() for f in fields]

    @property
    def num_receptors(self) -> int:
        """S, number of receptors of all skins together."""
        return int(self._ends[-1])

    @property
    def readings(self) -> list[slice]:
        """The slice of a sensation that holds the readings of each skin."""
        return [slice(a, b) for a, b in itertools.pairwise(self._ends.tolist())]

    def gather(self, into: PressedFaces, row: int, surfaces: Iterable[ContactSurface]) -> None:
        """Adds all contact surfaces that press on skins at one instant to `into`."""
        for surface in surfaces:
            ends = surface.id_M(), surface.id_N()
            for pressed, pressing in (ends, ends[::-1]):
                if (skin := self._skin_of.get(pressed)) is not None:
                    into.add(row, skin, self._presser(pressing), surface)

    def _presser(self, geometry_id: GeometryId) -> int:
        if (skin := self._skin_of.get(geometry_id)) is not None:
            return self._num_touchers + skin
        # Not named in the experiment, for instance the floor of a user's own diagram.
        return self._toucher_of.get(geometry_id, -1)

    def touches(self, faces: PressedFaces, X_WL: np.ndarray) -> Touches:
        """The touches that the gathered faces cause.

        Args:
            faces: faces at N instants.
            X_WL: `(N, skins, 3, 4)` poses of the links that wear the skins.
        """
        sensation = np.zeros((len(X_WL), self.num_receptors))
        row, skin, toucher, num_faces = (
            np.array(column, dtype=int)
            for column in (faces.row, faces.skin, faces.toucher, faces.num_faces)
        )
        force = np.array(faces.force)
        p_LQ = _in_frames(np.array(faces.p_WQ), np.repeat(X_WL[row, skin], num_faces, axis=0))
        ends = np.cumsum([0, *num_faces])
        for number, k in enumerate(skin):
            faces_of = slice(ends[number], ends[number + 1])
            corner, part = self._fields[k].parts_at(p_LQ[faces_of])
            # Forces are summed at the corners of the surface first, because there are fewer.
            load = np.bincount(
                corner.ravel(), (force[faces_of, None] * part).ravel(), self._sizes[k]
            )
            felt = self._spread[k] @ load
            sensation[row[number], self._ends[k] : self._ends[k + 1]] += felt
        total = np.zeros((len(row), 4))
        contact = np.repeat(np.arange(len(row)), num_faces)
        np.add.at(total, contact, np.column_stack([force, force[:, None] * p_LQ]))
        return Touches.of(sensation, row, skin, toucher, total)


def _in_frames(p_WQ: np.ndarray, X_WL: np.ndarray) -> np.ndarray:
    """`(N, 3)` points given in the world, each expressed in its own frame `(N, 3, 4)`."""
    return np.einsum("ni,nij->nj", p_WQ.reshape(-1, 3) - X_WL[:, :, 3], X_WL[:, :, :3])
