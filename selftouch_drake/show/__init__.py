"""Everything for people: figures and the report (page), recordings and live play (meshcat)."""

from selftouch_drake.show.meshcat.life_page import LifePage, show_life
from selftouch_drake.show.meshcat.live import LiveShow, play_live
from selftouch_drake.show.meshcat.recording import recording_page
from selftouch_drake.show.meshcat.robot_page import show_robot
from selftouch_drake.show.meshcat.skin_visualizer import SkinVisualizer
from selftouch_drake.show.meshcat.stage import FeelingRobot, open_meshcat
from selftouch_drake.show.page.figures import FIGURES, draw_figure
from selftouch_drake.show.page.posture_picture import PostureCamera
from selftouch_drake.show.page.report import report_page
from selftouch_drake.show.recovered import RecoveredSkin
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.run_data import MissingError, NoSurfaceError, RunData, TouchSample
from selftouch_drake.show.skins import SkinSurface

__all__ = [
    "FIGURES",
    "FeelingRobot",
    "LifePage",
    "LiveShow",
    "MissingError",
    "NoSurfaceError",
    "PostureCamera",
    "RecoveredSkin",
    "RobotShape",
    "RunData",
    "SkinSurface",
    "SkinVisualizer",
    "TouchSample",
    "draw_figure",
    "open_meshcat",
    "play_live",
    "recording_page",
    "report_page",
    "show_life",
    "show_robot",
]
