"""The robot in Drake: plant, soft skins, contact, controllers. Only this package knows poses."""

from selftouch_drake.robot.contact import SensorModel, Touches
from selftouch_drake.robot.imperfections import ImperfectSkin, ImperfectSkins
from selftouch_drake.robot.pairs import WornSkin
from selftouch_drake.robot.probe import ContactProbe
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.simulation import LOG_PERIOD, Log, Simulation
from selftouch_drake.robot.skin_registration import AddModelsAndSkins, AddSkins, AddTactileSkin
from selftouch_drake.robot.skins import SkinModel, make_skins
from selftouch_drake.robot.sources import PathSource
from selftouch_drake.robot.station import MakeDynamicStation, MakeKinematicStation, Station
from selftouch_drake.robot.tactile_skin import (
    KinematicTactileSkin,
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
    "ContactProbe",
    "ImperfectSkin",
    "ImperfectSkins",
    "KinematicTactileSkin",
    "Log",
    "MakeDynamicStation",
    "MakeKinematicStation",
    "MakeRobot",
    "PathSource",
    "RegisterSkin",
    "Robot",
    "SensorModel",
    "Simulation",
    "SkinModel",
    "SkinReadout",
    "Station",
    "TactileSkin",
    "Touches",
    "UnfeltContactWarning",
    "World",
    "WornSkin",
    "make_skins",
]
