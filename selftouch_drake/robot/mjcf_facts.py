"""What an MJCF file that is written out says of joints, actuators, couplings and collisions."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.facts import JointFacts, ModelFacts
from selftouch_drake.robot.mjcf_poses import pose_of
from selftouch_drake.robot.mjcf_xml import collides, contact_bits, joint_kind, numbers


def mjcf_facts(document: Any, path: Path) -> ModelFacts:
    """Reads the facts of an MJCF file that is written out, before its sections are removed.

    Raises:
        ExperimentError: an actuator or a coupling names a joint that is not there.
    """
    notes = [
        f"tendon {tendon.getAttribute('name')!r} is left out"
        for tendon in _of_sections(document, "tendon")
    ]
    efforts = _efforts(document, notes)
    joints = {
        joint.getAttribute("name"): _of_joint(joint, body.getAttribute("name"), efforts)
        for body in document.getElementsByTagName("body")
        for joint in _children(body, "joint")
        if joint_kind(joint) in ("hinge", "slide")
    }
    followers, loops = _couplings(document)
    names = {joint.getAttribute("name") for joint in document.getElementsByTagName("joint")}
    if unknown := sorted({*efforts, *followers} - names):
        raise ExperimentError(
            f"{path}: an <actuator> or <equality> names the joint {unknown[0]!r}, which is not "
            "there; correct it"
        )
    paired = _pairs(document, "pair", "geom1", "geom2")
    return ModelFacts(
        path=path,
        joints=joints,
        followers=followers,
        loops=loops,
        notes=notes,
        contact_bits={
            geom.getAttribute("name"): contact_bits(geom)
            for geom in document.getElementsByTagName("geom")
            if collides(geom) or any(geom.getAttribute("name") in pair for pair in paired)
        },
        excluded=_pairs(document, "exclude", "body1", "body2"),
        paired=paired,
        poses=dict(_poses(document)),
    )


def _of_joint(joint: Any, body: str, efforts: Mapping[str, float]) -> JointFacts:
    lower, upper = -math.inf, math.inf
    if joint.getAttribute("limited") == "true":
        lower, upper = numbers(joint.getAttribute("range"))
    effort = min(efforts.get(joint.getAttribute("name"), math.inf), _largest(joint, "actuatorfrc"))
    armature = float(joint.getAttribute("armature") or 0.0)
    axis, place = (
        numbers(joint.getAttribute(name) or usual, 3)
        for name, usual in (("axis", "0 0 1"), ("pos", "0 0 0"))
    )
    return JointFacts(
        lower=lower,
        upper=upper,
        effort=effort,
        armature=armature,
        is_driven=joint.getAttribute("name") in efforts,
        placed=(body, np.array([axis, place])),
    )


def _efforts(document: Any, notes: list[str]) -> dict[str, float]:
    """N·m or N, the most that the actuators of each joint exert together.

    The force of a motor is its control; `gear` multiplies it on the way to the joint. One that
    exerts nothing counts as none.
    """
    efforts: dict[str, float] = {}
    for actuator in _of_sections(document, "actuator"):
        joint = actuator.getAttribute("joint") or actuator.getAttribute("jointinparent")
        if not joint:
            notes.append(
                f"actuator {actuator.getAttribute('name')!r} acts on no single joint, and its "
                "effort is left out"
            )
            continue
        most = min(_largest(actuator, "force"), _largest(actuator, "ctrl") * _gain(actuator))
        gear = abs(numbers(actuator.getAttribute("gear") or "1")[0])
        if gear and most:
            efforts[joint] = efforts.get(joint, 0.0) + gear * most
    return efforts


def _gain(actuator: Any) -> float:
    """N·m or N per unit of control, where nothing but the control decides the force."""
    if actuator.nodeName == "motor":
        return 1.0
    is_plain = actuator.nodeName == "general" and all(
        actuator.getAttribute(name) in ("", wanted)
        for name, wanted in (("gaintype", "fixed"), ("biastype", "none"), ("dyntype", "none"))
    )
    gain = abs(numbers(actuator.getAttribute("gainprm") or "1")[0])
    return gain if is_plain and gain else math.inf


def _largest(element: Any, what: str) -> float:
    """The largest `force`, `ctrl` or `actuatorfrc` within its range; infinite without limit.

    As in MuJoCo, a range of no width is no limit, unless the file says that it is one.
    """
    limited = element.getAttribute(f"{what}limited") or "auto"
    low, high = numbers(element.getAttribute(f"{what}range") or "0 0", 2)
    if limited == "false" or low >= high:
        return math.inf
    return max(abs(low), abs(high))


def _couplings(document: Any) -> tuple[dict[str, str], list[str]]:
    """Joints that follow others or are held, and what closes loops."""
    followers: dict[str, str] = {}
    loops: list[str] = []
    for element in _of_sections(document, "equality"):
        if element.getAttribute("active") == "false":
            continue
        kind = element.nodeName
        if kind == "joint":
            leader = element.getAttribute("joint2")
            how = f"follows {leader!r}" if leader else "is held"
            followers[element.getAttribute("joint1")] = f"{how} (<equality>)"
        else:
            between = [
                element.getAttribute(end)
                for end in ("body1", "body2", "site1", "site2", "tendon1", "tendon2")
                if element.getAttribute(end)
            ]
            loops.append(f"<{kind}> of {' and '.join(map(repr, between))}")
    return followers, loops


def _pairs(document: Any, kind: str, first: str, second: str) -> frozenset[frozenset[str]]:
    return frozenset(
        frozenset((element.getAttribute(first), element.getAttribute(second)))
        for element in _of_sections(document, "contact")
        if element.nodeName == kind
    )


def _poses(document: Any) -> Iterator[tuple[str, tuple[str, np.ndarray]]]:
    for body in document.getElementsByTagName("body"):
        if (parent := body.parentNode).nodeName == "body":
            turned, shift = pose_of(body)
            pose = np.column_stack([turned.as_matrix(), shift])
            yield body.getAttribute("name"), (parent.getAttribute("name"), pose)


def _children(node: Any, kind: str) -> list[Any]:
    return [child for child in node.childNodes if child.nodeName == kind]


def _of_sections(document: Any, kind: str) -> Iterator[Any]:
    """The elements of all sections of a kind."""
    for section in _children(document.documentElement, kind):
        yield from (child for child in section.childNodes if child.nodeType == child.ELEMENT_NODE)
