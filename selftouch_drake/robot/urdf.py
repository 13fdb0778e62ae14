"""What a URDF file says of joints, read as urdfdom and Gazebo read it."""

import math
import re
from pathlib import Path
from typing import Any

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.facts import JointFacts, ModelFacts


def refuse_xacro(document: Any, path: Path) -> None:
    """Refuses a file that is a program for xacro, and no URDF yet.

    Raises:
        ExperimentError: it is; the text has the command that makes a URDF of it.
    """
    elements = list(document.getElementsByTagName("*"))
    if path.suffix == ".xacro" or any(
        element.tagName.startswith("xacro:")
        or any(re.search(r"\$[({]", value) for value in dict(element.attributes.items()).values())
        for element in elements
    ):
        stem = path.name.removesuffix(".xacro").removesuffix(".urdf").removesuffix(".xml")
        raise ExperimentError(
            f"{path} is xacro, which must be expanded first: pip install xacrodoc, then "
            f"xacrodoc {path.name} -o {stem}_expanded.urdf, and name that file"
        )


def number_actuators(document: Any) -> bool:
    """Gives actuators whose names repeat numbers, because only Drake wants each name once.

    Returns:
        Whether there are any.
    """
    names: list[str] = []
    for transmission in document.getElementsByTagName("transmission"):
        for actuator in transmission.getElementsByTagName("actuator"):
            name = actuator.getAttribute("name")
            if name in names:
                actuator.setAttribute("name", f"{name}_{len(names)}")
            names.append(name)
    return len(set(names)) < len(names)


def urdf_facts(document: Any, path: Path) -> ModelFacts:
    """Reads limits, efforts and couplings of the joints of a URDF.

    An effort limits a joint whether or not it has a `<transmission>`; 0 is none. A missing end of
    the range is 0, and a continuous joint has no range at all.

    Raises:
        ExperimentError: a range is upside down.
    """
    joints, followers = {}, {}
    for joint in document.getElementsByTagName("joint"):
        name, kind = joint.getAttribute("name"), joint.getAttribute("type")
        if joint.parentNode.nodeName != "robot" or kind not in _TURN_OR_SLIDE:
            continue
        joints[name] = _of_joint(joint, name, path)
        for mimic in joint.getElementsByTagName("mimic"):
            followers[name] = f"follows {mimic.getAttribute('joint')!r} (<mimic>)"
    return ModelFacts(path=path, joints=joints, followers=followers)


_TURN_OR_SLIDE = ("revolute", "continuous", "prismatic")


def _of_joint(joint: Any, name: str, path: Path) -> JointFacts:
    limits = joint.getElementsByTagName("limit")
    if not limits:
        return JointFacts(lower=-math.inf, upper=math.inf)
    lower, upper, effort = (
        _number(limits[0], attribute, f"{path}: joint {name!r}")
        for attribute in ("lower", "upper", "effort")
    )
    if joint.getAttribute("type") == "continuous":
        lower, upper = -math.inf, math.inf
    if lower > upper:
        raise ExperimentError(
            f"{path}: joint {name!r} has the lower limit {lower:g} above the upper limit "
            f"{upper:g}; correct them"
        )
    return JointFacts(lower=lower, upper=upper, effort=effort if effort > 0 else math.inf)


def _number(limit: Any, attribute: str, where: str) -> float:
    text = limit.getAttribute(attribute) or "0"
    try:
        return float(text)
    except ValueError:
        raise ExperimentError(
            f"{where} has the {attribute} {text!r} in <limit>, which is no number; correct it"
        ) from None


def sdf_facts(document: Any, path: Path) -> ModelFacts:
    """The joints of an SDFormat file that follow others, and bits of collisions."""
    followers = {}
    for joint in document.getElementsByTagName("joint"):
        for kind in ("mimic", "drake:mimic"):
            for mimic in joint.getElementsByTagName(kind):
                leader = mimic.getAttribute("joint") or mimic.getAttribute("drake:joint")
                followers[joint.getAttribute("name")] = f"follows {leader!r} (<mimic>)"
    notes = [
        f"<{kind}> is left out"
        for kind in ("collide_bitmask", "category_bitmask")
        if document.getElementsByTagName(kind)
    ]
    return ModelFacts(path=path, followers=followers, notes=notes)
