"""How far "rigid links on joints that turn or slide" holds: bodies that break it, more and more.

    python benchmarks/accuracy/assumption.py --seeds 21 22
    python benchmarks/accuracy/assumption.py --kinds none slack cam --seeds 21 --pairs 40
    python benchmarks/accuracy/assumption.py --kinds joint_noise --sizes 0.03 --seeds 21 --still

The paper's arm touches an ellipsoid, but something is wrong with arm, skin or readings, by several
sizes (`FAULTS`). Where the fingertip truly is follows from a chain with the fault in it; what is
felt there is Drake's contact. Columns: place of the fingertip in % of the extent (after one
similarity), accepted or not, share of held-out touches that are near; then contact before practice
of random plans, mean and worst, and goals felt: as the model imagines them (were it accepted or
not), and over the paper's representation, which the agent falls back on. With --still the fault is
gone when plans are followed: what is lost then is the model's fault, not that of the motors.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.representation.touches import felt_kernels
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.body_model import misfit
from benchmarks.shared.results import add_update_option, results

#: What is wrong, in which unit, and by how much.
FAULTS = {
    "none": ("", (0.0,)),
    "joint_noise": ("rad", (0.01, 0.03, 0.1)),
    "backlash": ("rad", (0.02, 0.06, 0.2)),
    "slack": ("m", (0.01, 0.03, 0.1)),
    "soft_finger": ("m", (0.01, 0.03, 0.06)),
    "stretch": ("rad", (0.03, 0.1, 0.3)),
    "cam": ("m", (0.01, 0.03, 0.1)),
    "delay": ("s", (0.01, 0.03, 0.1)),
}
TOUCHES, TARGETS = 8000, 200
#: rad/s, root mean square speed of each joint, to which the walk is scaled for delays.
_SPEED = 1.0
#: The joint of the arm at which slack and cams are.
_ELBOW = 2
#: mu, between samples of a plan; wide steps hide losses of contact.
_SAMPLED = 0.02
#: rad, between a motor configuration and the next, for derivatives.
_STEP = 1e-6


class Felt(NamedTuple):
    """What is felt at some postures: `(n, S)` N, and `(n, 3)` m where the fingertip truly is."""

    sensation: np.ndarray
    tip: np.ndarray


def twists_of(position: Callable[[np.ndarray], np.ndarray], joints: int) -> np.ndarray:
    """`(J, 6)` twists of hinges at q = 0, from where they carry a fingertip.

    The twist of a joint is seen from `p -> w x p + v` at postures in which only joints before it
    stand at 0: the fingertip is carried to four places by the joints behind it.
    """
    random = np.random.default_rng(0)
    found = np.zeros((joints, 6))
    for joint in range(joints):
        q = np.zeros((40, joints))
        q[:, joint + 1 :] = random.uniform(-1, 1, (40, joints - joint - 1))
        step = np.zeros(joints)
        step[joint] = _STEP
        here = position(q)
        slope = (position(q + step) - position(q - step)) / (2 * _STEP)
        rows = np.zeros((len(q), 3, 6))
        # w x p = -[p] w
        x, y, z = here.T
        rows[:, 0, 1], rows[:, 0, 2] = z, -y
        rows[:, 1, 0], rows[:, 1, 2] = -z, x
        rows[:, 2, 0], rows[:, 2, 1] = y, -x
        rows[:, :, 3:] = np.eye(3)
        found[joint] = np.linalg.lstsq(rows.reshape(-1, 6), slope.ravel(), rcond=None)[0]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """The skin, and a fingertip that can be anywhere: three rails carry it.

    Attributes:
        world: in which contact is computed.
        semi_axes: `(3,)` m.
        center: `(3,)` m, of the ellipsoid in the world.
        tip: `(3,)` m, the fingertip where all joints of the rails are 0.
        normals: of the skin's triangles, and a tree of their middles.
    """

    world: World
    semi_axes: np.ndarray
    center: np.ndarray
    tip: np.ndarray
    normals: np.ndarray
    middles: cKDTree

    @classmethod
    def made(cls) -> "Ellipsoid":
        """That of the experiment of this name."""
        skins = {"body": {"surface": {"shape": "ellipsoid", "semi_axes": [0.30, 0.24, 0.20]}}}
        world = World(load_experiment("gantry", {"skins": skins}))
        # `gantry` has a torus, whose keys are not those of an ellipsoid.
        joints = world.robot.num_joints
        tip = world.robot.toucher_positions(np.zeros((1, joints)))[0, 0]
        fields = world.skins[0].fields
        pose = world.robot.skin_positions(np.zeros((1, joints)))[0, 0]
        corners = (fields.vertices @ pose[:, :3].T + pose[:, 3])[fields.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return cls(
            world, np.array([0.30, 0.24, 0.20]), pose[:, 3], tip, normals,
            cKDTree(corners.mean(axis=1)),
        )  # fmt: skip

    def sensations(self, tip: np.ndarray) -> np.ndarray:
        """`(n, S)` N, with the fingertip at `(n, 3)` m."""
        q = np.zeros((len(tip), self.world.robot.num_joints))
        q[:, :3] = tip - self.tip
        return self.world.probe.sensations(q)

    def pressed(self, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(n, 3)` outward normals beside the fingertip, and `(n,)` how deep it is, 0 to 1."""
        distance, face = self.middles.query(tip)
        inside = (((tip - self.center) / self.semi_axes) ** 2).sum(axis=1) < 1
        return self.normals[face], np.where(inside, np.minimum(distance / 0.03, 1.0), 0.0)

    def stretched(self, tip: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Places on which receptors from elsewhere lie, where the skin is pulled to a pole.

        By an angle of `(n,)` rad at the equator, seen on a ball; depth is kept.
        """
        ball = (tip - self.center) / self.semi_axes
        size = np.linalg.norm(ball, axis=1, keepdims=True)
        across = np.linalg.norm(ball[:, :2], axis=1)
        polar = np.arctan2(across, ball[:, 2])
        moved = polar + by * np.sin(polar)
        flat = ball[:, :2] / np.maximum(across, 1e-9)[:, None] * np.sin(moved)[:, None]
        return self.center + self.semi_axes * size * np.column_stack([flat, np.cos(moved)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """The arm with its fault.

    Attributes:
        world: of the same arm without a fault.
        skin: what it touches.
        twists: `(J, 6)` of the joints of the arm.
        point: `(3,)` m, the fingertip at q = 0.
        kind: of the fault.
        size: of the fault.
    """

    world: World
    skin: Ellipsoid
    twists: np.ndarray
    point: np.ndarray
    kind: str = "none"
    size: float = 0.0

    @classmethod
    def whole(cls) -> "Body":
        """The arm without a fault."""
        world = World(load_experiment("ellipsoid"))
        joints = world.robot.num_joints

        def position(q: np.ndarray) -> np.ndarray:
            return world.robot.toucher_positions(q)[:, 0]

        return cls(
            world=world, skin=Ellipsoid.made(), twists=twists_of(position, joints),
            point=position(np.zeros((1, joints)))[0],
        )  # fmt: skip

    def feel(self, q: np.ndarray, velocity: np.ndarray, random: np.random.Generator) -> Felt:
        """What is felt while joints read `(n, J)` q and move at `(n, J)` rad/s."""
        kind, size = self.kind, self.size
        if kind == "joint_noise":
            q = q + size * random.standard_normal(q.shape)
        elif kind == "backlash":
            q = q - size / 2 * np.sign(velocity)
        elif kind == "delay":
            q = q - size * velocity
        tip = self._tip(q, random)
        if kind == "soft_finger":
            tip = self._bent(q, tip)
        felt_at = tip
        if kind == "stretch":
            felt_at = self.skin.stretched(tip, size * np.sin(q[:, 0]))
        return Felt(self.skin.sensations(felt_at), tip)

    def _tip(self, q: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """`(n, 3)` m; slack slides across the upper arm, a cam along it."""
        if self.kind not in ("slack", "cam"):
            return places(q, self.twists, self.point)
        along = np.zeros(6)
        along[3:] = [0, 1, 0] if self.kind == "slack" else [1, 0, 0]
        by = random.uniform(-1, 1, len(q)) if self.kind == "slack" else np.sin(q[:, _ELBOW])
        longer = np.insert(self.twists, _ELBOW, along, axis=0)
        return places(np.insert(q, _ELBOW, self.size * by, axis=1), longer, self.point)

    def _bent(self, q: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """The fingertip, bent across the finger by the skin that it presses."""
        back = self.point - [0.12, 0, 0]
        finger = tip - places(q, self.twists, back)
        finger /= np.linalg.norm(finger, axis=1, keepdims=True)
        normal, depth = self.skin.pressed(tip)
        across = normal - (normal * finger).sum(axis=1, keepdims=True) * finger
        return tip + self.size * depth[:, None] * across


def touches_of(body: Body, seed: int, number: int) -> tuple[np.ndarray, Felt]:
    """`(n, J)` readings and what was felt, of the first touches of a random walk."""
    experiment = load_experiment("ellipsoid", {"seed": seed})
    random = np.random.default_rng([seed, 5])
    walker = DrakeBody(body.world)
    q, felt, kept, walk = [], [], 0, 0
    while kept < number:
        steps = random_walk(experiment, walker, walk)
        walk += 1
        for _ in range(4):
            some = steps.steps(8192)
            moved = np.gradient(some, axis=0)
            velocity = moved * (_SPEED / moved.std(axis=0))
            here = body.feel(some, velocity, random)
            touching = here.sensation.any(axis=1)
            q.append(some[touching])
            felt.append(Felt(here.sensation[touching], here.tip[touching]))
            kept += int(touching.sum())
    sensation, tip = (np.concatenate(column)[:number] for column in zip(*felt, strict=True))
    return np.concatenate(q)[:number], Felt(sensation.astype(np.float32), tip)


def followed(
    agent: Agent, plan: Plan, body: Body, random: np.random.Generator
) -> tuple[float, bool]:
    """Share of a plan on which something is felt, and whether its goal is felt at the end."""
    s = np.linspace(0.0, plan.waypoint_s[-1], max(2, int(plan.waypoint_s[-1] / _SAMPLED)))
    q = plan.path(s)
    velocity = np.gradient(q, axis=0)
    velocity *= _SPEED / max(float(velocity.std()), 1e-9)
    # A plan ends at rest: the reading catches up, and play stays where it was.
    still = replace(body, kind="none") if body.kind == "delay" else body
    felt = still.feel(q, velocity, random).sensation
    end = felt_kernels(agent.representation, felt[-1])
    # Time in the air on purpose is no contact lost.
    expected = plan.touching(s)
    return float(felt[expected].any(axis=1).mean()), plan.goal in end


def look(body: Body, follower: Body, seed: int, num_pairs: int, touches: int) -> dict[str, object]:
    """Learns from a body with a fault, finds its model, and has a follower follow plans."""
    q, felt = touches_of(body, seed, touches)
    agent = Agent.learn(q, felt.sensation, num_targets=min(TARGETS, touches // 20), seed=seed)
    model = agent.find_body_model(body.world.robot.joint_names, seed=seed)
    row, kept = agent.representation.kernel_row, agent.representation
    target = np.repeat(np.arange(kept.num_targets), np.diff(kept.kernel_offsets))
    imagined = model.place(kept.kernel_q.astype(float), target)
    known = np.isfinite(imagined).all(axis=1)
    extent = float(np.linalg.norm(np.ptp(felt.tip, axis=0)))
    off = misfit(imagined[known], felt.tip[row][known], extent) if known.sum() > 20 else np.nan
    believed = replace(model, accepted_by_part=np.ones_like(model.accepted_by_part))
    ways = {"paper": agent}
    if known.sum() > 20:
        ways = {"imagined": replace(agent, body_model=believed), **ways}
    random = np.random.default_rng([seed, 6])
    pairs = random.permuted(np.tile(np.arange(kept.num_targets), (num_pairs, 1)), axis=1)[:, :2]
    line: dict[str, object] = {
        "kind": body.kind, "size": body.size, "unit": FAULTS[body.kind][0], "seed": seed,
        "touches": touches,
        "place_percent": round(off, 2), "accepted": bool(model.accepted),
        "near": round(float(model.held_out[0]), 3), "inliers": round(float(model.inliers[0]), 3),
    }  # fmt: skip
    for way in ("imagined", "paper"):
        found = np.full((1, 2), np.nan)
        if way in ways:
            planned = [ways[way].plan(*pair) for pair in pairs.tolist()]
            found = np.array(
                [followed(agent, plan, follower, random) for plan in planned], dtype=float
            )
        line[f"{way}_contact"] = round(100 * float(found[:, 0].mean()), 2)
        line[f"{way}_worst"] = round(100 * float(found[:, 0].min()), 1)
        line[f"{way}_goals"] = round(100 * float(found[:, 1].mean()), 1)
    return line


def main() -> None:
    """Prints and writes a line for each fault, size and seed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", nargs="+", choices=FAULTS, default=list(FAULTS))
    parser.add_argument("--sizes", type=float, nargs="+", help="of the faults; all by default")
    parser.add_argument("--seeds", type=int, nargs="+", default=[21, 22])
    parser.add_argument("--still", action="store_true", help="follow plans without the fault")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--touches", type=int, default=TOUCHES)
    add_update_option(parser, "assumption")
    args = parser.parse_args()
    whole = Body.whole()
    with results("assumption", update=args.update) as add:
        for kind in args.kinds:
            for size in args.sizes or FAULTS[kind][1]:
                for seed in args.seeds:
                    body = replace(whole, kind=kind, size=size)
                    follower = whole if args.still else body
                    line = look(body, follower, seed, args.pairs, args.touches)
                    add(line)
                    print(*line.values(), sep="  ", flush=True)


if __name__ == "__main__":
    main()
