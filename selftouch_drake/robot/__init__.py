"""The robot in Drake: plants, soft skins on links, contact. Only this package knows poses.

Its systems are in `selftouch_drake.systems`.
"""

from selftouch_drake.robot.contact import SensorModel, Touches
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.pairs import WornSkin
from selftouch_drake.robot.robot import MakeRobot, Robot
from selftouch_drake.robot.skin_registration import AddModelsAndSkins, AddSkins, RegisterSkin
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.world import World

__all__ = [
    "AddModelsAndSkins",
    "AddSkins",
    "ImperfectSkins",
    "MakeRobot",
    "RegisterSkin",
    "Robot",
    "SensorModel",
    "SkinModel",
    "Touches",
    "World",
    "WornSkin",
]
