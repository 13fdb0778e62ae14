"""A robot as SDFormat."""

from xml.etree import ElementTree as ET

from selftouch_drake.export.link_tree import WORLD, Link, LinkTree, Movement, Shape
from selftouch_drake.export.xml_text import (
    EFFORT,
    MADE_UP,
    VELOCITY,
    child,
    comment,
    document,
    numbers,
)

_VERSION = "1.9"
_NO_TURN = " 0 0 0"


def sdformat_text(tree: LinkTree) -> str:
    """The text of the file.

    Names of SDFormat hold no `::`, which stands between a model and what is in it: it becomes `__`.
    """
    root = ET.Element("sdf", {"version": _VERSION})
    model = child(root, "model", name=_name(tree.name))
    for text in (*tree.comments, MADE_UP):
        comment(model, text)
    frames = {link.name: link for link in tree.links if link.is_frame}
    for link in tree.links:
        if link.is_frame:
            _add_frame(model, link)
        else:
            worn = [frame for frame in frames.values() if frame.parent == link.name]
            _add_link(model, link, worn)
            _add_joint(model, link)
    standing = [frame for frame in frames.values() if frame.parent == WORLD and frame.shape]
    if standing:
        _add_standing(model, standing)
    return document(root)


def _name(text: str) -> str:
    return text.replace("::", "__")


def _add_frame(model: ET.Element, link: Link) -> None:
    found = child(model, "frame", name=_name(link.name), attached_to=_name(link.parent))
    child(found, "pose", numbers(link.offset) + _NO_TURN)


def _add_link(model: ET.Element, link: Link, worn: list[Link]) -> None:
    found = child(model, "link", name=_name(link.name))
    pose = child(found, "pose", numbers(link.offset) + _NO_TURN)
    if link.parent != WORLD:
        pose.set("relative_to", _name(link.parent))
    inertial = child(found, "inertial")
    comment(inertial, "made up")
    child(inertial, "pose", numbers(link.ball.centre) + _NO_TURN)
    child(inertial, "mass", numbers(link.ball.mass))
    inertia = child(inertial, "inertia")
    for entry in ("ixx", "iyy", "izz"):
        child(inertia, entry, numbers(link.ball.inertia))
    for entry in ("ixy", "ixz", "iyz"):
        child(inertia, entry, "0")
    if link.shape is not None:
        _add_shape(found, link.shape, "0 0 0")
    for frame in worn:
        if frame.shape is not None:
            _add_shape(found, frame.shape, numbers(frame.offset))


def _add_shape(link: ET.Element, shape: Shape, offset: str) -> None:
    for tag in ("visual", "collision"):
        found = child(link, tag, name=f"{_name(shape.name)}_{tag}")
        child(found, "pose", offset + _NO_TURN)
        child(child(child(found, "geometry"), "mesh"), "uri", shape.file)


def _add_joint(model: ET.Element, link: Link) -> None:
    movement = link.movement
    if movement is None:
        found = child(model, "joint", name=f"{_name(link.name)}_fixed", type="fixed")
    else:
        comment(model, movement.comment)
        found = child(model, "joint", name=_name(movement.name), type=movement.kind)
    child(found, "parent", _name(link.parent))
    child(found, "child", _name(link.name))
    if movement is not None:
        _add_movement(found, movement)


def _add_movement(joint: ET.Element, movement: Movement) -> None:
    axis = child(joint, "axis")
    child(axis, "xyz", numbers(movement.axis))
    limit = child(axis, "limit")
    child(limit, "lower", numbers(movement.lower))
    child(limit, "upper", numbers(movement.upper))
    child(limit, "effort", numbers(EFFORT))
    child(limit, "velocity", numbers(VELOCITY))


def _add_standing(model: ET.Element, frames: list[Link]) -> None:
    """The surfaces of touchers that stand still: no link but the world carries them."""
    found = child(model, "link", name="standing_touchers")
    for frame in frames:
        assert frame.shape is not None
        _add_shape(found, frame.shape, numbers(frame.offset))
    joint = child(model, "joint", name="standing_touchers_fixed", type="fixed")
    child(joint, "parent", WORLD)
    child(joint, "child", "standing_touchers")
