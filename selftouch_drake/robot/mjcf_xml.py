"""Small readers and writers of elements of MJCF."""

from typing import Any

import numpy as np

# Elements that have a pose or an axis in a body.
OF_A_BODY = ("body", "frame", "geom", "inertial", "joint", "freejoint")


def collides(geom: Any) -> bool:
    """Whether a geometry collides with anything at all."""
    return any(contact_bits(geom))


def contact_bits(geom: Any) -> tuple[int, int]:
    """`contype` and `conaffinity` of a geometry."""
    contype, affinity = (geom.getAttribute(name) or "1" for name in ("contype", "conaffinity"))
    return int(contype), int(affinity)


def numbers(text: str, wanted: int | None = None) -> list[float]:
    """The numbers of an attribute, as many as `wanted`.

    Raises:
        ValueError: they are fewer or more, or no numbers.
    """
    found = [float(word) for word in text.split()]
    if wanted is not None and len(found) != wanted:
        raise ValueError(f"{text!r} has {len(found)} numbers, not {wanted}")
    return found


def joint_kind(joint: Any) -> str:
    """`hinge`, `slide`, `ball` or `free`."""
    if joint.nodeName == "freejoint":
        return "free"
    return str(joint.getAttribute("type") or "hinge")


def elements(node: Any) -> list[Any]:
    """The elements in another one, without texts and comments."""
    return [child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE]


def keep_attributes(element: Any, names: tuple[str, ...]) -> None:
    """Removes all attributes but some."""
    drop_attributes(element, tuple(n for n in dict(element.attributes.items()) if n not in names))


def drop_attributes(element: Any, names: tuple[str, ...]) -> None:
    """Removes attributes that are there."""
    for name in names:
        if element.hasAttribute(name):
            element.removeAttribute(name)


def number_text(values: Any) -> str:
    """Numbers as an attribute has them, without loss."""
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
