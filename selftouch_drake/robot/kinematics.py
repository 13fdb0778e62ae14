"""Poses of many configurations at once, of any tree of joints that turn or slide."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, RevoluteJoint, RigidBody
from pydrake.systems.framework import Context

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.robot.links import all_joints


class TreeJoint(NamedTuple):
    """A moving joint in the tree of a plant.

    Attributes:
        joint: the joint.
        near: its frame on the body nearer to the world.
        far: its frame on the other body, the joint's child but in a model that is welded to the
            world by its tip.
        moved: the indices of all bodies that it moves.
    """

    joint: Joint
    near: Frame
    far: Frame
    moved: set[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kinematics:
    """The tree of moving joints, read off a plant, and frames that hang on it.

    A frame hangs on the joint that moves it last, and on none if it is fixed to the world. All
    transforms are `(3, 4)`: a rotation, then a translation in m.

    Attributes:
        parent: `(J,)` the joint before each one on its way to the world; -1 for none. Joints are in
            the order of q, a parent before its children.
        X_PF: `(J, 3, 4)` each joint's frame on the frame that its parent joint moves; the side away
            from the world moves along or about its z axis.
        turns: `(J,)` bool, whether the joint turns (rad) or slides (m).
        owner: `(L,)` the joint that each frame hangs on; -1 for none.
        X_JL: `(L, 3, 4)` each frame on the frame that its joint moves.
    """

    parent: np.ndarray
    X_PF: np.ndarray
    turns: np.ndarray
    owner: np.ndarray
    X_JL: np.ndarray

    @staticmethod
    def of(plant: MultibodyPlant, frames: Sequence[Frame]) -> "Kinematics":
        """Reads a finalized plant whose joints each have one degree of freedom."""
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.zeros(plant.num_positions()))
        tree = joint_tree(plant)
        X_WJ = [_axis_frame(each, context) for each in tree]
        parent = [_carrier(tree, each.near.body()) for each in tree]
        owner = [_carrier(tree, frame.body()) for frame in frames]
        X_WL = [frame.CalcPoseInWorld(context) for frame in frames]
        return Kinematics(
            parent=np.array(parent, dtype=np.int64),
            X_PF=_relative(X_WJ, X_WJ, parent),
            turns=np.array([isinstance(each.joint, RevoluteJoint) for each in tree]),
            owner=np.array(owner, dtype=np.int64),
            X_JL=_relative(X_WL, X_WJ, owner),
        )

    def poses(self, q: np.ndarray) -> np.ndarray:
        """`(N, L, 3, 4)` poses of the frames in the world at `q` `(N, J)`."""
        q = np.ascontiguousarray(q, dtype=float)
        X_WL = np.empty((len(q), len(self.owner), 3, 4))
        _all_poses(q, self.parent, self.X_PF, self.turns, self.owner, self.X_JL, X_WL)
        return X_WL


def joint_tree(plant: MultibodyPlant) -> list[TreeJoint]:
    """The moving joints of a finalized plant, in the order of its positions."""
    tree = []
    moving = [joint for joint in all_joints(plant) if joint.num_positions()]
    for joint in sorted(moving, key=lambda joint: joint.position_start()):
        moved = {int(body) for body in plant.GetBodiesKinematicallyAffectedBy([joint.index()])}
        near, far = joint.frame_on_parent(), joint.frame_on_child()
        if int(far.body().index()) not in moved:
            near, far = far, near
        tree.append(TreeJoint(joint=joint, near=near, far=far, moved=moved))
    return tree


def _axis_frame(each: TreeJoint, context: Context) -> RigidTransform:
    """The pose in the world of a joint's frame, turned so that its axis is z.

    At zero, the frame that a joint moves lies in the frame in which it moves.
    """
    joint = each.joint
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    if each.near.index() != joint.frame_on_parent().index():
        axis = -axis
    R_FJ = RotationMatrix.MakeFromOneVector(axis, 2)
    X_WF = joint.frame_on_parent().CalcPoseInWorld(context)
    return X_WF @ RigidTransform(R_FJ, np.zeros(3))


def _carrier(tree: Sequence[TreeJoint], body: RigidBody) -> int:
    """The last moving joint on the way from the world to a body; -1 for none."""
    carriers = [k for k, each in enumerate(tree) if int(body.index()) in each.moved]
    return min(carriers, key=lambda k: len(tree[k].moved), default=-1)


def _relative(
    X_WF: Sequence[RigidTransform], X_WJ: Sequence[RigidTransform], joints: Sequence[int]
) -> np.ndarray:
    """`(n, 3, 4)` poses of frames on the frames of the joints with these numbers; -1: the world."""
    X_JF = [
        X if joint < 0 else X_WJ[joint].InvertAndCompose(X)
        for X, joint in zip(X_WF, joints, strict=True)
    ]
    return np.array([X.GetAsMatrix34() for X in X_JF]).reshape(-1, 3, 4)


@compiled
def _all_poses(q, parent, X_PF, turns, owner, X_JL, X_WL):
    # The world, then what each joint moves.
    X = np.zeros((len(parent) + 1, 3, 4))
    for i in range(3):
        X[0, i, i] = 1.0
    X_WF, X_FJ = np.empty((1, 3, 4)), np.zeros((1, 3, 4))
    # For a literal numba would compile `_compose` again.
    only = np.int64(0)
    for row in range(len(q)):
        for joint in range(len(parent)):
            _compose(X, parent[joint] + 1, X_PF, joint, X_WF, only)
            _move(q[row, joint], turns[joint], X_FJ)
            _compose(X_WF, only, X_FJ, only, X, joint + 1)
        for frame in range(len(owner)):
            _compose(X, owner[frame] + 1, X_JL, frame, X_WL[row], frame)


@inner
def _compose(A, a, B, b, out, o):
    """Writes the product of two transforms, A[a] and B[b], into out[o], which is neither."""
    for i in range(3):
        for j in range(4):
            total = A[a, i, 0] * B[b, 0, j] + A[a, i, 1] * B[b, 1, j] + A[a, i, 2] * B[b, 2, j]
            out[o, i, j] = total + A[a, i, 3] if j == 3 else total


@inner
def _move(q, turns, X_FJ):
    """Writes what a joint does at `q` into X_FJ[0]."""
    c, s, shift = (np.cos(q), np.sin(q), 0.0) if turns else (1.0, 0.0, q)
    X_FJ[0, 0, 0], X_FJ[0, 0, 1] = c, -s
    X_FJ[0, 1, 0], X_FJ[0, 1, 1] = s, c
    X_FJ[0, 2, 2], X_FJ[0, 2, 3] = 1.0, shift
