"""The robot in Drake: plant, soft skins, contact, controllers. Only this package knows poses."""

from selftouch_drake.robot.contact import SensorModel, Touches
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.pairs import WornSkin
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.simulation import LOG_PERIOD, Log, MakeDynamicStation, Simulation
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.tactile_skin import (
    AddModelsAndSkins,
    AddSkins,
    AddTactileSkin,
    RegisterSkin,
    SkinReadout,
    TactileSkin,
    UnfeltContactWarning,
)
from selftouch_drake.robot.world import World

__all__ = [
    "LOG_PERIOD",
    "AddModelsAndSkins",
    "AddSkins",
    "AddTactileSkin",
    "ImperfectSkins",
    "Log",
    "MakeDynamicStation",
    "MakeRobot",
    "RegisterSkin",
    "Robot",
    "SensorModel",
    "Simulation",
    "SkinModel",
    "SkinReadout",
    "TactileSkin",
    "Touches",
    "UnfeltContactWarning",
    "World",
    "WornSkin",
]
