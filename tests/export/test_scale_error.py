"""The standard error of the scale holds: of many noisy copies of a body, 95 % lie within two."""

import sys
from pathlib import Path

import numpy as np
import pytest
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
from selftouch_drake.export.unit import axes_apart, unit_from_joints, unit_from_receptors

sys.path.append(str(Path(__file__).parents[1] / "agent" / "body_model"))

from hand_made_chains import a_ball, an_arm, touches

COPIES, TOUCHES, KERNELS, RECEPTORS, JOINTS = 40, 600, 60, 40, 4
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


@pytest.fixture(scope="module")
def errors():
    """`(copies, 2)` of the scale in standard errors: by a distance of axes, and of receptors."""
    twists, point = an_arm(joints=JOINTS)
    q, target, y = touches(twists, point, number=COPIES * TOUCHES, kernels=KERNELS)
    center, radius = a_ball(np.random.default_rng(0), twists, point)
    receptor = y[:: len(y) // RECEPTORS][:RECEPTORS]
    random, rows = np.random.default_rng(1), []
    for copy in range(COPIES):
        some = np.arange(copy, len(q), COPIES)
        noisy = q[some] + 0.02 * random.standard_normal((len(some), JOINTS))
        far = np.linalg.norm(y[some][:, None] - receptor, axis=2) / radius
        model = found(twists, point, noisy, target[some], np.exp(-np.square(far / 0.5)))
        place = model.place(noisy, target[some])
        scale = Similarity.fitted(place, y[some]).scale
        pair = np.argsort(-np.linalg.norm(receptor - receptor[0], axis=1))[0]
        units = (
            unit_from_joints(model, NAMES[1], NAMES[2], axes_apart(twists[1:3])),
            unit_from_receptors(
                model, list(map(str, range(RECEPTORS))), "0", str(pair),
                float(np.linalg.norm(receptor[0] - receptor[pair])), touches=(noisy, target[some]),
            ),
        )  # fmt: skip
        rows.append([(unit.metres - scale) / unit.sigma for unit in units])
    return np.array(rows)


@pytest.mark.parametrize("way", [0, 1], ids=["length", "distance"])
def test_the_truth_lies_within_two_standard_errors(errors, way):
    assert np.mean(np.abs(errors[:, way]) < 2) >= 0.95
    # It is no larger than it has to be.
    assert np.sqrt(np.square(errors[:, way]).mean()) > 0.5
