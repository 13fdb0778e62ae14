"""MJCF written out in full, as MuJoCo reads it, for a parser that knows less.

Drake's parser drops what a class of defaults inherits, `<frame>` elements, and more, without a
word. So every default, angle and frame is written where it applies before Drake reads a file; what
cannot be written that way is refused.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.mjcf_defaults import fill_in, read_defaults
from selftouch_drake.robot.mjcf_poses import dissolve, give_ends_a_pose, orient
from selftouch_drake.robot.mjcf_xml import (
    OF_A_BODY,
    collides,
    drop_attributes,
    elements,
    joint_kind,
    keep_attributes,
    number_text,
    numbers,
)

# Elements that add bodies or couple them in ways that no tree of joints has.
_REFUSED = {
    "replicate": "copies bodies",
    "attach": "adds bodies of another file",
    "composite": "makes bodies",
    "flexcomp": "makes soft bodies",
    "flex": "is a soft body",
}
# Sections and elements that change no pose, no limit, no mass and no collision.
_NEITHER_HERE_NOR_THERE = (
    *("visual", "statistic", "size", "custom", "extension", "sensor", "keyframe", "light"),
    *("camera", "site", "skin", "plugin", "texture", "hfield"),
)
# Attributes of `<option>` that Drake reads.
_OPTIONS = ("gravity",)
# Attributes that only MuJoCo's solver or actuators use, or that are read here.
_UNUSED = {
    "joint": ("margin", "actuatorfrcrange", "actuatorfrclimited", "actuatorgravcomp", "group"),
    "geom": ("gap", "margin", "priority", "solmix", "condim", "contype", "conaffinity"),
}


def write_out(document: Any, path: Path) -> None:
    """Writes defaults, angles, frames and limits where they apply; changes the document.

    What files include is in its place already. Then every orientation is a `quat`, every angle is
    in radians, every joint says whether it is limited, every end of a `fromto` became a pose, and
    everything has a name.

    Raises:
        ExperimentError: the file holds what only MuJoCo can make, or what MuJoCo refuses too.
    """
    root = document.documentElement
    compiler = _one_compiler(document)
    for kind, what in _REFUSED.items():
        if found := document.getElementsByTagName(kind):
            raise ExperimentError(
                f"{path}: <{kind}> {found[0].getAttribute('name')!r} {what}, which is not read; "
                "let MuJoCo write the model out, with mujoco.mj_saveLastXML"
            )
    for kind in _NEITHER_HERE_NOR_THERE:
        for element in list(document.getElementsByTagName(kind)):
            if element.parentNode.nodeName != "default":
                element.parentNode.removeChild(element)
    fill_in(document, read_defaults(root), path)
    for option in document.getElementsByTagName("option"):
        keep_attributes(option, _OPTIONS)
    _rename(document)
    _check_meshes(document, compiler, path)
    to_radians = _angles(compiler)
    order = compiler.getAttribute("eulerseq") or "xyz"
    for kind in OF_A_BODY:
        for element in document.getElementsByTagName(kind):
            orient(element, to_radians, order)
    for joint in _joints_of(document):
        _limit(joint, compiler, to_radians, path)
    for geom in document.getElementsByTagName("geom"):
        give_ends_a_pose(geom, path)
    for frame in reversed(list(document.getElementsByTagName("frame"))):
        dissolve(frame)
    compiler.setAttribute("angle", "radian")
    for name in ("eulerseq", "autolimits"):
        if compiler.hasAttribute(name):
            compiler.removeAttribute(name)


def strip_for_drake(document: Any) -> None:
    """Removes what Drake warns of although it was read here, or has no meaning without MuJoCo."""
    pairs = document.getElementsByTagName("pair")
    paired = {pair.getAttribute(end) for pair in pairs for end in ("geom1", "geom2")}
    for kind in ("actuator", "contact", "equality", "tendon"):
        for section in list(document.getElementsByTagName(kind)):
            section.parentNode.removeChild(section)
    for body in list(document.getElementsByTagName("body")):
        _split_by_joint(document, body)
    for material in document.getElementsByTagName("material"):
        drop_attributes(material, ("texture", "texrepeat", "texuniform"))
    for element in document.getElementsByTagName("*"):
        drop_attributes(element, ("user",))
    for kind, names in _UNUSED.items():
        for element in document.getElementsByTagName(kind):
            # The zeros of a geometry that collides with nothing stay.
            if kind != "geom" or collides(element) or element.getAttribute("name") in paired:
                drop_attributes(element, names)
            if kind == "geom" and element.hasAttribute("friction"):
                element.setAttribute("friction", element.getAttribute("friction").split()[0])


def _split_by_joint(document: Any, body: Any) -> None:
    """Gives each joint of a body but the last one a body of its own, without mass.

    Drake reads the axes of several joints of one body in the frame of its parent.
    """
    *first, _ = [child for child in elements(body) if child.nodeName == "joint"] or [None]
    for joint in first:
        carrier = document.createElement("body")
        carrier.setAttribute("name", f"{body.getAttribute('name')}_{joint.getAttribute('name')}")
        for name in ("pos", "quat"):
            if body.hasAttribute(name):
                carrier.setAttribute(name, body.getAttribute(name))
                body.removeAttribute(name)
        body.parentNode.replaceChild(carrier, body)
        carrier.appendChild(joint)
        carrier.appendChild(body)


def _one_compiler(document: Any) -> Any:
    """Joins the `<compiler>` elements into the first one; of an attribute, the last one holds."""
    compilers = list(document.getElementsByTagName("compiler"))
    if not compilers:
        compilers = [document.createElement("compiler")]
        root = document.documentElement
        root.insertBefore(compilers[0], root.firstChild)
    first, *others = compilers
    # A later `assetdir` takes the place of an earlier `meshdir`.
    if first.hasAttribute("assetdir") and not first.hasAttribute("meshdir"):
        first.setAttribute("meshdir", first.getAttribute("assetdir"))
    for other in others:
        given = dict(other.attributes.items())
        if "assetdir" in given:
            given = {"meshdir": given["assetdir"], **given}
        for name, value in given.items():
            first.setAttribute(name, value)
        other.parentNode.removeChild(other)
    return first


def _rename(document: Any) -> None:
    """Gives bodies, joints and geometries that have no name one."""
    for kinds in (("body",), ("joint", "freejoint"), ("geom",)):
        elements = [e for kind in kinds for e in document.getElementsByTagName(kind)]
        elements = [e for e in elements if e.parentNode.nodeName != "equality"]
        elements = [e for e in elements if e.parentNode.nodeName != "fixed"]
        taken = {element.getAttribute("name") for element in elements}
        number = 0
        for element in elements:
            if element.getAttribute("name"):
                continue
            while (name := f"{kinds[0]}_{number}") in taken:
                number += 1
            number += 1
            element.setAttribute("name", name)
    for mesh in document.getElementsByTagName("mesh"):
        if not mesh.getAttribute("name") and mesh.getAttribute("file"):
            stem = mesh.getAttribute("file").replace("\\", "/").rsplit("/", 1)[-1]
            mesh.setAttribute("name", stem.rsplit(".", 1)[0])


def _check_meshes(document: Any, compiler: Any, path: Path) -> None:
    """Applies `strippath`, and refuses meshes that only MuJoCo makes or moves.

    Raises:
        ExperimentError: there is such a mesh.
    """
    for mesh in document.getElementsByTagName("mesh"):
        name, file = mesh.getAttribute("name"), mesh.getAttribute("file")
        if file and compiler.getAttribute("strippath") == "true":
            mesh.setAttribute("file", file.replace("\\", "/").rsplit("/", 1)[-1])
        if not file and not mesh.getAttribute("vertex"):
            raise ExperimentError(f"{path}: mesh {name!r} has no file; give it one")
        for attribute, usual in (("refpos", "0 0 0"), ("refquat", "1 0 0 0")):
            given = mesh.getAttribute(attribute) or usual
            if numbers(given) != numbers(usual):
                raise ExperimentError(
                    f"{path}: mesh {name!r} has {attribute} {given!r}, which is not read; move its "
                    "vertices instead"
                )


def _joints_of(document: Any) -> Iterator[Any]:
    """The joints of bodies; couplings and tendons have elements of the same name."""
    for joint in document.getElementsByTagName("joint"):
        if joint.parentNode.nodeName in ("body", "frame"):
            yield joint


def _angles(compiler: Any) -> Callable[[float], float]:
    return float if compiler.getAttribute("angle") == "radian" else math.radians


def _limit(joint: Any, compiler: Any, to_radians: Callable[[float], float], path: Path) -> None:
    """Writes whether a joint is limited, and its range in radians or metres."""
    kind, name = joint_kind(joint), joint.getAttribute("name")
    limited = joint.getAttribute("limited") or "auto"
    low, high = numbers(joint.getAttribute("range") or "0 0", 2)
    if limited == "auto":
        has_limits = compiler.getAttribute("autolimits") != "false" and low < high
    else:
        has_limits = limited == "true"
    if has_limits and low >= high:
        raise ExperimentError(
            f"{path}: joint {name!r} is limited from {low:g} to {high:g}, which MuJoCo refuses; "
            "correct its range"
        )
    unit = to_radians if kind == "hinge" else float
    joint.setAttribute("limited", "true" if has_limits else "false")
    if has_limits:
        joint.setAttribute("range", number_text([unit(low), unit(high)]))
    elif joint.hasAttribute("range"):
        joint.removeAttribute("range")
    for angle in ("ref", "springref"):
        if joint.hasAttribute(angle):
            joint.setAttribute(angle, number_text([unit(float(joint.getAttribute(angle)))]))
