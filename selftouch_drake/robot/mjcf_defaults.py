"""The classes of defaults of MJCF, and what they give each element."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.mjcf_xml import elements

# The ways to give an orientation; one of a body's own replaces whichever it inherits.
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
# Attributes by the kind of an element, of a class of defaults.
_Settings = dict[str, dict[str, str]]


def _family(kind: str, section: str) -> str:
    """The kind under which defaults of an element are kept: all actuators share theirs."""
    return section if section in ("actuator", "equality", "tendon") else kind


_ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder"),
    *("muscle", "adhesion", "dcmotor"),
)


def read_defaults(root: Any) -> dict[str, _Settings]:
    """The settings of each class, with those that it inherits; removes the `<default>` sections."""
    classes: dict[str, _Settings] = {"main": {}}

    def read(section: Any, inherited: _Settings, name: str) -> None:
        settings = {kind: dict(given) for kind, given in inherited.items()}
        nested = []
        for child in elements(section):
            if child.nodeName == "default":
                nested.append(child)
                continue
            kind = child.nodeName
            kind = "actuator" if kind in _ACTUATORS else kind
            _inherit(settings.setdefault(kind, {}), dict(child.attributes.items()))
        classes[name] = settings
        for child in nested:
            read(child, settings, child.getAttribute("class"))

    for section in [child for child in elements(root) if child.nodeName == "default"]:
        read(section, classes["main"], "main")
        # The outermost class may have a name of its own.
        classes[section.getAttribute("class") or "main"] = classes["main"]
        root.removeChild(section)
    return classes


def _inherit(settings: dict[str, str], own: Mapping[str, str]) -> None:
    """Lays attributes over inherited ones; an orientation replaces one given in another way."""
    if any(name in own for name in ORIENTATIONS):
        for name in ORIENTATIONS:
            settings.pop(name, None)
    settings.update(own)


def fill_in(document: Any, classes: Mapping[str, _Settings], path: Path) -> None:
    """Writes the settings of its class into each element; removes the names of classes.

    Raises:
        ExperimentError: there is no such class.
    """

    def walk(node: Any, section: str, of_children: str) -> None:
        for child in elements(node):
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

    for section in elements(document.documentElement):
        below = section.getAttribute("childclass") or "main"  # of a worldbody
        if section.hasAttribute("childclass"):
            section.removeAttribute("childclass")
        walk(section, section.nodeName, below)
