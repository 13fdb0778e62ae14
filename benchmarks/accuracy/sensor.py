"""Speed and accuracy of the tactile skin. Run: `python benchmarks/accuracy/sensor.py`.

Speed: a plant with so many skins, each pressed by so many balls; what one look at its contact costs
Drake, and what the skin costs on top of that: CPU time, medians over many postures.

Accuracy, over sizes, moduli and time steps:

- `floor`: a ball in skin rests on a rigid floor; what it feels is its weight;
- `block`: a rigid block rests on a cube in skin, away from its middle; the same, and where it
  presses: by the receptors, and by the moment of Drake's `F_Ac_W`;
- `tip`: a rigid fingertip is held in a ball in skin, where nothing moves; what is felt against
  `F_Ac_W`, and against the pressure integrated over the contact surface.

The deviation is that of the sum of all readings from what it is held against. `--quick` does a
corner of it.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    HydroelasticContactInfo,
    MultibodyPlant,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import cKDTree

from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.geometry.receptors import place_receptors, receptive_fields
from selftouch_drake.geometry.surfaces import sphere
from selftouch_drake.robot import SensorModel, SkinModel, WornSkin
from selftouch_drake.robot.faces import Faces
from selftouch_drake.systems import AddSkins, RegisterSkin, TactileSkin

GRAVITY = 9.81
# m and Pa, of all skins but those that vary.
RADIUS, THICKNESS, MODULUS, TIP_RADIUS = 0.1, 0.03, 3e4, 0.01
# s until all is at rest.
REST_S = 2.0


def rigid(friction: float = 0.5, *, hint: float = 0.01) -> ProximityProperties:
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(hint, properties)
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    return properties


class Row:
    """Balls in skin side by side, each pressed by fingertips; a continuous plant."""

    def __init__(self, num_skins: int, num_receptors: int, num_contacts: int):
        surface = sphere(RADIUS)
        wall = hollow_skin(surface, THICKNESS)
        fields = receptive_fields(surface, place_receptors(surface, num_receptors, seed=0))
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        plant.set_contact_model(ContactModel.kHydroelastic)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
        worn, self._tips = [], []
        # Directions all round, far enough apart that fingertips do not touch each other.
        number = np.arange(num_contacts) + 0.5
        z, turn = 1 - 2 * number / num_contacts, np.pi * (1 + 5**0.5) * number
        level = np.sqrt(1 - z**2)
        directions = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
        for skin in range(num_skins):
            link = plant.AddRigidBody(f"skin_{skin}", inertia)
            at = np.array([4 * RADIUS * skin, 0.0, 0.0])
            plant.WeldFrames(plant.world_frame(), link.body_frame(), RigidTransform(at))
            model = SkinModel(
                name=link.name(),
                link=link.name(),
                wall=wall,
                fields=fields,
                hydroelastic_modulus=MODULUS,
                is_own_geometry=False,
            )
            worn.append(RegisterSkin(plant, model))
            for contact, direction in enumerate(directions):
                tip = plant.AddRigidBody(f"tip_{skin}_{contact}", inertia)
                plant.RegisterCollisionGeometry(
                    tip, RigidTransform(), Sphere(TIP_RADIUS), "tip", rigid()
                )
                self._tips.append((tip, at, direction))
        plant.Finalize()
        touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, worn)
        contact_port = plant.get_contact_results_output_port()
        self._diagram, self._plant = builder.Build(), plant
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        touch_context = touch.GetMyContextFromRoot(self._context)
        self._contact = lambda: contact_port.Eval(self._plant_context)
        self._felt = lambda: touch.get_output_port(0).Eval(touch_context)

    @property
    def num_faces(self) -> float:
        """Mean number of faces of a contact surface, at the last evaluation."""
        contact = self._contact()
        return statistics.mean(
            contact.hydroelastic_contact_info(i).contact_surface().num_faces()
            for i in range(contact.num_hydroelastic_contacts())
        )

    def look(self, depth: float) -> tuple[float, float]:
        """s for Drake's contact and for the skin, with all fingertips `depth` m deep."""
        for tip, at, direction in self._tips:
            X_WT = RigidTransform(at + (RADIUS + TIP_RADIUS - depth) * direction)
            self._plant.SetFreeBodyPose(self._plant_context, tip, X_WT)
        began = time.thread_time()
        self._contact()
        between = time.thread_time()
        self._felt()
        return between - began, time.thread_time() - between


