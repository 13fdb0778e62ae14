"""MJCF written out in full, as MuJoCo reads it, for a parser that knows less.

Drake's parser drops what a class of defaults inherits, `<frame>` elements, and more, without a
word. So every default, angle and frame is written where it applies before Drake reads a file; what
cannot be written that way is refused.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from selftouch_drake.experiment import ExperimentError

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
# The ways to give an orientation; one of a body's own replaces whichever it inherits.
_ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_OF_A_BODY = ("body", "frame", "geom", "inertial", "joint", "freejoint")
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
    _fill_in(document, _defaults(root), path)
    for option in document.getElementsByTagName("option"):
        _keep_attributes(option, _OPTIONS)
    _rename(document)
    _check_meshes(document, compiler, path)
    to_radians = _angles(compiler)
    order = compiler.getAttribute("eulerseq") or "xyz"
    for kind in _OF_A_BODY:
        for element in document.getElementsByTagName(kind):
            _orient(element, to_radians, order)
    for joint in _joints_of(document):
        _limit(joint, compiler, to_radians, path)
    for geom in document.getElementsByTagName("geom"):
        _give_ends_a_pose(geom, path)
    for frame in reversed(list(document.getElementsByTagName("frame"))):
        _dissolve(frame)
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
        _drop_attributes(material, ("texture", "texrepeat", "texuniform"))
    for element in document.getElementsByTagName("*"):
        _drop_attributes(element, ("user",))
    for kind, names in _UNUSED.items():
        for element in document.getElementsByTagName(kind):
            # The zeros of a geometry that collides with nothing stay.
            if kind != "geom" or collides(element) or element.getAttribute("name") in paired:
                _drop_attributes(element, names)
            if kind == "geom" and element.hasAttribute("friction"):
                element.setAttribute("friction", element.getAttribute("friction").split()[0])


def _split_by_joint(document: Any, body: Any) -> None:
    """Gives each joint of a body but the last one a body of its own, without mass.

    Drake reads the axes of several joints of one body in the frame of its parent.
    """
    *first, _ = [child for child in _elements(body) if child.nodeName == "joint"] or [None]
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


# Attributes by the kind of an element, of a class of defaults.
_Settings = dict[str, dict[str, str]]


def _family(kind: str, section: str) -> str:
    """The kind under which defaults of an element are kept: all actuators share theirs."""
    return section if section in ("actuator", "equality", "tendon") else kind


_ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder"),
    *("muscle", "adhesion", "dcmotor"),
)


def _defaults(root: Any) -> dict[str, _Settings]:
    """The settings of each class, with those that it inherits; removes the `<default>` sections."""
    classes: dict[str, _Settings] = {"main": {}}

    def read(section: Any, inherited: _Settings, name: str) -> None:
        settings = {kind: dict(given) for kind, given in inherited.items()}
        nested = []
        for child in _elements(section):
            if child.nodeName == "default":
                nested.append(child)
                continue
            kind = child.nodeName
            kind = "actuator" if kind in _ACTUATORS else kind
            _inherit(settings.setdefault(kind, {}), dict(child.attributes.items()))
        classes[name] = settings
        for child in nested:
            read(child, settings, child.getAttribute("class"))

    for section in [child for child in _elements(root) if child.nodeName == "default"]:
        read(section, classes["main"], "main")
        # The outermost class may have a name of its own.
        classes[section.getAttribute("class") or "main"] = classes["main"]
        root.removeChild(section)
    return classes


def _inherit(settings: dict[str, str], own: Mapping[str, str]) -> None:
    """Lays attributes over inherited ones; an orientation replaces one given in another way."""
    if any(name in own for name in _ORIENTATIONS):
        for name in _ORIENTATIONS:
            settings.pop(name, None)
    settings.update(own)


def _fill_in(document: Any, classes: Mapping[str, _Settings], path: Path) -> None:
    """Writes the settings of its class into each element; removes the names of classes.

    Raises:
        ExperimentError: there is no such class.
    """

    def walk(node: Any, section: str, of_children: str) -> None:
        for child in _elements(node):
            kind = child.nodeName
            own = dict(child.attributes.items())
            wanted = own.pop("class", "") or of_children
            if wanted not in classes:
                raise ExperimentError(
                    f"{path}: <{kind}> {own.get('name', '')!r} has the class {wanted!r}, which no "
                    "<default> describes; correct it"
                )
            inherited = classes[wanted].get(_family(kind, section), {})
            if inherited and kind not in ("body", "frame"):
                settings = dict(inherited)
                _inherit(settings, own)
                for name, value in settings.items():
                    child.setAttribute(name, value)
            if child.hasAttribute("class"):
                child.removeAttribute("class")
            below = of_children
            if child.hasAttribute("childclass"):
                below = child.getAttribute("childclass")
                child.removeAttribute("childclass")
            walk(child, section, below)

    for section in _elements(document.documentElement):
        below = section.getAttribute("childclass") or "main"  # of a worldbody
        if section.hasAttribute("childclass"):
            section.removeAttribute("childclass")
        walk(section, section.nodeName, below)


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


def joint_kind(joint: Any) -> str:
    """`hinge`, `slide`, `ball` or `free`."""
    if joint.nodeName == "freejoint":
        return "free"
    return str(joint.getAttribute("type") or "hinge")


def _angles(compiler: Any) -> Callable[[float], float]:
    return float if compiler.getAttribute("angle") == "radian" else math.radians


def _orient(element: Any, to_radians: Callable[[float], float], order: str) -> None:
    """Makes a quaternion of whatever gives an element its orientation."""
    given = [name for name in _ORIENTATIONS if element.hasAttribute(name)]
    for name in given:
        if name != "quat":
            read, length = _READERS[name]
            turned = read(numbers(element.getAttribute(name), length), to_radians, order)
            element.removeAttribute(name)
            element.setAttribute("quat", _text(turned.as_quat(scalar_first=True)))


def _of_axis_angle(given: list[float], to_radians: Callable, order: str) -> Rotation:
    axis = np.array(given[:3]) / np.linalg.norm(given[:3])
    return Rotation.from_rotvec(to_radians(given[3]) * axis)


def _of_two_axes(given: list[float], to_radians: Callable, order: str) -> Rotation:
    x = np.array(given[:3]) / np.linalg.norm(given[:3])
    y = np.array(given[3:]) - x * np.dot(x, given[3:])
    y /= np.linalg.norm(y)
    return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))


def _of_z_axis(given: list[float], to_radians: Callable, order: str) -> Rotation:
    """The shortest turn of z into a direction."""
    z = np.array(given) / np.linalg.norm(given)
    across = np.cross([0.0, 0.0, 1.0], z)
    size = np.linalg.norm(across)
    if size < 1e-10:
        return Rotation.identity() if z[2] > 0 else Rotation.from_rotvec([math.pi, 0.0, 0.0])
    return Rotation.from_rotvec(across / size * math.atan2(size, z[2]))


def _of_euler_angles(given: list[float], to_radians: Callable, order: str) -> Rotation:
    """Turns about axes that move with the body, or about fixed ones for capital letters."""
    turned = Rotation.identity()
    for angle, axis in zip(given, order, strict=True):
        turn = Rotation.from_euler(axis.lower(), to_radians(angle))
        turned = turned * turn if axis.islower() else turn * turned
    return turned


# How to read an orientation, and of how many numbers.
_READERS = {
    "axisangle": (_of_axis_angle, 4),
    "xyaxes": (_of_two_axes, 6),
    "zaxis": (_of_z_axis, 3),
    "euler": (_of_euler_angles, 3),
}


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
        joint.setAttribute("range", _text([unit(low), unit(high)]))
    elif joint.hasAttribute("range"):
        joint.removeAttribute("range")
    for angle in ("ref", "springref"):
        if joint.hasAttribute(angle):
            joint.setAttribute(angle, _text([unit(float(joint.getAttribute(angle)))]))


def _give_ends_a_pose(geom: Any, path: Path) -> None:
    """Writes the pose and the size of a geometry that is given by its two ends."""
    kind = geom.getAttribute("type") or "sphere"
    if geom.getAttribute("mesh") and kind != "mesh":
        raise ExperimentError(
            f"{path}: geom {geom.getAttribute('name')!r} fits a {kind} to a mesh, which is not "
            "read; give its size and leave mesh out"
        )
    if not geom.hasAttribute("fromto"):
        return
    if kind not in ("capsule", "cylinder", "box", "ellipsoid"):
        raise ExperimentError(
            f"{path}: geom {geom.getAttribute('name')!r} is a {kind}, which has no two ends; give "
            "it another type, or leave fromto out"
        )
    ends = np.array(numbers(geom.getAttribute("fromto"), 6)).reshape(2, 3)
    length = float(np.linalg.norm(ends[0] - ends[1]))
    radius = numbers(geom.getAttribute("size"))[0]
    turned = _of_z_axis((ends[0] - ends[1]).tolist(), float, "")
    is_round = kind in ("capsule", "cylinder")
    size = [radius, length / 2] if is_round else [radius, radius, length / 2]
    geom.removeAttribute("fromto")
    geom.setAttribute("size", _text(size))
    geom.setAttribute("pos", _text(ends.mean(axis=0)))
    geom.setAttribute("quat", _text(turned.as_quat(scalar_first=True)))


def _dissolve(frame: Any) -> None:
    """Puts what a frame holds in its place, moved and turned as the frame is."""
    turn, shift = pose_of(frame)
    for child in _elements(frame):
        if child.nodeName == "joint":
            axis = numbers(child.getAttribute("axis") or "0 0 1", 3)
            child.setAttribute("axis", _text(turn.apply(axis)))
            place = numbers(child.getAttribute("pos") or "0 0 0", 3)
            child.setAttribute("pos", _text(turn.apply(place) + shift))
        elif child.nodeName in _OF_A_BODY and child.nodeName != "freejoint":
            own_turn, own_shift = pose_of(child)
            child.setAttribute("quat", _text((turn * own_turn).as_quat(scalar_first=True)))
            child.setAttribute("pos", _text(turn.apply(own_shift) + shift))
        frame.parentNode.insertBefore(child, frame)
    frame.parentNode.removeChild(frame)


def pose_of(element: Any) -> tuple[Rotation, np.ndarray]:
    """Rotation and `(3,)` m, the pose of an element that is written out."""
    quat = numbers(element.getAttribute("quat") or "1 0 0 0", 4)
    place = numbers(element.getAttribute("pos") or "0 0 0", 3)
    return Rotation.from_quat(quat, scalar_first=True), np.array(place)


def _elements(node: Any) -> list[Any]:
    return [child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE]


def _keep_attributes(element: Any, names: tuple[str, ...]) -> None:
    _drop_attributes(element, tuple(n for n in dict(element.attributes.items()) if n not in names))


def _drop_attributes(element: Any, names: tuple[str, ...]) -> None:
    for name in names:
        if element.hasAttribute(name):
            element.removeAttribute(name)


def _text(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
