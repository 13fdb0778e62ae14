"""Other origins and axes of joints in the text of a URDF, with all else as it is."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

# Digits of numbers that are written.
_DIGITS = 9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NewOrigin:
    """What becomes of a joint's frame and axis.

    Attributes:
        shift: `(3,)` m, along the axes of its frame as it was.
        turn: `(3,)` rad, rotation vector in that frame.
        axis: `(3,)` in its frame; None if it stays.
    """

    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis: np.ndarray | None = None


@dataclass(slots=True)
class _Joint:
    """Where the tags of a joint begin and end in the bytes of a file; None if there is no tag."""

    tag: tuple[int, int]
    origin: tuple[int, int] | None = None
    axis: tuple[int, int] | None = None


def with_origins(text: bytes, joints: Mapping[str, NewOrigin]) -> bytes:
    """A URDF with other origins and axes; every other byte stays.

    Args:
        text: of the file.
        joints: by name; names that the file does not have are left out.
    """
    found = _joints(text)
    edits: list[tuple[int, int, bytes]] = []
    for name, new in joints.items():
        if name not in found:
            continue
        place = found[name]
        if new.shift.any() or new.turn.any():
            edits.append(_origin_edit(text, place, new))
        if new.axis is not None:
            edits.append(_axis_edit(text, place, new.axis))
    for start, end, fresh in sorted(edits, key=lambda edit: edit[:2], reverse=True):
        text = text[:start] + fresh + text[end:]
    return text


def _joints(text: bytes) -> dict[str, _Joint]:
    """The joints of a robot, by name."""
    found: dict[str, _Joint] = {}
    path: list[str] = []
    parser = expat.ParserCreate()

    def begins(tag: str, attributes: dict[str, str]) -> None:
        path.append(tag)
        span = parser.CurrentByteIndex, _tag_end(text, parser.CurrentByteIndex)
        if path == ["robot", "joint"]:
            found[attributes.get("name", "")] = _Joint(span)
        elif path[:-1] == ["robot", "joint"] and tag in ("origin", "axis"):
            setattr(list(found.values())[-1], tag, span)

    parser.StartElementHandler = begins
    parser.EndElementHandler = lambda tag: path.pop()
    parser.Parse(text, True)
    return found


def _tag_end(text: bytes, start: int) -> int:
    """Behind the tag that begins at `start`; values of attributes may hold a `>`."""
    match = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(text, start)
    assert match is not None
    return match.end()


def _origin_edit(text: bytes, place: _Joint, new: NewOrigin) -> tuple[int, int, bytes]:
    tag = text[slice(*place.origin)] if place.origin else b"<origin/>"
    xyz, rpy = (_numbers(tag, name, 3) for name in ("xyz", "rpy"))
    turn = Rotation.from_euler("xyz", rpy)
    fresh = tag
    if new.shift.any():
        fresh = _with(fresh, "xyz", xyz + turn.apply(new.shift))
    if new.turn.any():
        fresh = _with(fresh, "rpy", (turn * Rotation.from_rotvec(new.turn)).as_euler("xyz"))
    return _edit(text, place, place.origin, fresh)


def _axis_edit(text: bytes, place: _Joint, axis: np.ndarray) -> tuple[int, int, bytes]:
    tag = text[slice(*place.axis)] if place.axis else b"<axis/>"
    return _edit(text, place, place.axis, _with(tag, "xyz", axis))


def _edit(
    text: bytes, place: _Joint, span: tuple[int, int] | None, fresh: bytes
) -> tuple[int, int, bytes]:
    """A tag instead of one, or a new tag behind that of the joint, on a line of its own."""
    if span is not None:
        return *span, fresh
    start, end = place.tag
    line = text.rfind(b"\n", 0, start) + 1
    indent = re.match(rb"[ \t]*", text[line:start])
    assert indent is not None
    return end, end, b"\n" + indent[0] + b"  " + fresh


def _numbers(tag: bytes, name: str, count: int) -> np.ndarray:
    match = _attribute(name).search(tag)
    if match is None:
        return np.zeros(count)
    return np.array([float(number) for number in match[1][1:-1].split()])


def _with(tag: bytes, name: str, numbers: np.ndarray) -> bytes:
    """The tag with an attribute, at its place if it is there."""
    written = " ".join(f"{number + 0.0:.{_DIGITS}g}" for number in np.round(numbers, 12))
    match = _attribute(name).search(tag)
    if match is not None:
        start, end = match.span(1)
        quote = match[1][:1]
        return tag[:start] + quote + written.encode() + quote + tag[end:]
    close = len(tag) - (2 if tag.endswith(b"/>") else 1)
    return tag[:close].rstrip() + f' {name}="{written}"'.encode() + tag[close:]


def _attribute(name: str) -> re.Pattern[bytes]:
    return re.compile(rb"""\s""" + name.encode() + rb"""\s*=\s*("[^"]*"|'[^']*')""")
