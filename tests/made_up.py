"""A body model that is made up: a tree with several parts and touchers, and all kinds of joints."""

import numpy as np

from selftouch_drake.agent.body_model.model import BASE, UNUSED, BodyModel, JointKind, independent

TURNS, SLIDES, OPEN = JointKind.TURNS, JointKind.SLIDES, JointKind.OPEN

#: Two limbs on a base: a turn, a slide and an open joint; two turns; and a joint of no use.
NAMES = ("neck", "rail", "arm::elbow", "spare", "left_shoulder", "left_elbow")
PARENT = [BASE, 0, 1, UNUSED, BASE, 4]
KIND = [TURNS, SLIDES, OPEN, JointKind.UNUSED, TURNS, TURNS]
SLIDING = np.array([False, True, False, False, False, False])


def twist(axis, place=(0.0, 0.0, 0.0), scale=1.0):
    """A turn about an axis through a place."""
    w = scale * np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    return np.concatenate([w, -np.cross(w, place)])


def sphere_points(number, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """Places, evenly spread over a ball, and its normals."""
    n = np.arange(number) + 0.5
    up, around = 1 - 2 * n / number, np.pi * (1 + np.sqrt(5)) * n
    flat = np.sqrt(1 - up**2)
    normal = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=1)
    return radius * normal + np.asarray(centre), normal


def made_up_model(num_kernels=120, seed=0, **changed) -> BodyModel:
    """Part 0 is a ball on the base, part 1 one on the link of `rail`; both hands touch."""
    rng = np.random.default_rng(seed)
    place, normal = sphere_points(num_kernels)
    part = np.repeat([0, 1], [num_kernels // 2, num_kernels - num_kernels // 2])
    for number, (radius, centre) in enumerate([(1.0, (0.1, 0, 0)), (0.5, (2.0, 0.3, 0.1))]):
        count = int((part == number).sum())
        place[part == number], normal[part == number] = sphere_points(count, radius, centre)
    twists = np.array(
        [
            twist(rng.normal(size=3), rng.normal(size=3), 0.7),
            np.concatenate([np.zeros(3), [0.2, 0.3, -0.1]]),
            twist(rng.normal(size=3), rng.normal(size=3), 1.9),
            np.zeros(6),
            twist(rng.normal(size=3), rng.normal(size=3)),
            twist(rng.normal(size=3), rng.normal(size=3), 0.01),
        ]
    )
    known = {
        "joint_names": NAMES,
        "joint_parent": np.array(PARENT),
        "twists": twists,
        "twist_sigma": np.where(twists.any(axis=1)[:, None], 0.001, np.nan) + np.zeros((6, 6)),
        "joint_kind": np.array(KIND, dtype=int),
        "order_group": np.array([-1, -1, -1, -1, 0, 0]),
        "part_link": np.array([BASE, 1]),
        "toucher_link": np.array([2, 5]),
        "toucher_place": rng.normal(size=(2, 3)),
        "toucher_shape": np.array([[0.0] * 5, [0.01, 0.02, 0.03, -0.02, 0.01]]),
        "kernel_part": part,
        "kernel_place": place,
        "kernel_normal": normal,
        "kernel_toucher": np.repeat([0, 1], 10 * num_kernels // 2).astype(np.int8),
        "receptor_part": np.array([0, 0, 1, 1, -1]),
        "receptor_place": np.concatenate([place[:2], place[-2:], np.full((1, 3), np.nan)]),
        "receptor_normal": np.concatenate([normal[:2], normal[-2:], np.full((1, 3), np.nan)]),
        "receptor_sigma": np.array([0.01, 0.02, 0.01, 0.01, np.nan]),
        "accepted_by_part": np.array([True, True]),
        "reason": "Held-out touches agree.",
        "held_out": np.array([0.97, 0.96]),
        "inliers": np.array([0.99, 0.99]),
        "criterion": np.array([-12.0, -11.0]),
        "num_touches": np.array([100, 100]),
        "dimension": 3,
        "seed": 0,
    }
    known |= changed
    errors = independent(known["twist_sigma"], len(known["toucher_place"]))
    return BodyModel(**{"covariance": errors} | known)


def readings(number, seed=1):
    """`(n, 6)` readings of the joints of a made-up model, in units of their own."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, size=(number, 6)) * [2.0, 3.0, 1.0, 1.0, 2.0, 150.0]
