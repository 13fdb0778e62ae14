"""Body models that know the truth: what a perfect agent would find, in a frame of its own."""

import sys
from types import SimpleNamespace

import numpy as np

from selftouch_drake.agent.body_model.model import BASE, BodyModel, JointKind, independent
from selftouch_drake.evaluation.body_model import Similarity, true_axes

_TURN = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
#: A mirror, a turn, a scale and a shift: what touch cannot tell.
UNKNOWN = Similarity(
    scale=3.7,
    rotation=-np.sign(np.linalg.det(_TURN)) * _TURN,
    shift=np.array([0.4, -1.0, 2.0]),
)


def true_model(world, representation, truth, unknown=UNKNOWN, **changed) -> BodyModel:
    """The model of a robot of Drake's by its kinematics; all parts are accepted."""
    robot, num_kernels = world.robot, representation.num_targets
    tree, zero = robot.kinematics, np.zeros(robot.num_joints)
    axes = true_axes(tree, zero)
    twists = []
    for place, z, turns in zip(axes.place, axes.direction, tree.turns, strict=True):
        w, v = (z, -np.cross(z, place)) if turns else (np.zeros(3), z)
        w = np.linalg.det(unknown.rotation) * unknown.rotation @ w
        v = unknown.scale * unknown.rotation @ v - np.cross(w, unknown.shift)
        twists.append(np.concatenate([w, v]))
    X_WF = tree.poses(zero[None])[0]
    num_skins = len(robot.skins)
    of_part = [
        int(np.bincount(truth.skin[representation.part == part]).argmax())
        for part in range(representation.part.max() + 1)
    ]
    X_WL = X_WF[:num_skins][truth.skin]
    place = np.einsum("kij,kj->ki", X_WL[:, :, :3], truth.positions) + X_WL[:, :, 3]
    known = {
        "joint_names": tuple(robot.joint_names),
        "joint_parent": axes.parent,
        "twists": np.array(twists),
        "twist_sigma": np.full((robot.num_joints, 6), 0.001),
        "joint_kind": np.where(tree.turns, JointKind.TURNS, JointKind.SLIDES),
        "order_group": np.full(robot.num_joints, -1),
        "part_link": tree.owner[:num_skins][of_part],
        "toucher_link": tree.owner[num_skins:],
        "toucher_place": unknown(X_WF[num_skins:, :, 3]),
        "toucher_shape": np.zeros((len(robot.touchers), 5)),
        "kernel_part": representation.part,
        "kernel_place": unknown(place),
        "kernel_normal": np.full((num_kernels, 3), np.nan),
        "kernel_toucher": np.zeros(representation.num_rows, dtype=np.int8),
        "receptor_part": np.full(representation.target_sensations.shape[1], -1),
        "receptor_place": np.full((representation.target_sensations.shape[1], 3), np.nan),
        "receptor_normal": np.full((representation.target_sensations.shape[1], 3), np.nan),
        "receptor_sigma": np.full(representation.target_sensations.shape[1], np.nan),
        "accepted_by_part": np.ones(len(of_part), dtype=bool),
        "reason": "Held-out touches agree.",
        "held_out": np.full(len(of_part), 0.97),
        "inliers": np.full(len(of_part), 0.99),
        "criterion": np.full(len(of_part), -12.0),
        "num_touches": np.bincount(representation.part)[: len(of_part)],
        "dimension": 3,
        "seed": 0,
    }
    assert (tree.owner[:num_skins] >= BASE).all()
    known |= changed
    errors = independent(known["twist_sigma"], len(known["toucher_place"]))
    return BodyModel(**{"covariance": errors} | known)


def found_by(monkeypatch, find):
    """Lets the stage of learning find what `find(**arguments)` returns, without a fit."""
    name = "selftouch_drake.agent.body_model.find"

    def given(q, sensation, target, part, **options):
        return find(q=q, sensation=sensation, target=target, part=part, **options)

    monkeypatch.setitem(sys.modules, name, SimpleNamespace(find_body_model=given))
