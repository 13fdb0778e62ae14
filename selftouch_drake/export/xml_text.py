"""Numbers, comments and elements of XML files, as the writers of all formats need them."""

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

#: N or N m, and per second: of joints, made up, because touch tells neither.
EFFORT, VELOCITY = 100.0, 10.0

MADE_UP = (
    "masses, inertias, efforts and velocities are made up, because touch tells none of them: each "
    "link weighs as a ball"
)


def numbers(values: Iterable[float] | float) -> str:
    """Numbers with all their digits, separated by spaces."""
    return " ".join(repr(float(value) + 0.0) for value in np.atleast_1d(values))  # type: ignore[arg-type]


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """A new element in another; attributes are written as they are."""
    found = ET.SubElement(parent, tag, attributes)
    found.text = text
    return found


def comment(parent: ET.Element, text: str) -> None:
    """A comment; two dashes in a row would end it."""
    while "--" in text:
        text = text.replace("--", "- -")
    parent.append(ET.Comment(f" {text.rstrip('-')} "))


def document(root: ET.Element) -> str:
    """The text of a file."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
