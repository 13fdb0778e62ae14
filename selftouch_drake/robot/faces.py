"""The faces of contact surfaces: where they are in the world, and the force on each.

Drake's Python gives three numbers of one face at a time. Its message for visualisers has all
vertices, pressures and polygons of all contacts at once, and is made in C++: a plant's contacts are
read from that.
"""

import struct
import threading
from collections.abc import Iterator, Set
from functools import cache
from typing import Any, NamedTuple

import drake
import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import ContactSurface, GeometryId
from pydrake.multibody.plant import ContactResults, ContactResultsToLcmSystem, MultibodyPlant
from pydrake.systems.framework import Context
from pydrake.systems.lcm import _Serializer_

from selftouch_drake.compiled import compiled
from selftouch_drake.robot.models import one_line

_VALUE = Value[ContactResults]

# As they are in a message.
_NUMBERS = {"double": ">f8", "int32_t": ">i4", "int64_t": ">i8", "boolean": "?"}
_SIZES = {number: np.dtype(number).itemsize for number in _NUMBERS.values()}
_COUNT = struct.Struct(">i")
# What is read of a contact; to skip the rest halves the time.
_NEEDED = {"poly_data", "p_WV", "pressure"}


class Faces(NamedTuple):
    """The F faces of one contact surface.

    Attributes:
        ends: the two geometries that are in contact.
        centroid: `(F, 3)` m, in the world.
        force: `(F,)` N, the pressure integrated over each face.
    """

    ends: tuple[GeometryId, GeometryId]
    centroid: np.ndarray
    force: np.ndarray

    @staticmethod
    def of(surface: ContactSurface) -> "Faces":
        """Reads a contact surface face by face."""
        pressure = surface.tri_e_MN() if surface.is_triangle() else surface.poly_e_MN()
        points = [surface.centroid(face) for face in range(surface.num_faces())]
        # Pressure is linear on a face: its value at the centroid times the area is its integral.
        force = [
            pressure.EvaluateCartesian(face, p) * surface.area(face)
            for face, p in enumerate(points)
        ]
        ends = surface.id_M(), surface.id_N()
        return Faces(ends, np.array(points).reshape(-1, 3), np.array(force))


class FaceReader:
    """Reads the hydroelastic contacts of a finalized plant, all faces of a contact at once."""

    def __init__(self, plant: MultibodyPlant):
        # Drake warns that links with several geometries may be unclear in a viewer that is not
        # there.
        with one_line("contacts cannot be read"):
            self._to_message = ContactResultsToLcmSystem(plant)
        self._input = self._to_message.get_input_port(0)
        self._output = self._to_message.get_output_port(0)
        self._encode = _Serializer_[drake.lcmt_contact_results_for_viz]().Serialize
        self._of_thread = threading.local()

    def _own_context(self) -> Context:
        """A context of this thread, which is used again: a new one takes longer than a message."""
        if not hasattr(self._of_thread, "context"):
            self._of_thread.context = self._to_message.CreateDefaultContext()
        return self._of_thread.context

    def read(self, contact: ContactResults, geometries: Set[GeometryId]) -> "Iterator[Faces]":
        """The faces of each contact of one of some geometries."""
        surfaces = [
            contact.hydroelastic_contact_info(i).contact_surface()
            for i in range(contact.num_hydroelastic_contacts())
        ]
        ends = [(surface.id_M(), surface.id_N()) for surface in surfaces]
        if all(geometries.isdisjoint(pair) for pair in ends):
            return
        context = self._own_context()
        self._input.FixValue(context, _VALUE(contact))
        data = self._encode(self._output.EvalAbstract(context))
        # A message starts with the eight bytes of its type.
        message, _ = _decode(_fields(drake.lcmt_contact_results_for_viz), data, 8)
        read = message["hydroelastic_contacts"]
        for surface, pair, found in zip(surfaces, ends, read, strict=True):
            if not geometries.isdisjoint(pair):
                polygons, p, pressure = (
                    found[name].astype(kind)
                    for name, kind in (("poly_data", int), ("p_WV", float), ("pressure", float))
                )
                num_faces = surface.num_faces()
                yield Faces(pair, *_of_polygons(polygons, p.reshape(-1, 3), pressure, num_faces))


class _Field(NamedTuple):
    """A field of an LCM type.

    Attributes:
        name: of the field.
        size: bytes of an item; 0 for a text, and for a part.
        number: its type in NumPy; empty for a text, and for a part.
        part: the fields of an item that has fields itself.
        shape: how many items, or the field that says it; None for a single one.
    """

    name: str
    size: int
    number: str
    part: "tuple[_Field, ...]"
    shape: int | str | None


@cache
def _fields(kind: Any) -> tuple[_Field, ...]:
    """The fields of an LCM type, in their order."""
    found = []
    for name, called, shape in zip(
        kind.__slots__, kind.__typenames__, kind.__dimensions__, strict=True
    ):
        number = _NUMBERS.get("double" if called == "drake.lcmt_point" else called, "")
        size = np.dtype(number).itemsize if number else 0
        size *= 3 if called == "drake.lcmt_point" else 1
        is_part = not number and called != "string"
        part = _fields(getattr(drake, called.removeprefix("drake."))) if is_part else ()
        found.append(_Field(name, size, number, part, None if shape is None else shape[0]))
    return tuple(found)


def _decode(fields: tuple[_Field, ...], data: bytes, at: int) -> tuple[dict[str, Any], int]:
    """What is needed of an LCM message from a place in its bytes, and where it ends."""
    found: dict[str, Any] = {}
    for name, size, number, part, shape in fields:
        num = 1 if shape is None else found[shape] if isinstance(shape, str) else shape
        if name in _NEEDED:
            found[name] = np.frombuffer(data, number, num * size // _SIZES[number], at)
        elif size == _SIZES[">i4"] and shape is None:
            (found[name],) = _COUNT.unpack_from(data, at)
        elif part:
            found[name] = []
            for _ in range(num):
                item, at = _decode(part, data, at)
                found[name].append(item)
        elif not size:
            at += 4 + _COUNT.unpack_from(data, at)[0]
        at += num * size
    return found, at


@compiled
def _of_polygons(polygons, p, pressure, num):
    """Centroids and forces as in `Faces` of `num` polygons, on which pressure `(V,)` Pa is linear.

    Each is as many vertices of `p` `(V, 3)` m as the number before them says.
    """
    centroid, force, at = np.zeros((num, 3)), np.zeros(num), 0
    for face in range(num):
        a, end, whole = polygons[at + 1], at + polygons[at] + 1, 0.0
        for corner in range(at + 2, end - 1):
            b, c, square = polygons[corner], polygons[corner + 1], 0.0
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                across = (p[b, j] - p[a, j]) * (p[c, k] - p[a, k])
                across -= (p[b, k] - p[a, k]) * (p[c, j] - p[a, j])
                square += across * across
            area = np.sqrt(square) / 2
            whole += area
            force[face] += area * (pressure[a] + pressure[b] + pressure[c]) / 3
            for i in range(3):
                centroid[face, i] += area * (p[a, i] + p[b, i] + p[c, i]) / 3
        for i in range(3):
            centroid[face, i] = centroid[face, i] / whole if whole > 0.0 else p[a, i]
        at = end
    return centroid, force