def speed(num_looks: int, quick: bool) -> Iterator[str]:
    yield (
        "| skins | receptors each | contacts each | faces per contact | Drake's contact, ms | "
        "the skin, ms |"
    )
    yield "|---|---|---|---|---|---|"
    for num_skins in (1, 4) if quick else (1, 4, 16):
        for num_receptors in (20,) if quick else (20, 100, 500):
            for num_contacts in (1, 4):
                row = Row(num_skins, num_receptors, num_contacts)
                looks = [row.look(depth) for depth in np.linspace(0.004, 0.008, num_looks + 3)]
                drake, skin = (
                    1e3 * statistics.median(each) for each in zip(*looks[3:], strict=True)
                )
                yield (
                    f"| {num_skins} | {num_receptors} | {num_contacts} | {row.num_faces:.0f} | "
                    f"{drake:.2f} | {skin:.2f} |"
                )


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A body at rest, and its sensation.

    Attributes:
        felt: `(S,)` N.
        worn: the skin.
        contacts: Drake's.
        X_WL: pose of the skin's link.
    """

    felt: np.ndarray
    worn: WornSkin
    contacts: Sequence[HydroelasticContactInfo]
    X_WL: RigidTransform

    @property
    def force(self) -> np.ndarray:
        """`(3,)` N, force of all contacts on the skin, in the world."""
        return np.sum(
            [self._on_skin(c) * c.F_Ac_W().translational() for c in self.contacts], axis=0
        )

    def _on_skin(self, contact: HydroelasticContactInfo) -> int:
        return 1 if contact.contact_surface().id_M() == self.worn.geometry_id else -1

    def centre_by_moment(self) -> np.ndarray:
        """`(3,)` m, in the world: the point at which Drake's force has no moment."""
        (contact,) = self.contacts
        force, moment = contact.F_Ac_W().translational(), contact.F_Ac_W().rotational()
        return contact.contact_surface().centroid() + np.cross(force, moment) / (force @ force)

    def centre_by_sensor(self) -> np.ndarray:
        """`(3,)` m, in the world: the centre of pressure in `Touches`, the truth."""
        sensor = SensorModel([self.worn])
        surfaces = [(0, Faces.of(contact.contact_surface())) for contact in self.contacts]
        touches = sensor.touches(surfaces, self.X_WL.GetAsMatrix34()[None, None])
        return self.X_WL @ touches.p_LC[0]

    def centre_by_receptors(self) -> np.ndarray:
        """`(3,)` m, in the world: mean position of the receptors, weighted by readings."""
        p_LS = self.worn.model.fields.p_LS
        return self.X_WL @ (self.felt @ p_LS / self.felt.sum())


def at_rest(
    build: Callable[[MultibodyPlant, SceneGraph], WornSkin],
    time_step: float,
    duration: float,
) -> Rest:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=time_step)
    worn = build(plant, scene_graph)
    plant.Finalize()
    touch = TactileSkin.AddToBuilder(builder, plant, scene_graph, [worn])
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    context = simulator.get_context()
    plant_context = plant.GetMyContextFromRoot(context)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    return Rest(
        felt=touch.get_output_port(0).Eval(touch.GetMyContextFromRoot(context)),
        worn=worn,
        contacts=[
            results.hydroelastic_contact_info(i) for i in range(results.num_hydroelastic_contacts())
        ],
        X_WL=plant.EvalBodyPoseInWorld(plant_context, worn.link),
    )


