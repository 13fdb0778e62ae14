"""The systems of the simulation: who commands, what feels, and the diagram of all of them.

Each is imported at its first use.
"""

from typing import TYPE_CHECKING

from selftouch_drake.lazy import names_of

if TYPE_CHECKING:
    from selftouch_drake.robot.imperfections import ImperfectSkins as ImperfectSkins
    from selftouch_drake.robot.pairs import WornSkin as WornSkin
    from selftouch_drake.robot.skin_registration import AddModelsAndSkins as AddModelsAndSkins
    from selftouch_drake.robot.skin_registration import AddSkins as AddSkins
    from selftouch_drake.robot.skin_registration import RegisterSkin as RegisterSkin
    from selftouch_drake.systems.babbler import Babbler as Babbler
    from selftouch_drake.systems.joint_readout import JointReadout as JointReadout
    from selftouch_drake.systems.naive_agent import NaiveAgent as NaiveAgent
    from selftouch_drake.systems.plan_source import PlanSource as PlanSource
    from selftouch_drake.systems.self_touch_diagram import (
        MakeSelfTouchDiagram as MakeSelfTouchDiagram,
    )
    from selftouch_drake.systems.skin_readout import SkinReadout as SkinReadout
    from selftouch_drake.systems.skin_visualizer import SkinVisualizer as SkinVisualizer
    from selftouch_drake.systems.station import MakeDynamicStation as MakeDynamicStation
    from selftouch_drake.systems.station import Station as Station
    from selftouch_drake.systems.tactile_skin import TactileSkin as TactileSkin
    from selftouch_drake.systems.tactile_skin import UnfeltContactWarning as UnfeltContactWarning
    from selftouch_drake.systems.touch_servo import TouchServo as TouchServo

_ROOM = "selftouch_drake.systems"
_MODULES = {
    # What a diagram of one's own needs, from where skins are made.
    "AddModelsAndSkins": "selftouch_drake.robot.skin_registration",
    "AddSkins": "selftouch_drake.robot.skin_registration",
    "ImperfectSkins": "selftouch_drake.robot.imperfections",
    "RegisterSkin": "selftouch_drake.robot.skin_registration",
    "WornSkin": "selftouch_drake.robot.pairs",
    "Babbler": f"{_ROOM}.babbler",
    "JointReadout": f"{_ROOM}.joint_readout",
    "MakeDynamicStation": f"{_ROOM}.station",
    "MakeSelfTouchDiagram": f"{_ROOM}.self_touch_diagram",
    "NaiveAgent": f"{_ROOM}.naive_agent",
    "PlanSource": f"{_ROOM}.plan_source",
    "SkinReadout": f"{_ROOM}.skin_readout",
    "SkinVisualizer": f"{_ROOM}.skin_visualizer",
    "Station": f"{_ROOM}.station",
    "TactileSkin": f"{_ROOM}.tactile_skin",
    "TouchServo": f"{_ROOM}.touch_servo",
    "UnfeltContactWarning": f"{_ROOM}.tactile_skin",
}
__all__ = sorted(_MODULES)

__getattr__ = names_of(_MODULES)
