"""A robot as this program loads it, beside the same file in MuJoCo."""

import itertools
import re
import warnings
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from scipy.spatial.transform import Rotation

from selftouch_drake.robot.facts import ContactRules
from selftouch_drake.robot.joints import fix_joints
from selftouch_drake.robot.kinematics import Kinematics, joint_tree
from selftouch_drake.robot.models import load_model, parse
from selftouch_drake.robot.pairs import Neighbours, own_geometries, rigid_pairs


class Loaded:
    """A robot that was loaded: its joints with limits, the poses of its links, and its pairs.

    `welds` are names of links that are welded to the world, each with its place and rotation.
    """

    def __init__(self, file, folder, *, joints=None, welds=(), packages=None):
        directives = Path(folder) / "robot.dmd.yaml"
        directives.write_text(_directives(file, welds))
        model = load_model(str(directives), packages or {})
        self.scene_graph = SceneGraph()
        self.plant = MultibodyPlant(time_step=0.01)
        self.plant.RegisterAsSourceForSceneGraph(self.scene_graph)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.parsed = parse(self.plant, model)
        asked = SimpleNamespace(robot=SimpleNamespace(joints=joints))
        fix_joints(self.plant, asked, model, self.parsed)
        self.plant.Finalize()
        self.joints = [each.joint.name() for each in joint_tree(self.plant)]
        self.lower = self.plant.GetPositionLowerLimits()
        self.upper = self.plant.GetPositionUpperLimits()
        self.efforts = {
            actuator.joint().name(): actuator.effort_limit()
            for actuator in map(self.plant.get_joint_actuator, self.plant.GetJointActuatorIndices())
        }
        links = [self.plant.get_body(BodyIndex(i)) for i in range(1, self.plant.num_bodies())]
        self.links = [link.name() for link in links]
        self._kinematics = Kinematics.of(self.plant, [link.body_frame() for link in links])

    def poses(self, q):
        """`(N, L, 3, 4)` of all links at `(N, J)`."""
        return self._kinematics.poses(q)

    def somewhere(self, number, seed=0):
        """`(number, J)` configurations within the limits."""
        low, high = np.clip(self.lower, -3, 3), np.clip(self.upper, -3, 3)
        return np.random.default_rng(seed).uniform(low, high, (number, len(low)))

    def pairs(self):
        """Names of two links that may run into each other, and of those that are neighbours."""
        own = own_geometries(self.plant, self.scene_graph)
        inspector = self.scene_graph.model_inspector()
        rules = ContactRules(self.plant, inspector, self.parsed)
        neighbours = Neighbours(self.plant, self.scene_graph, own, rules)
        asked = SimpleNamespace(robot=SimpleNamespace(collision_depth=0.0))
        meeting = {
            frozenset(link.name() for link in pair.links)
            for pair in rigid_pairs(self.plant, neighbours, rules, own, asked, [])
        }
        in_tree = Neighbours(self.plant, self.scene_graph, own)
        links = [self.plant.get_body(index) for index in own]
        beside = {
            frozenset((a.name(), b.name()))
            for a, b in itertools.combinations(links, 2)
            if in_tree.are_neighbours(a, b)
        }
        return meeting, beside


def _directives(file, welds):
    lines = ["directives:", f"- add_model: {{name: robot, file: '{file}'}}"]
    for name, place, turned in welds:
        rpy = Rotation.from_quat(turned, scalar_first=True).as_euler("xyz", degrees=True)
        pose = f"translation: {list(map(float, place))}, rotation: !Rpy {{deg: {rpy.tolist()}}}"
        lines.append(f"- add_weld: {{parent: world, child: 'robot::{name}', X_PC: {{{pose}}}}}")
    return "\n".join(lines) + "\n"


def in_mujoco(file):
    """MuJoCo's model of a file; of a URDF without geometry, whose meshes it may not read."""
    import mujoco

    if Path(file).suffix == ".xml":
        return mujoco.MjModel.from_xml_path(str(file))
    robot = ElementTree.parse(file).getroot()
    for link in robot.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
        for part in link.findall("inertial"):
            link.remove(part)
        link.append(ElementTree.fromstring(_SOME_MASS))
    for name in ("material", "gazebo", "transmission"):
        for element in robot.findall(name):
            robot.remove(element)
    robot.insert(0, ElementTree.fromstring('<mujoco><compiler fusestatic="false"/></mujoco>'))
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, encoding="unicode"))


