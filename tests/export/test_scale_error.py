"""The standard error of the scale holds: for many noisy copies of bodies."""

import itertools
import sys
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.assemble import Found, assembled
from selftouch_drake.agent.body_model.fit import chain_way
from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene
from selftouch_drake.agent.body_model.standard_errors import covariance
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.who_touched import started
from selftouch_drake.evaluation.body_model import Similarity
from selftouch_drake.export.surface import part_surface, with_receptors_on
from selftouch_drake.export.unit import axes_apart, unit_from_joints, unit_from_receptors

sys.path.append(str(Path(__file__).parents[1] / "agent" / "body_model"))

from hand_made_chains import a_ball, an_arm, nearest_of, touches

COPIES, TOUCHES, KERNELS, RECEPTORS, JOINTS = 8, 1200, 60, 40, 5
#: On where a touch is felt, in radii of the skin.
NOISE = 0.02
NAMES = [f"joint_{number}" for number in range(JOINTS)]


def found(twists, point, q, target, sensation):
    """The body model of touches, by a fit that begins at the truth."""
    part = np.zeros(KERNELS, dtype=int)
    scene = Scene(q, target, part, {(0, 0): chain_way(list(range(JOINTS)))})
    solution = refined(scene, started(scene, twists, point[None]))
    body = Found(
        tree=Tree.chain(list(range(JOINTS))), scene=scene, rows=np.arange(len(q)),
        solution=solution, center=np.zeros(JOINTS), scale=np.ones(JOINTS),
        kind=np.full(JOINTS, int(JointKind.TURNS)), order_group=np.full(JOINTS, -1),
        judgements={}, seed=0, spread=covariance(scene, solution),
    )  # fmt: skip
    return assembled(body, joint_names=NAMES, num_rows=len(q), sensation=csr_array(sensation))


def errors(body):
    """`(copies, 2)` of the scale in standard errors: by a distance of axes, and of receptors."""
    twists, point = an_arm(seed=body, joints=JOINTS)
    q, _, y = touches(twists, point, number=COPIES * TOUCHES, kernels=KERNELS)
    _, radius = a_ball(np.random.default_rng(0), twists, point)
    receptor = y[:: len(y) // RECEPTORS][:RECEPTORS]
    other = int(np.linalg.norm(receptor - receptor[0], axis=1).argmax())
    pairs = itertools.combinations(range(JOINTS), 2)
    joints = max(pairs, key=lambda pair: axes_apart(twists[list(pair)]))
    random, rows = np.random.default_rng(1), []
    for copy in range(COPIES):
        some = np.arange(copy, len(q), COPIES)
        felt = y[some] + NOISE * radius * random.standard_normal((len(some), 3))
        far = np.linalg.norm(felt[:, None] - receptor, axis=2) / radius
        own, target = q[some], nearest_of(felt, KERNELS)
        model = found(twists, point, own, target, np.exp(-np.square(far / 0.5)))
        place = model.place(own, target)
        model = with_receptors_on(model, {0: part_surface(model, 0, place)})
        first, second = (NAMES[joint] for joint in joints)
        units = (
            unit_from_joints(model, first, second, axes_apart(twists[list(joints)])),
            unit_from_receptors(
                model, list(map(str, range(RECEPTORS))), "0", str(other),
                float(np.linalg.norm(receptor[0] - receptor[other])), touches=(own, target),
            ),
        )  # fmt: skip
        scale = Similarity.fitted(place, y[some]).scale
        rows.append([(unit.metres - scale) / unit.sigma for unit in units])
    return np.array(rows)


def test_the_truth_lies_within_two_standard_errors():
    apart = np.concatenate([errors(body) for body in (1, 2)])
    # One of sixteen is 6 %.
    assert (np.sum(np.abs(apart) > 2, axis=0) <= 1).all()
    # They are no larger than they have to be.
    assert (np.sqrt(np.square(apart).mean(axis=0)) > 0.5).all()
