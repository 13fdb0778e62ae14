"""Efforts of the actuators of MJCF files, as MuJoCo limits them."""

import math
from collections.abc import Mapping
from typing import Any

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

# The kinds of actuators that are read.
_ACTUATORS = ("motor", "position", "velocity", "general")


def mjcf_efforts(document: Any) -> dict[str, float]:
    """N·m or N, the most that the actuators of each joint of an MJCF file exert together.

    The force of a motor is its control; `gear` multiplies it on the way to the joint.
    """
    defaults = _default_settings(document)
    efforts: dict[str, float] = {}
    for section in document.getElementsByTagName("actuator"):
        for actuator in section.childNodes:
            if actuator.nodeName not in _ACTUATORS:
                continue
            own = dict(actuator.attributes.items())
            settings = defaults.get(own.get("class", "main"), {}) | own
            most = _largest(settings, "force")
            if actuator.nodeName == "motor":
                most = min(most, _largest(settings, "ctrl"))
            gear = abs(float(settings.get("gear", "1").split()[0]))
            joint = settings.get("joint", "")
            efforts[joint] = efforts.get(joint, 0.0) + gear * most
    return efforts


def _default_settings(document: Any) -> dict[str, dict[str, str]]:
    """The settings of actuators by the name of their class of defaults."""
    defaults: dict[str, dict[str, str]] = {}
    for default in document.getElementsByTagName("default"):  # an outer one before those inside
        settings = dict(defaults.get(default.parentNode.getAttribute("class") or "main", {}))
        for child in default.childNodes:
            if child.nodeName in _ACTUATORS:
                settings |= dict(child.attributes.items())
        defaults[default.getAttribute("class") or "main"] = settings
    return defaults


def _largest(settings: Mapping[str, str], what: str) -> float:
    """The largest `force` or `ctrl` of an actuator with these settings; infinite without limit."""
    if settings.get(f"{what}limited") == "false" or f"{what}range" not in settings:
        return math.inf
    return max(abs(float(end)) for end in settings[f"{what}range"].split())


def limit_efforts(
    plant: MultibodyPlant, model: ModelInstanceIndex, efforts: Mapping[str, float]
) -> None:
    """Limits actuators as MuJoCo does; Drake leaves `gear` out, and some kinds of actuators."""
    without = {name for name in efforts if plant.HasJointNamed(name, model)}
    # Before a plant is finalized, it does not tell the actuators of one model.
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_mutable_joint_actuator(index)
        name = actuator.joint().name()
        if name in without and actuator.model_instance() == model:
            actuator.set_effort_limit(efforts[name])
            without.discard(name)
        elif name in efforts and actuator.model_instance() == model:
            plant.RemoveJointActuator(actuator)  # the first one exerts what all do together
    for name in sorted(without):
        joint = plant.GetJointByName(name, model)
        if joint.num_velocities() == 1:
            plant.AddJointActuator(f"{name}_actuator", joint, efforts[name])
