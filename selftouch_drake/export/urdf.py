"""A robot as URDF."""

from xml.etree import ElementTree as ET

from selftouch_drake.export.link_tree import WORLD, Ball, Link, LinkTree, Movement
from selftouch_drake.export.xml_text import (
    EFFORT,
    MADE_UP,
    VELOCITY,
    child,
    comment,
    document,
    numbers,
)


def urdf_text(tree: LinkTree) -> str:
    """The text of the file; frames are links on fixed joints, because URDF has no others."""
    root = ET.Element("robot", {"name": tree.name})
    for text in (*tree.comments, MADE_UP):
        comment(root, text)
    child(root, "link", name=WORLD)
    for link in tree.links:
        _add_link(root, link)
    for link in tree.links:
        _add_joint(root, link)
    for link in tree.links:
        if link.movement is not None:
            _add_transmission(root, link.movement.name)
    return document(root)


def _add_link(root: ET.Element, link: Link) -> None:
    found = child(root, "link", name=link.name)
    _add_inertial(found, link.ball)
    if link.shape is None:
        return
    for tag in ("visual", "collision"):
        shape = child(found, tag, name=f"{link.shape.name}_{tag}")
        child(child(shape, "geometry"), "mesh", filename=link.shape.file)


def _add_inertial(link: ET.Element, ball: Ball) -> None:
    found = child(link, "inertial")
    comment(found, "made up")
    child(found, "origin", xyz=numbers(ball.centre), rpy="0 0 0")
    child(found, "mass", value=numbers(ball.mass))
    same, none = numbers(ball.inertia), "0"
    child(found, "inertia", ixx=same, ixy=none, ixz=none, iyy=same, iyz=none, izz=same)


def _add_joint(root: ET.Element, link: Link) -> None:
    movement = link.movement
    if movement is not None:
        comment(root, movement.comment)
        found = child(root, "joint", name=movement.name, type=movement.kind)
    else:
        found = child(root, "joint", name=f"{link.name}_fixed", type="fixed")
    child(found, "parent", link=link.parent)
    child(found, "child", link=link.name)
    child(found, "origin", xyz=numbers(link.offset), rpy="0 0 0")
    if movement is not None:
        _add_movement(found, movement)


def _add_movement(joint: ET.Element, movement: Movement) -> None:
    child(joint, "axis", xyz=numbers(movement.axis))
    child(
        joint,
        "limit",
        lower=numbers(movement.lower),
        upper=numbers(movement.upper),
        effort=numbers(EFFORT),
        velocity=numbers(VELOCITY),
    )


def _add_transmission(root: ET.Element, joint: str) -> None:
    interface = "hardware_interface/EffortJointInterface"
    found = child(root, "transmission", name=f"{joint}_transmission")
    child(found, "type", "transmission_interface/SimpleTransmission")
    child(child(found, "joint", name=joint), "hardwareInterface", interface)
    actuator = child(found, "actuator", name=f"{joint}_actuator")
    child(actuator, "hardwareInterface", interface)
    child(actuator, "mechanicalReduction", "1")
