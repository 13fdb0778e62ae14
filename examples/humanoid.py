"""A published MuJoCo humanoid falls limp on the floor, with skin from head to toe.

Every link with collision geometry gets a skin made of it; the model file is not changed. By default
it is the humanoid of the package gymnasium: `python examples/humanoid.py [MODEL.xml]`.
"""

import logging
import sys
from pathlib import Path

import numpy as np
from pydrake.geometry import DefaultProximityProperties, Role, SceneGraphConfig
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator

from selftouch_drake.systems import AddSkins, TactileSkin

SKIN = {
    "surface": {"shape": "collision", "resolution": 0.03},
    "thickness": 0.01,
    "num_receptors": 20,
    "hydroelastic_modulus": 3e5,
}


def humanoid_file() -> Path:
    """The humanoid of gymnasium."""
    import gymnasium

    return Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / "humanoid.xml"


def main(model: Path | None = None) -> tuple[dict[str, float], float]:
    """Lets it fall; returns the force that each link feels, and its weight, N."""
    builder = RobotDiagramBuilder(time_step=0.005)
    plant, scene_graph = builder.plant(), builder.scene_graph()
    # Strangers' models say nothing of hydroelastic contact: what does not is rigid.
    rigid = DefaultProximityProperties(compliance_type="rigid")
    scene_graph.set_config(SceneGraphConfig(default_proximity_properties=rigid))
    # It warns of everything in the file that it does not use.
    logging.getLogger("drake").setLevel(logging.ERROR)
    (humanoid,) = builder.parser().AddModels(str(model or humanoid_file()))
    inspector = scene_graph.model_inspector()
    links = {
        link.name(): {"link": link.scoped_name().get_full(), **SKIN}
        for link in map(plant.get_body, plant.GetBodyIndices(humanoid))
        if inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(link.index()), Role.kProximity)
    }
    worn = AddSkins(plant, scene_graph, links)
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder.builder(), plant, scene_graph, worn)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    (base,) = (plant.get_body(index) for index in plant.GetFloatingBaseBodies())
    lying = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), [0.0, 0.0, 0.35])
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, base, lying)
    simulator.AdvanceTo(2.0)

    touch_context = touch.GetMyContextFromRoot(context)
    felt = {
        name: float(touch.GetOutputPort(f"{name}_sensation").Eval(touch_context).sum())
        for name in links
    }
    for name, force in felt.items():
        print(f"{name:>16} {force:6.1f} N")
    weight = 9.81 * plant.CalcTotalMass(plant_context)
    print(f"{'all':>16} {sum(felt.values()):6.1f} N, and it weighs {weight:.1f} N")
    return felt, weight


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else None)
