import re

import numpy as np
import pytest
from laid_out import motion_of, world_of

from selftouch_drake.show.meshcat.pages import RobotPage
from selftouch_drake.show.meshcat.stage import open_meshcat


@pytest.fixture(scope="module")
def page():
    return RobotPage(open_meshcat(), world_of("two_skins"))


def test_every_joint_has_a_slider_within_its_range(page):
    meshcat, robot = page._meshcat, world_of("two_skins").robot
    for name, low in zip(robot.joint_names, robot.lower, strict=True):
        meshcat.SetSliderValue(name, low - 1.0)
        assert meshcat.GetSliderValue(name) == pytest.approx(low)


def test_it_says_what_is_felt_in_the_posture_of_the_sliders(page):
    robot = world_of("two_skins").robot
    touching = motion_of("two_skins").q[20]
    for q, status in ((np.zeros(12), "touches nothing"), (touching, r"feels \d+\.\d N")):
        for name, value in zip(robot.joint_names, q, strict=True):
            page._meshcat.SetSliderValue(name, value)
        page.step()
        assert re.fullmatch(status, page.status)