def on_floor(radius: float, modulus: float, time_step: float) -> tuple[Rest, float]:
    """A ball in skin on the floor, 1 kg at a radius of 15 cm; and its weight in N."""
    mass = (radius / 0.15) ** 2

    def build(plant: MultibodyPlant, scene_graph: SceneGraph) -> WornSkin:
        ball = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(mass, radius))
        X_WF = RigidTransform([0.0, 0.0, -0.5])
        plant.RegisterCollisionGeometry(plant.world_body(), X_WF, Box(9, 9, 1), "floor", rigid())
        skin = {
            "link": "ball",
            "surface": {"shape": "sphere", "radius": radius, "resolution": radius / 5},
            "thickness": radius / 5,
            "hydroelastic_modulus": modulus,
        }
        (worn,) = AddSkins(plant, scene_graph, {"ball": skin}, visible=False)
        plant.SetDefaultFloatingBaseBodyPose(ball, RigidTransform([0.0, 0.0, radius]))
        return worn

    return at_rest(build, time_step, REST_S), GRAVITY * mass


def block_on_cube(
    side: float, modulus: float, time_step: float, num_receptors: int = 100
) -> tuple[Rest, float]:
    """A block on a cube in skin, a third as wide as the cube; and its weight in N."""
    mass = 10.0 * side**2

    def build(plant: MultibodyPlant, scene_graph: SceneGraph) -> WornSkin:
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        cube = plant.AddRigidBody("cube", inertia)
        plant.WeldFrames(plant.world_frame(), cube.body_frame())
        size = np.array([side, side, side / 2]) / 3
        block = plant.AddRigidBody("block", SpatialInertia.SolidBoxWithMass(mass, *size))
        shape = Box(*size)
        plant.RegisterCollisionGeometry(block, RigidTransform(), shape, "block", rigid())
        skin = {
            "link": "cube",
            "surface": {"shape": "cube", "side": side, "resolution": side / 12},
            "thickness": side / 12,
            "num_receptors": num_receptors,
            "hydroelastic_modulus": modulus,
        }
        (worn,) = AddSkins(plant, scene_graph, {"cube": skin}, visible=False)
        place = [0.1 * side, -0.05 * side, 0.5 * (side + size[2])]
        plant.SetDefaultFloatingBaseBodyPose(block, RigidTransform(place))
        return worn

    return at_rest(build, time_step, REST_S), GRAVITY * mass


def tip_in_ball(radius: float, tip: float, depth: float) -> Rest:
    """A rigid fingertip held in a ball in skin."""

    def build(plant: MultibodyPlant, scene_graph: SceneGraph) -> WornSkin:
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        bodies = [plant.AddRigidBody(name, inertia) for name in ("ball", "tip")]
        skin = {"link": "ball", "surface": {"shape": "sphere", "radius": radius}, "thickness": 0.03}
        (worn,) = AddSkins(plant, scene_graph, {"ball": skin}, visible=False)
        plant.RegisterCollisionGeometry(
            bodies[1], RigidTransform(), Sphere(tip), "tip", rigid(0.0, hint=tip / 4)
        )
        heights = 0.0, radius + tip - depth
        for body, height in zip(bodies, heights, strict=True):
            plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform([0.0, 0.0, height]))
        return worn

    return at_rest(build, 0.0, 0.0)


SIZES, MODULI, STEPS = (0.05, 0.15, 0.3), (3e4, 1e5, 1e6), (0.001, 0.005, 0.01)


def variations(quick: bool) -> Iterator[tuple[float, float, float]]:
    """Size, modulus and step; each is varied alone, starting from the middle one."""
    middle = 0.15, 1e5, 0.005
    yield middle
    if not quick:
        for place, values in enumerate((SIZES, MODULI, STEPS)):
            for value in values:
                varied = [*middle]
                varied[place] = value
                if tuple(varied) != middle:
                    yield varied[0], varied[1], varied[2]


def deviation(felt: float, true: float) -> str:
    return f"{100 * (felt / true - 1):+.2f} %"


