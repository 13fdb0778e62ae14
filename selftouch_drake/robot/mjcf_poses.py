"""Poses of MJCF in one form: a `pos` and a `quat`."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.mjcf_defaults import ORIENTATIONS
from selftouch_drake.robot.mjcf_xml import OF_A_BODY, elements, number_text, numbers


def orient(element: Any, to_radians: Callable[[float], float], order: str) -> None:
    """Makes a quaternion of whatever gives an element its orientation."""
    given = [name for name in ORIENTATIONS if element.hasAttribute(name)]
    for name in given:
        if name != "quat":
            read, length = _READERS[name]
            turned = read(numbers(element.getAttribute(name), length), to_radians, order)
            element.removeAttribute(name)
            element.setAttribute("quat", number_text(turned.as_quat(scalar_first=True)))


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


def give_ends_a_pose(geom: Any, path: Path) -> None:
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
    geom.setAttribute("size", number_text(size))
    geom.setAttribute("pos", number_text(ends.mean(axis=0)))
    geom.setAttribute("quat", number_text(turned.as_quat(scalar_first=True)))


def dissolve(frame: Any) -> None:
    """Puts what a frame holds in its place, moved and turned as the frame is."""
    turn, shift = pose_of(frame)
    for child in elements(frame):
        if child.nodeName == "joint":
            axis = numbers(child.getAttribute("axis") or "0 0 1", 3)
            child.setAttribute("axis", number_text(turn.apply(axis)))
            place = numbers(child.getAttribute("pos") or "0 0 0", 3)
            child.setAttribute("pos", number_text(turn.apply(place) + shift))
        elif child.nodeName in OF_A_BODY and child.nodeName != "freejoint":
            own_turn, own_shift = pose_of(child)
            child.setAttribute("quat", number_text((turn * own_turn).as_quat(scalar_first=True)))
            child.setAttribute("pos", number_text(turn.apply(own_shift) + shift))
        frame.parentNode.insertBefore(child, frame)
    frame.parentNode.removeChild(frame)


def pose_of(element: Any) -> tuple[Rotation, np.ndarray]:
    """Rotation and `(3,)` m, the pose of an element that is written out."""
    quat = numbers(element.getAttribute("quat") or "1 0 0 0", 4)
    place = numbers(element.getAttribute("pos") or "0 0 0", 3)
    return Rotation.from_quat(quat, scalar_first=True), np.array(place)
