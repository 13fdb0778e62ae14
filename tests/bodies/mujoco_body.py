"""An upper body in MuJoCo, written for the tests: an arm that touches a torso, a head and a thigh.

It shares nothing with Drake. Twelve joints: seven of the arm and two of the neck decide what
touches what, three of a tail do not. 160 touch sites in three soft skins with rigid cores; each
reads the depth of the fingertip's contacts, by how near they are.

`Arm` is a Gymnasium environment under dynamics, with position or torque actions. `Kinematic` and
`Dynamic` are bodies for `python:` in an experiment.
"""

import gymnasium
import mujoco
import numpy as np

from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.bodies.gymnasium import GymnasiumBody

#: m, thickness of the soft skins; what they read per metre of depth.
SOFT, STIFFNESS = 0.03, 300.0
#: Semi-axes of a skin, or radius and half length, in m; number of touch sites.
TORSO, HEAD, THIGH = (0.15, 0.12, 0.2), (0.11,) * 3, (0.075, 0.13)
NUM_SITES = {"torso": 70, "head": 45, "thigh": 45}
#: rad, limits, and N·m, the greatest torque.
JOINTS = {
    "neck_yaw": (-0.5, 0.5, 10),
    "neck_pitch": (-0.4, 0.4, 10),
    "shoulder_yaw": (-2.6, 2.6, 60),
    "shoulder_pitch": (-1.6, 2.2, 60),
    "shoulder_roll": (-1.6, 1.6, 30),
    "elbow": (0.05, 2.6, 30),
    "forearm_roll": (-1.8, 1.8, 10),
    "wrist_pitch": (-1.5, 1.5, 6),
    "wrist_yaw": (-1.2, 1.2, 6),
    "tail_base": (-0.8, 0.8, 6),
    "tail_middle": (-0.8, 0.8, 3),
    "tail_tip": (-0.8, 0.8, 3),
}


def joint(name, axis, armature=0.05, damping=0.6):
    low, high, _ = JOINTS[name]
    return (
        f'<joint name="{name}" axis="{axis}" range="{low} {high}" limited="true" '
        f'armature="{armature}" damping="{damping}"/>'
    )


def soft(name, kind, size, pose=""):
    """A soft skin that the fingertip presses, and in it a core that nothing enters."""
    core = " ".join(str(n - SOFT) for n in size[: 1 if kind == "capsule" else 3])
    core += f" {size[1]}" if kind == "capsule" else ""
    return (
        f'<geom name="{name}" type="{kind}" size="{" ".join(map(str, size))}" {pose} contype="2" '
        f'conaffinity="0" mass="1" class="soft"/>'
        f'<geom name="{name}_core" type="{kind}" size="{core}" {pose} contype="1" '
        f'conaffinity="0" mass="0.5"/>'
    )


def link(length, radius):
    return (
        f'<geom type="capsule" fromto="{0.3 * length} 0 0 {0.9 * length} 0 0" size="{radius}" '
        'contype="0" conaffinity="1" mass="0.4"/>'
    )


def model_text(control):
    """MJCF; `control` is `position` or `torque`."""
    motors = "".join(
        f'<position joint="{name}" kp="{4 * most}" kv="{0.6 * most}" ctrlrange="{low} {high}" '
        f'forcerange="-{most} {most}"/>'
        if control == "position"
        else f'<motor joint="{name}" gear="{most}" ctrlrange="-1 1"/>'
        for name, (low, high, most) in JOINTS.items()
    )
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.004" integrator="implicitfast"/>
  <default>
    <geom condim="1"/>
    <default class="soft"><geom solref="-60 -10" solimp="0.95 0.95 0.001"/></default>
  </default>
  <worldbody>
    {soft("torso", "ellipsoid", TORSO)}
    {soft("thigh", "capsule", THIGH, 'pos="0.24 0.05 -0.22" euler="0 1.5708 0"')}
    <body pos="0 0 0.21" gravcomp="0.9">
      {joint("neck_yaw", "0 0 1")}{joint("neck_pitch", "0 1 0")}
      <body pos="0 0 0.13" gravcomp="0.9">{soft("head", "ellipsoid", HEAD)}</body>
    </body>
    <body pos="0.15 -0.34 0.25" gravcomp="0.9">
      {joint("shoulder_yaw", "0 0 1", 0.2, 2)}{joint("shoulder_pitch", "0 1 0", 0.2, 2)}
      {joint("shoulder_roll", "1 0 0", 0.1, 1)}{link(0.34, 0.03)}
      <body pos="0.34 0 0" gravcomp="0.9">
        {joint("elbow", "0 0 1", 0.1, 1)}{joint("forearm_roll", "1 0 0")}{link(0.32, 0.025)}
        <body pos="0.32 0 0" gravcomp="0.9">
          {joint("wrist_pitch", "0 1 0")}{joint("wrist_yaw", "0 0 1")}{link(0.12, 0.008)}
          <geom name="tip" type="sphere" pos="0.13 0 0" size="0.012" contype="0" conaffinity="3"
                mass="0.05"/>
        </body>
      </body>
    </body>
    <body pos="-0.4 0.5 -0.1" gravcomp="0.9">
      {joint("tail_base", "0 1 0")}{link(0.15, 0.02)}
      <body pos="0.15 0 0" gravcomp="0.9">
        {joint("tail_middle", "0 1 0")}{link(0.12, 0.02)}
        <body pos="0.12 0 0" gravcomp="0.9">{joint("tail_tip", "0 1 0")}{link(0.1, 0.02)}</body>
      </body>
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""


