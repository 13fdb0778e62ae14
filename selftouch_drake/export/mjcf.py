"""A robot as MJCF, the format of MuJoCo."""

from xml.etree import ElementTree as ET

from selftouch_drake.export.link_tree import WORLD, Link, LinkTree, Movement
from selftouch_drake.export.xml_text import EFFORT, MADE_UP, child, comment, document, numbers

_KINDS = {"revolute": "hinge", "prismatic": "slide"}


def mjcf_text(tree: LinkTree) -> str:
    """The text of the file; frames are bodies without joints, which Drake reads as well."""
    root = ET.Element("mujoco", {"model": tree.name})
    for text in (*tree.comments, MADE_UP):
        comment(root, text)
    child(root, "compiler", angle="radian", autolimits="true")
    assets = child(root, "asset")
    bodies = {WORLD: child(root, "worldbody")}
    actuators = child(root, "actuator")
    for link in tree.links:
        if link.shape is not None:
            # The surface of a skin need not be closed, and its mass is made up anyway.
            child(assets, "mesh", name=link.shape.name, file=link.shape.file, inertia="shell")
        bodies[link.name] = _add_body(bodies[link.parent], link)
        if link.movement is not None:
            name = link.movement.name
            limit = numbers((-EFFORT, EFFORT))
            child(actuators, "motor", name=name, joint=name, gear="1", ctrlrange=limit)
    return document(root)


def _add_body(parent: ET.Element, link: Link) -> ET.Element:
    found = child(parent, "body", name=link.name, pos=numbers(link.offset))
    comment(found, "made up")
    child(
        found,
        "inertial",
        pos=numbers(link.ball.centre),
        mass=numbers(link.ball.mass),
        diaginertia=numbers([link.ball.inertia] * 3),
    )
    if link.movement is not None:
        _add_movement(found, link.movement)
    if link.shape is not None:
        child(found, "geom", name=link.shape.name, type="mesh", mesh=link.shape.name)
    return found


def _add_movement(body: ET.Element, movement: Movement) -> None:
    comment(body, movement.comment)
    child(
        body,
        "joint",
        name=movement.name,
        type=_KINDS[movement.kind],
        axis=numbers(movement.axis),
        range=numbers((movement.lower, movement.upper)),
    )
