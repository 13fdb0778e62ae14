"""The world in Drake: plant, soft skin, contact, controllers. It alone knows poses."""

from selftouch_drake.world.agent import Agent, MakeAgent
from selftouch_drake.world.babbler import Babbler
from selftouch_drake.world.plan_source import PlanSource
from selftouch_drake.world.probe import ContactProbe
from selftouch_drake.world.readings import Readings
from selftouch_drake.world.skin import (
    KinematicTactileSkin,
    RegisterSkin,
    SkinReadout,
    TactileSkin,
)
from selftouch_drake.world.station import MakeDynamicStation, MakeKinematicStation, Station

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