_SOME_MASS = (
    "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    "</inertial>"
)


def body_names(model):
    """The names of MuJoCo's bodies; those without one are numbered as this program numbers them."""
    names = [model.body(number).name for number in range(model.nbody)]
    count = itertools.count()
    fresh = (name for name in map("body_{}".format, count) if name not in names)
    return [name or next(fresh) for name in names]


def floating(model):
    """Name, place and rotation of each body of MuJoCo's that has a free joint."""
    free = [j for j in range(model.njnt) if model.jnt_type[j] == 0]
    names = body_names(model)
    bodies = [int(model.jnt_bodyid[j]) for j in free]
    return [(names[b], model.body_pos[b], model.body_quat[b]) for b in bodies]


def named_to_move(error):
    """The joints that a refusal suggests to name."""
    found = re.search(r"joints: \[(.*?)\]", str(error))
    return found[1].split(", ") if found else None


def mujocos_pairs(model):
    """Names of bodies whose geometries MuJoCo lets collide, whatever hangs on what."""
    excluded = {frozenset((int(s) >> 16, int(s) & 0xFFFF)) for s in model.exclude_signature}
    names, pairs = body_names(model), set()
    plane, height = 0, 1
    for a, b in itertools.combinations(range(model.ngeom), 2):
        if {plane, height} & {int(model.geom_type[a]), int(model.geom_type[b])}:
            continue
        body_a, body_b = int(model.geom_bodyid[a]), int(model.geom_bodyid[b])
        meets = (
            model.geom_contype[a] & model.geom_conaffinity[b]
            or model.geom_contype[b] & model.geom_conaffinity[a]
        )
        if body_a != body_b and meets and frozenset((body_a, body_b)) not in excluded:
            pairs.add(frozenset((names[body_a], names[body_b])))
    return pairs


def compare(loaded, model, number=4):
    """What differs between a robot and MuJoCo's model, in words; an empty list for nothing."""
    import mujoco

    data = mujoco.MjData(model)
    names = {model.joint(j).name: j for j in range(model.njnt)}
    bodies = {name: number for number, name in enumerate(body_names(model))}
    found = []
    q = loaded.somewhere(number)
    X_WL = loaded.poses(q)
    for row in range(number):
        data.qpos[:] = model.qpos0
        for name, value in zip(loaded.joints, q[row], strict=True):
            if name in names:
                data.qpos[model.jnt_qposadr[names[name]]] = value
        mujoco.mj_kinematics(model, data)
        for link, X in zip(loaded.links, X_WL[row], strict=True):
            if (body := bodies.get(link)) is None:
                continue
            place = np.abs(X[:, 3] - data.xpos[body]).max()
            turned = np.abs(X[:, :3] - data.xmat[body].reshape(3, 3)).max()
            if max(place, turned) > 1e-6:
                found.append(f"{link}: {place:.3g} m, {turned:.3g}")
    for j, name in enumerate(loaded.joints):
        if (number_there := names.get(name)) is None:
            if not name.startswith("joint_"):
                found.append(f"MuJoCo has no joint {name}")
            continue
        limits = [-np.inf, np.inf]
        if model.jnt_limited[number_there]:
            limits = model.jnt_range[number_there]
        if not np.allclose([loaded.lower[j], loaded.upper[j]], limits, atol=1e-9):
            found.append(f"{name}: {loaded.lower[j]} to {loaded.upper[j]}, not {limits}")
    return found


def lighter_or_heavier(loaded, model):
    """Links whose mass, centre of mass or inertia is not MuJoCo's, with how far off each is."""
    bodies = {name: number for number, name in enumerate(body_names(model))}
    found = []
    for link in loaded.links:
        if (body := bodies.get(link)) is None or not model.body_mass[body]:
            continue
        inertia = loaded.plant.GetBodyByName(link).default_spatial_inertia()
        centre = inertia.get_com()
        moments = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
        off = (
            inertia.get_mass() / model.body_mass[body] - 1,
            *(centre - model.body_ipos[body]),
            *(np.linalg.eigvalsh(moments) / np.sort(model.body_inertia[body]) - 1),
        )
        if np.abs(off).max() > 1e-6:
            found.append((link, off))
    return found