def floor_accuracy(quick: bool) -> Iterator[str]:
    yield (
        "| radius (m) | modulus (Pa) | step (s) | weight (N) | felt, relative to the weight | "
        "relative to `F_Ac_W` |"
    )
    yield "|---|---|---|---|---|---|"
    for radius, modulus, step in variations(quick):
        rest, weight = on_floor(radius, modulus, step)
        felt, force = rest.felt.sum(), np.linalg.norm(rest.force)
        yield (
            f"| {radius} | {modulus:.0e} | {step} | {weight:.2f} | {deviation(felt, weight)} | "
            f"{deviation(felt, force)} |"
        )


def block_accuracy(quick: bool) -> Iterator[str]:
    yield (
        "| side (m) | modulus (Pa) | step (s) | weight (N) | felt, relative to the weight | "
        "relative to `F_Ac_W` | error of the centre by `Touches` | "
        "error of the centre by receptors | spacing of receptors |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for size, modulus, step in variations(quick):
        side = 2 * size
        rest, weight = block_on_cube(side, modulus, step)
        felt, force = rest.felt.sum(), np.linalg.norm(rest.force)
        true = rest.centre_by_moment()[:2]
        off = [
            1e3 * np.linalg.norm(centre()[:2] - true)
            for centre in (rest.centre_by_sensor, rest.centre_by_receptors)
        ]
        p_LS = rest.worn.model.fields.p_LS
        apart = 1e3 * np.median(cKDTree(p_LS).query(p_LS, k=2)[0][:, 1])
        yield (
            f"| {side} | {modulus:.0e} | {step} | {weight:.2f} | {deviation(felt, weight)} | "
            f"{deviation(felt, force)} | {off[0]:.2f} mm, {100 * off[0] / 1e3 / side:.2f} % | "
            f"{off[1]:.2f} mm, {100 * off[1] / 1e3 / side:.2f} % | {apart:.0f} mm |"
        )


def receptor_accuracy(quick: bool) -> Iterator[str]:
    yield "| receptors | error of the centre by receptors |"
    yield "|---|---|"
    for num_receptors in (50,) if quick else (50, 100, 200, 400, 800):
        rest, _ = block_on_cube(0.3, 1e5, 0.005, num_receptors)
        off = np.linalg.norm(rest.centre_by_receptors()[:2] - rest.centre_by_moment()[:2])
        yield f"| {num_receptors} | {1e3 * off:.2f} mm |"


def tip_accuracy(quick: bool) -> Iterator[str]:
    yield (
        "| ball (m) | tip (m) | depth (mm) | felt (N) | `F_Ac_W` (N) | relative to `F_Ac_W` | "
        "relative to the pressure |"
    )
    yield "|---|---|---|---|---|---|---|"
    cases = [(0.15, 0.01, 0.004), (0.15, 0.03, 0.004), (0.15, 0.1, 0.004), (0.15, 0.01, 0.008)]
    for radius, tip, depth in cases[: 1 if quick else None]:
        rest = tip_in_ball(radius, tip, depth)
        felt, force = rest.felt.sum(), np.linalg.norm(rest.force)
        pressure = sum(Faces.of(c.contact_surface()).force.sum() for c in rest.contacts)
        yield (
            f"| {radius} | {tip} | {1e3 * depth:.0f} | {felt:.3f} | {force:.3f} | "
            f"{deviation(felt, force)} | {deviation(felt, pressure)} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--looks", type=int, default=50, help="postures of each row of the speed")
    parser.add_argument("--quick", action="store_true", help="a corner of it")
    arguments = parser.parse_args()
    for title, lines in (
        ("Speed", speed(arguments.looks, arguments.quick)),
        ("A ball in skin on a floor", floor_accuracy(arguments.quick)),
        ("A block on a cube in skin", block_accuracy(arguments.quick)),
        ("The same with other receptors", receptor_accuracy(arguments.quick)),
        ("A fingertip in a ball in skin", tip_accuracy(arguments.quick)),
    ):
        print(f"\n{title}\n", flush=True)
        for line in lines:
            print(line, flush=True)


if __name__ == "__main__":
    main()
