"""A gripper with skin on both fingers closes on a box and lifts it.

Two skins in one system, each with its own port. A skin feels pressure, not friction: friction holds
the weight of the box, and the fingers feel how hard they hold it.
"""

from pathlib import Path

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import PdControllerGains, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.systems import AddSkins, TactileSkin

HERE = Path(__file__).parent
# N, of each finger; kg and m, of the box.
GRIP, MASS, SIZE = 6.0, 0.2, (0.04, 0.05, 0.06)
# s and m, how the hand rises once it holds.
TIMES, HEIGHTS = [0.5, 1.5], [0.0, 0.1]
PAD = {
    "surface": {"shape": "collision", "resolution": 0.01},
    "thickness": 0.005,
    "num_receptors": 30,
    "hydroelastic_modulus": 1e5,
}


def main() -> dict[str, float]:
    """Grasps and lifts; returns the force felt by each finger, N, and the height of the box, m."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.004)
    Parser(plant).AddModels(str(HERE / "gripper.sdf"))
    gripper = plant.GetModelInstanceByName("gripper")
    own = plant.AddModelInstance("box")
    inertia = SpatialInertia.SolidBoxWithMass(MASS, *SIZE)
    box = plant.AddRigidBody("box", own, inertia)
    # Friction is a mean of both sides, 2ab / (a + b), and a skin has 0.2.
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(0.1, properties)
    AddContactMaterial(friction=CoulombFriction(20.0, 20.0), properties=properties)
    plant.RegisterCollisionGeometry(box, RigidTransform(), Box(*SIZE), "box", properties)
    worn = AddSkins(
        plant,
        scene_graph,
        {side: {"link": f"{side}_finger", **PAD} for side in ("left", "right")},
    )
    plant.SetDefaultFloatingBaseBodyPose(box, RigidTransform())
    # The hand follows a path, the fingers pull with a force.
    lift = plant.GetJointActuatorByName("lift")
    lift.set_controller_gains(PdControllerGains(p=1e4, d=1e3))
    plant.Finalize()

    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
    path = PiecewisePolynomial.FirstOrderHold(TIMES, np.array([HEIGHTS, [0, 0], [0, 0]]))
    follow = builder.AddSystem(TrajectorySource(path, output_derivative_order=1))
    builder.Connect(follow.get_output_port(), plant.get_desired_state_input_port(gripper))
    close = builder.AddSystem(ConstantVectorSource([0.0, GRIP, GRIP]))
    builder.Connect(close.get_output_port(), plant.get_actuation_input_port(gripper))
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    simulator.AdvanceTo(2.0)

    touch_context = touch.GetMyContextFromRoot(context)
    felt = {
        side: touch.GetOutputPort(f"{side}_sensation").Eval(touch_context)
        for side in ("left", "right")
    }
    for side, sensation in felt.items():
        print(f"{side} finger: {sensation.sum():.2f} N on {(sensation > 0).sum()} receptors")
    height = float(plant.EvalBodyPoseInWorld(plant_context, box).translation()[2])
    print(f"the box has risen by {100 * height:.1f} cm")
    return {side: float(sensation.sum()) for side, sensation in felt.items()} | {"height": height}


if __name__ == "__main__":
    main()
