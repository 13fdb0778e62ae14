"""An arm lays its forearm, which wears skin, on a table and presses.

Models and skin come from one file, `forearm_on_table.yaml`; the skin is made of the forearm's own
collision geometry. With `--page FILE` it also writes a page that plays back the sensations.
"""

import argparse
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.multibody.tree import PdControllerGains
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.systems import AddModelsAndSkins, TactileSkin
from selftouch_drake.systems.skin_visualizer import SkinVisualizer

HERE = Path(__file__).parent
# s, and rad of shoulder and elbow: above the table, on it, pressed into it.
TIMES = [0.0, 1.0, 1.5, 2.0, 2.5]
ABOVE, ON, PRESSED = [0.55, -0.55], [0.737, -0.737], [0.75, -0.75]


def main(page: Path | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Presses; returns `(T,)` s and `(T, S)` N, the sensations of the forearm."""
    builder = RobotDiagramBuilder(time_step=0.004)
    plant, diagram_builder = builder.plant(), builder.builder()
    worn = AddModelsAndSkins(
        HERE / "forearm_on_table.yaml",
        builder.parser(),
        builder.scene_graph(),
        visible=page is None,
    )
    for index in plant.GetJointActuatorIndices():
        gains = PdControllerGains(p=800.0, d=40.0)
        plant.get_mutable_joint_actuator(index).set_controller_gains(gains)
    plant.set_gravity_enabled(plant.GetModelInstanceByName("arm"), False)
    plant.Finalize()

    touch = TactileSkin.AddToBuilder(diagram_builder, plant, builder.scene_graph(), worn)
    log = LogVectorOutput(touch.GetOutputPort("sensation"), diagram_builder, publish_period=0.01)
    q = np.array([ABOVE, ON, ON, PRESSED, PRESSED]).T
    path = PiecewisePolynomial.FirstOrderHold(TIMES, q)
    source = diagram_builder.AddSystem(TrajectorySource(path, output_derivative_order=1))
    arm = plant.GetModelInstanceByName("arm")
    diagram_builder.Connect(source.get_output_port(), plant.get_desired_state_input_port(arm))
    if page:
        meshcat = Meshcat()
        MeshcatVisualizer.AddToBuilder(diagram_builder, builder.scene_graph(), meshcat)
        show = SkinVisualizer.AddToBuilder(diagram_builder, plant, worn, touch, meshcat, full=1.0)
        meshcat.SetCameraPose([0.45, -0.35, 0.45], [0.35, 0.0, 0.05])
        meshcat.StartRecording(set_visualizations_while_recording=False)
    simulator = Simulator(builder.Build())
    plant_context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(plant_context, ABOVE)
    simulator.AdvanceTo(TIMES[-1])
    if page:
        meshcat.StopRecording()
        show.AddToRecording()
        meshcat.PublishRecording()
        page.write_text(meshcat.StaticHtml(), encoding="utf-8")

    felt = log.FindLog(simulator.get_context())
    time_s, sensation = felt.sample_times(), felt.data().T
    for name, at in (("above", 0.0), ("on", 1.5), ("pressed", 2.5)):
        now = sensation[np.searchsorted(time_s, at - 1e-9)]
        print(f"{name}: {now.sum():.2f} N on {(now > 0).sum()} receptors")
    return time_s, sensation


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", type=Path, help="an HTML file to write")
    main(parser.parse_args().page)
