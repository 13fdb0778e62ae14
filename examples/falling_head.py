"""A head falls on the floor and feels its own weight.

One spherical skin on a link without geometry; its readings go to a log.
"""

import numpy as np
from pydrake.geometry import AddRigidHydroelasticProperties, Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from selftouch_drake.systems import AddSkins, TactileSkin

MASS = 1.0


def main() -> tuple[np.ndarray, np.ndarray]:
    """Lets it fall; returns `(T,)` s and `(T, S)` N, its sensations."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    head = plant.AddRigidBody("head", SpatialInertia.SolidSphereWithMass(MASS, 0.15))
    floor = ProximityProperties()
    AddRigidHydroelasticProperties(1.0, floor)
    X_WF = RigidTransform([0.0, 0.0, -0.05])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WF, Box(2, 2, 0.1), "floor", floor)
    face = {"link": "head", "surface": {"shape": "sphere", "radius": 0.15}, "num_receptors": 50}
    worn = AddSkins(plant, scene_graph, {"face": {**face, "hydroelastic_modulus": 1e5}})
    plant.SetDefaultFloatingBaseBodyPose(head, RigidTransform([0.0, 0.0, 0.35]))
    plant.Finalize()

    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
    log = LogVectorOutput(touch.GetOutputPort("sensation"), builder, publish_period=0.01)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(2.0)

    felt = log.FindLog(simulator.get_context())
    time_s, sensation = felt.sample_times(), felt.data().T
    force = sensation.sum(axis=1)
    first = int(np.flatnonzero(force)[0])
    print(f"touches the floor at {time_s[first]:.2f} s, with up to {force.max():.1f} N")
    print(f"rests with {force[-1]:.2f} N on {(sensation[-1] > 0).sum()} receptors")
    print(f"weighs {9.81 * MASS:.2f} N")
    return time_s, sensation


if __name__ == "__main__":
    main()
