"""Sensations of skins of any plant, shown in Meshcat."""

import numpy as np
import pytest
from pydrake.geometry import AddRigidHydroelasticProperties, Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from test_browser import PATIENCE, chromium, visited  # noqa: F401 (a fixture)

from selftouch_drake.show.meshcat.stage import open_meshcat
from selftouch_drake.systems import AddSkins, TactileSkin
from selftouch_drake.systems.skin_visualizer import SkinVisualizer

FALL_S, END_S = 0.15, 0.6


class Falling:
    """A ball with a skin that falls on a floor and reaches it after 0.15 s."""

    def __init__(self):
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.005)
        # Else what was felt before a context was reset is felt again at its first instant.
        plant.SetUseSampledOutputPorts(False)
        body = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        rail = PrismaticJoint("rail", plant.world_frame(), body.body_frame(), [0, 0, 1])
        plant.AddJoint(rail).set_default_translation(0.1 + 9.81 / 2 * FALL_S**2)
        properties = ProximityProperties()
        AddRigidHydroelasticProperties(1.0, properties)
        X_WF = RigidTransform([0, 0, -0.05])
        floor = Box(1, 1, 0.1)
        plant.RegisterCollisionGeometry(plant.world_body(), X_WF, floor, "floor", properties)
        surface = {"shape": "sphere", "radius": 0.1}
        skin = {"link": "ball", "surface": surface, "num_receptors": 20}
        worn = AddSkins(plant, scene_graph, {"ball": skin}, visible=False)
        plant.Finalize()
        self.touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
        self.meshcat = open_meshcat()
        self.show = SkinVisualizer.AddToBuilder(builder, plant, worn, self.touch, self.meshcat)
        self.simulator = Simulator(builder.Build())

    def advance(self, end):
        self.simulator.AdvanceTo(end)


def test_frames_begin_again_when_time_does():
    falling = Falling()
    falling.simulator.Initialize()
    assert falling.meshcat.HasPath("/tactile_skin/skins/ball/receptors/0")
    falling.advance(END_S)
    context = falling.simulator.get_mutable_context()
    context.SetTime(0.0)
    falling.simulator.get_system().SetDefaultContext(context)
    falling.simulator.Initialize()
    assert [time_s for time_s, *_ in falling.show._frames] == [0.0]


def test_what_cannot_be_recorded_is_refused():
    falling = Falling()
    with pytest.raises(ValueError, match=r"^nothing was published; simulate before .*$"):
        falling.show.AddToRecording()


AT = """async (time) => {
    viewer.animator.pause();
    viewer.animator.seek(time);
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    const root = viewer.scene_tree.find(["tactile_skin"]);
    const ball = root.find(["skins", "ball"]);
    return {
        height: ball.object.position.z,
        colors: Object.values(ball.find(["receptors"]).children).map(
            receptor => receptor.find(["<object>"]).object.material.color.getHexString()),
    };
}"""


@pytest.mark.slow
def test_a_saved_page_plays_back_colours(chromium, tmp_path):  # noqa: F811
    falling = Falling()
    falling.meshcat.StartRecording(set_visualizations_while_recording=False)
    falling.advance(END_S)
    falling.meshcat.StopRecording()
    falling.show.AddToRecording()
    falling.meshcat.PublishRecording()
    page = tmp_path / "falling.html"
    page.write_text(falling.meshcat.StaticHtml(), encoding="utf-8")
    times = [0.0, 0.1, 0.25, END_S - 0.02, 0.05]
    with visited(chromium, page.as_uri()) as (browser, errors):
        browser.wait_for_function(
            "typeof viewer == 'object' && viewer.animator.duration > 0", timeout=PATIENCE
        )
        seen = [browser.evaluate(AT, time) for time in times]
        browser.screenshot(path=tmp_path / "falling.png")
    assert errors == []
    white = seen[0]["colors"]
    assert len(set(white)) == 1
    assert seen[1]["colors"] == seen[4]["colors"] == white
    assert seen[3]["colors"] != white
    assert np.diff([each["height"] for each in seen[:3]]).max() < -0.02