def spread(num, size, kind):
    """`(num, 3)` m, touch sites spread evenly over a skin, in the frame of its geometry."""
    n = np.arange(num) + 0.5
    turn = np.pi * (1 + np.sqrt(5)) * n
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        polar = np.arccos(1 - 2 * n / num)
        ball = np.stack([np.cos(turn), np.sin(turn), 1 / np.tan(polar)], axis=1)
        ball *= np.sin(polar)[:, None]
        return ball * size
    radius, half = size[:2]
    along = (2 * n / num - 1) * (half + radius)  # equal areas, on the cylinder and on the caps
    over = (np.abs(along) - half).clip(0.0)
    across = np.sqrt(np.maximum(radius**2 - over**2, 0.0))
    return np.stack([across * np.cos(turn), across * np.sin(turn), along], axis=1)


class World:
    """The model, and what its touch sites read."""

    def __init__(self, control="position"):
        self.model = mujoco.MjModel.from_xml_string(model_text(control))
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.geom("tip").id
        self.skins, first = {}, 0
        for name, num in NUM_SITES.items():
            geom = self.model.geom(name)
            sites = spread(num, geom.size, geom.type[0])
            near = np.sort(np.linalg.norm(sites[:, None] - sites, axis=-1), axis=1)[:, 1:7]
            self.skins[geom.id] = slice(first, first + num), sites, 1.4 * near.mean()
            first += num

    def touch(self):
        """`(160,)` N, and whether rigid parts are in each other by more than 4 mm."""
        data, reading, rigid = self.data, np.zeros(160), False
        pairs, depths, places = data.contact.geom, -data.contact.dist, data.contact.pos
        for (one, other), depth, place in zip(pairs.tolist(), depths, places, strict=True):
            skin = other if one == self.tip else one
            if skin not in self.skins or self.tip not in (one, other):
                rigid |= bool(depth > 0.004)
                continue
            rows, sites, width = self.skins[skin]
            turn = data.geom_xmat[skin].reshape(3, 3)
            away = np.linalg.norm(sites - (place - data.geom_xpos[skin]) @ turn, axis=1)
            field = np.maximum(0.0, 1 - (away / width) ** 2)
            reading[rows] += STIFFNESS * max(0.0, depth) * field
        return reading, rigid


class Arm(gymnasium.Env):
    """The body under dynamics; an action is `(12,)` rad, or a share of the greatest torque."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, control="position", max_steps=None):
        self.world, self.max_steps, self.steps = World(control), max_steps, 0
        low, high = self.world.model.actuator_ctrlrange.T
        box = gymnasium.spaces.Box
        self.action_space = box(low.astype(np.float32), high.astype(np.float32))
        limits = self.world.model.jnt_range.T
        self.observation_space = gymnasium.spaces.Dict(
            {"qpos": box(*limits, dtype=np.float64), "touch": box(0, np.inf, (160,), np.float64)}
        )
        self.dt = 5 * self.world.model.opt.timestep

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        mujoco.mj_resetData(self.world.model, self.world.data)
        self.world.data.qpos[:] = START
        return self.set_posture(START), {}

    def set_posture(self, q):
        """The observation in a posture, or None where rigid parts would be in each other."""
        self.world.data.qpos[:], self.world.data.qvel[:] = q, 0
        mujoco.mj_forward(self.world.model, self.world.data)
        return None if self.world.touch()[1] else self.observation()

    def step(self, action):
        self.world.data.ctrl[:] = np.clip(action, self.action_space.low, self.action_space.high)
        mujoco.mj_step(self.world.model, self.world.data, 5)
        self.steps += 1
        ended = self.max_steps is not None and self.steps >= self.max_steps
        return self.observation(), 0.0, False, ended, {}

    def observation(self):
        return {"qpos": self.world.data.qpos.copy(), "touch": self.world.touch()[0]}


#: The arm hangs outwards, away from everything.
START = np.array([0, 0, -1.2, 0.3, 0, 0.6, 0, 0, 0, 0, 0, 0.0])


class Kinematic:
    """The body without dynamics: it is put into each posture."""

    jumps, num_receptors = True, 160

    def __init__(self):
        self.world = World()
        self.joint_names = list(JOINTS)
        self.lower, self.upper = self.world.model.jnt_range.T
        self.velocity, self.acceleration = np.full(12, 1.0), np.full(12, 4.0)

    def feel(self, q):
        felt, reached = np.zeros((len(q), 160)), np.zeros(len(q), dtype=bool)
        for row, posture in enumerate(q):
            self.world.data.qpos[:] = posture
            # No more than where contacts are: no forces, no accelerations.
            mujoco.mj_kinematics(self.world.model, self.world.data)
            mujoco.mj_collision(self.world.model, self.world.data)
            felt[row], rigid = self.world.touch()
            reached[row] = not rigid
        return Felt(q=q, sensation=felt, reached=reached)

    def follow(self, time_s, q):
        felt = self.feel(q)
        return Followed(time_s=time_s, q=felt.q, sensation=felt.sensation)


class Dynamic(GymnasiumBody):
    """The body under dynamics, which travels; `velocity` in rad/s limits each joint."""

    def __init__(self, control="position", velocity=1.0):
        limits = {"velocity": [velocity] * 12, "acceleration": [4.0 * velocity] * 12}
        super().__init__(
            Arm(control), joints="qpos", touch="touch", joint_names=list(JOINTS), **limits
        )
