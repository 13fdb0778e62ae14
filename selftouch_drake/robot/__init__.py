"""The world in Drake: plant, soft skin, contact, controllers. It alone knows poses."""

from selftouch_drake.robot.agent import Agent, MakeAgent
from selftouch_drake.robot.babbler import Babbler
from selftouch_drake.robot.plan_source import PlanSource
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.readings import Readings
from selftouch_drake.robot.skin import (
    KinematicTactileSkin,
    RegisterSkin,
    SkinReadout,
    TactileSkin,
)
from selftouch_drake.robot.station import MakeDynamicStation, MakeKinematicStation, Station

__all__ = [
    "Agent",
    "Babbler",
    "ContactProbe",
    "KinematicTactileSkin",
    "MakeAgent",
    "MakeDynamicStation",
    "MakeKinematicStation",
    "PlanSource",
    "Readings",
    "RegisterSkin",
    "SkinReadout",
    "Station",
    "TactileSkin",
]
