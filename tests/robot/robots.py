"""Robots for tests: those of the shipped experiments, and small ones in SDF text."""

import functools

import numpy as np
import yaml
from pydrake.geometry import HydroelasticContactRepresentation

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import experiment_from_fields, load_experiment
from selftouch_drake.robot import ImperfectSkins, World
from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.faces import Faces
from selftouch_drake.robot.world import Postures

SHIPPED = ("cube", "torus_two_fingers", "turning_body", "gantry", "two_arms", "infant")


@functools.cache
def shipped(name):
    """The world of a shipped experiment."""
    return World(load_experiment(name))


class DrakesPostures:
    """Evaluates every configuration by Drake's contact: slow, without screen and batches."""

    def __init__(self, world):
        self._postures = Postures(world.experiment, world.skins)
        self.query, self.robot = self._postures.query, self._postures.robot
        self._sensor = SensorModel(self.robot.skins)
        self._imperfections = ImperfectSkins.of(world.experiment, world.skins)

    def sensations(self, q):
        """`(N, S)` N, at `(N, J)` configurations."""
        surfaces = [
            (row, Faces.of(surface))
            for row in range(len(q))
            for surface in self.query(q[row]).ComputeContactSurfaces(
                HydroelasticContactRepresentation.kPolygon
            )
        ]
        felt = self._sensor.touches(surfaces, self.robot.skin_positions(q)).sensation
        return felt if self._imperfections is None else self._imperfections(felt, q)


@functools.cache
def drakes_postures(world):
    """A world's robot in Drake."""
    return DrakesPostures(world)


def anywhere(robot, number, seed):
    """`(number, J)` configurations, uniform over the range in which a robot babbles."""
    return np.random.default_rng(seed).uniform(*robot.babbled_range, (number, robot.num_joints))


def free(world, q):
    """Those of the configurations `q` in which nothing touches and no rigid parts meet."""
    apart = ~world.probe.sensations(q).any(axis=1)
    q = q[apart]
    return q[~world.probe.impossible(q)]


@functools.cache
def configurations(world):
    """Some uniform configurations, and some of a walk, in which touches last for several steps."""
    walk = random_walk(world.experiment, DrakeBody(world), 1)
    return np.concatenate([anywhere(world.robot, 2000, seed=1), walk.steps(4000)])


@functools.cache
def touches(world):
    """`(N, J)` configurations that touch, and their sensations `(N, S)`."""
    q = anywhere(world.robot, 8000, seed=3).astype(np.float32)
    felt = world.probe.sensations(q)
    rows = np.flatnonzero(felt.any(axis=1))
    return q[rows], felt[rows]


def link(name, *geometries, mass=1.0, pose=""):
    """SDF of a link; its geometries are both collision and visual."""
    shapes = "".join(
        f"<{role} name='{role}_{k}'>{geometry}</{role}>"
        for k, geometry in enumerate(geometries)
        for role in ("collision", "visual")
    )
    moment = 0.01 * mass
    inertia = "".join(
        f"<{axis}>{moment if axis[1] == axis[2] else 0}</{axis}>"
        for axis in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    inertial = f"<inertial><mass>{mass}</mass><inertia>{inertia}</inertia></inertial>"
    return f"<link name='{name}'>{_pose(pose)}{inertial}{shapes}</link>"


def joint(name, kind, parent, child, axis="0 0 1", limits=(-1, 1), pose="", **more):
    """SDF of a joint; `more` holds further limits (`effort`); `pose` is relative to the child."""
    bounds = {} if limits is None else {"lower": limits[0], "upper": limits[1]}
    text = "".join(f"<{key}>{value}</{key}>" for key, value in {**bounds, **more}.items())
    return (
        f"<joint name='{name}' type='{kind}'>{_pose(pose)}"
        f"<parent>{parent}</parent><child>{child}</child>"
        f"<axis><xyz>{axis}</xyz><limit>{text}</limit></axis></joint>"
    )


def shape(kind, pose="", **dimensions):
    """SDF of a geometry, as `shape("box", size="1 1 1")`."""
    text = "".join(f"<{key}>{value}</{key}>" for key, value in dimensions.items())
    return f"{_pose(pose)}<geometry><{kind}>{text}</{kind}></geometry>"


def carried(name, *geometries, parent="base", reach=100.0):
    """SDF of a link on six joints that can move it anywhere: three rails and three turns."""
    steps = [f"{name}_{part}" for part in ("x", "y", "z", "roll", "pitch")]
    chain = [parent, *steps, name]
    axes = ("1 0 0", "0 1 0", "0 0 1")
    kinds = ["prismatic"] * 3 + ["continuous"] * 3
    joints = [
        joint(f"{child}_joint", kind, before, child, axis, (-reach, reach) if k < 3 else None)
        for k, (kind, before, child, axis) in enumerate(
            zip(kinds, chain[:-1], chain[1:], axes * 2, strict=True)
        )
    ]
    links = [link(step, mass=0.1) for step in steps]
    return "".join([*links, link(name, *geometries), *joints])


def write(folder, *parts, weld="base", defaults=None):
    """Writes a model `robot` of these parts, and directives that weld a link of it to the world.

    `defaults` are the joints' default positions by name.
    """
    folder.mkdir(exist_ok=True)
    (folder / "robot.sdf").write_text(
        f"<sdf version='1.9'><model name='robot'>{''.join(parts)}</model></sdf>"
    )
    add = {"name": "robot", "file": "robot.sdf"}
    if defaults:
        add["default_joint_positions"] = {name: [value] for name, value in defaults.items()}
    welds = [{"add_weld": {"parent": "world", "child": f"robot::{weld}"}}] if weld else []
    directives = folder / "robot.dmd.yaml"
    directives.write_text(yaml.safe_dump({"directives": [{"add_model": add}, *welds]}))
    return directives


def build(folder, *parts, skins, touching, weld="base", defaults=None, **fields):
    """The world of a robot of these parts."""
    directives = write(folder, *parts, weld=weld, defaults=defaults)
    robot = {"directives": str(directives), **fields.pop("robot", {})}
    return World(
        experiment_from_fields(
            {"name": "test", "robot": robot, "skins": skins, "touching": touching, **fields}
        )
    )


def _pose(pose):
    return f"<pose>{pose}</pose>" if pose else ""
