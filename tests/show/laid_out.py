"""Small runs made by hand: no babbling, no learning.

`ball` is one finger on a ball that stands still. `two_skins` is two arms, a ball and a skin on the
left forearm, which moves: the plan slides over the forearm while both arms move, and then lands on
the ball.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from by_hand import laid_by_hand
from modelled import true_model
from scipy.optimize import least_squares

from selftouch_drake.agent.body_model.growth import Growth
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.recovery import RecoveredBody, RecoveredPart
from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.experience.store import Contacts, Shard, write_shard
from selftouch_drake.experiment import experiment_from_fields
from selftouch_drake.files import save_arrays
from selftouch_drake.quotient.holes import topology
from selftouch_drake.quotient.layout import Embedding
from selftouch_drake.quotient.smooth import smooth_path
from selftouch_drake.robot import Robot, World
from selftouch_drake.run.artifacts import save_body_model, save_learned, save_plan
from selftouch_drake.run.directory import RunDirectory

PER_KERNEL = 5
STAGES = ("nothing", "babbled", "learned", "planned", "executed")
MODELS = "package://selftouch_drake"
BALL = {
    "robot": {"directives": f"{MODELS}/one_finger.dmd.yaml"},
    "skins": {
        "body": {
            "link": "body",
            "surface": {"shape": "sphere", "radius": 0.25, "resolution": 0.06},
            "num_receptors": 20,
        }
    },
    "touching": {"fingertip": {"frame": "fingertip_0", "radius": 0.01}},
}
TWO_SKINS = {
    "robot": {"directives": f"{MODELS}/two_arms.dmd.yaml"},
    "skins": {
        "body": {
            "link": "body",
            "surface": {"shape": "sphere", "radius": 0.16, "resolution": 0.05},
            "num_receptors": 20,
        },
        "forearm": {
            "link": "left_arm::forearm",
            "surface": {
                "shape": "capsule", "radius": 0.06, "length": 0.15, "resolution": 0.03,
                "translation": [0.135, 0, 0], "rpy_deg": [0, 90, 0],
            },
            "thickness": 0.02,
            "num_receptors": 12,
        },
    },
    "touching": {
        "left_tip": {"frame": "left_hand::fingertip_0", "radius": 0.01},
        "right_tip": {"frame": "right_hand::fingertip_0", "radius": 0.01},
    },
}  # fmt: skip
FIELDS = {"ball": BALL, "two_skins": TWO_SKINS}


def spread(count: int) -> np.ndarray:
    """Evenly spread directions (Fibonacci)."""
    i = np.arange(count) + 0.5
    z, angle = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


@cache
def world_of(kind: str) -> World:
    """The world of a kind of run; it is the same for all of them."""
    return World(experiment_from_fields(fields_of(kind, kind)))


def fields_of(kind: str, name: str) -> dict:
    num_kernels = len(places_of(kind)[0])
    return FIELDS[kind] | {
        "name": name,
        "babbling": {"num_samples": PER_KERNEL * num_kernels},
        "representation": {"num_targets": num_kernels, "metric": "sensorimotor"},
    }


@cache
def places_of(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Skin `(K,)` and place `(K, 3)` m in the frame of its link, of each kernel."""
    if kind == "ball":
        return np.zeros(60, dtype=int), 0.25 * spread(60)
    # Of the forearm one side was touched: a patch with a rim.
    along, round_it = np.meshgrid(np.linspace(0.06, 0.21, 6), np.linspace(-1.4, 1.4, 5))
    sleeve = [along, 0.06 * np.sin(round_it), 0.06 * np.cos(round_it)]
    patch = np.stack([x.ravel() for x in sleeve], axis=1)
    ball = 0.16 * spread(50)
    return np.repeat([0, 1], [len(ball), len(patch)]), np.concatenate([ball, patch])


def lay_out(path, *, kind: str = "ball", stage: str = "executed", name: str = "") -> RunDirectory:
    """A run up to `stage`."""
    run = RunDirectory.create(path, experiment_from_fields(fields_of(kind, name or kind)))
    reached = STAGES.index(stage)
    laid = _Laid.of(kind)
    if reached >= 1:
        _babble(run, laid)
    if reached >= 2:
        _learn(run, laid)
    if reached >= 3:
        motion = motion_of(kind)
        save_plan(run, motion, *_ends(motion))
    if reached >= 4:
        save_plan(run, execution_of(kind), *_ends(motion))
    return run


def motion_of(kind: str) -> Motion:
    """The plan of a kind of run."""
    return _ball_motion() if kind == "ball" else _two_skins_motion()


@cache
def execution_of(kind: str) -> Execution:
    """Its execution, a milliradian behind."""
    motion = motion_of(kind)
    if kind == "ball":
        targets = _Laid.of(kind).targets
        blend = np.linspace(1.0, 0.0, len(motion.time_s))[:, None]
        felt = 3.0 * (blend * targets[0] + (1 - blend) * targets[40])
        felt[50:60] = 0.0
    else:
        felt = world_of(kind).probe.sensations(motion.q)
    return Execution(
        motion=motion,
        felt=felt,
        q_measured=motion.q + 0.001,
        v_measured=motion.v,
        torque=np.zeros_like(motion.q),
    )


def _ends(motion: Motion) -> tuple[int, int]:
    return int(motion.plan.nodes[0]), motion.plan.goal


@dataclass(frozen=True)
class _Laid:
    skin: np.ndarray
    places: np.ndarray
    targets: np.ndarray
    q: np.ndarray

    @staticmethod
    @cache
    def of(kind: str) -> "_Laid":
        skin, places = places_of(kind)
        models = world_of(kind).skins
        columns = []
        for number, model in enumerate(models):
            apart = np.linalg.norm(places[:, None] - model.fields.p_LS, axis=2)
            extent = np.ptp(model.fields.vertices, axis=0).max()
            columns.append(np.exp(-20 * (apart / extent) ** 2) * (skin == number)[:, None])
        felt = np.concatenate(columns, axis=1)
        targets = felt / np.linalg.norm(felt, axis=1, keepdims=True)
        num_joints = 6 if kind == "ball" else 12
        q = np.random.default_rng(0).uniform(-1, 1, (PER_KERNEL * len(skin), num_joints))
        return _Laid(skin, places, targets, q)


def _babble(run: RunDirectory, laid: _Laid) -> None:
    world = world_of("ball" if len(run.experiment.skins) == 1 else "two_skins")
    surfaces = {"receptor_skin": world.receptor_skin}
    for skin in world.skins:
        surfaces[f"{skin.name}_vertices"] = skin.fields.vertices
        surfaces[f"{skin.name}_faces"] = skin.fields.faces
        surfaces[f"{skin.name}_p_LS"] = skin.fields.p_LS
    save_arrays(run.skin, surfaces | run.body_stamp())
    num_rows = len(laid.q)
    skin = np.repeat(laid.skin, PER_KERNEL)
    shard = Shard(
        walk=0,
        num_steps=num_rows,
        num_impossible=0,
        step=np.arange(num_rows),
        q=laid.q,
        sensation=np.repeat(laid.targets, PER_KERNEL, axis=0),
        contacts=Contacts(
            offsets=np.arange(num_rows + 1),
            skin=skin.astype(np.int8),
            toucher=np.full(num_rows, len(run.experiment.touching) - 1, dtype=np.int8),
            p_LC=np.repeat(laid.places, PER_KERNEL, axis=0).astype(np.float32),
        ),
    )
    write_shard(run.path, shard, fingerprint=run.fingerprint())
    run.add_metrics({"babbling_num_samples": num_rows})


def _learn(run: RunDirectory, laid: _Laid) -> None:
    num_kernels = len(laid.skin)
    distance = np.linalg.norm(laid.places[:, None] - laid.places, axis=2)
    same = laid.skin[:, None] == laid.skin
    near = np.sort(np.where(same, distance, np.inf), axis=1)[:, 8][:, None]
    edges = np.argwhere(np.triu(same & (distance < np.maximum(near, near.T)), k=1))
    # What the agent recovers has no pose and no unit: here it is mirrored and 4 times as large.
    body = RecoveredBody(
        metric="sensorimotor",
        parts=tuple(
            _part(np.flatnonzero(laid.skin == skin), laid.places, distance)
            for skin in range(laid.skin.max() + 1)
        ),
        num_kernels=num_kernels,
    )
    representation = laid_by_hand(
        np.split(laid.q, num_kernels),
        edges,
        target_sensations=laid.targets,
        kernel_strength=np.linspace(0.5, 2.0, len(laid.q)),
        kernel_error=np.linspace(0.0, 0.1, len(laid.q)),
        overlap=laid.targets.T @ laid.targets > 0.01,
        part=laid.skin,
        set_distance=np.where(same, distance, 4.0),
        edge_cost=distance[edges[:, 0], edges[:, 1]],
        embedding=body.positions,
        kind=EmbeddedRepresentation,
    )
    save_learned(run, representation, body, TouchModel((None,)))
    model = _model_of(run, laid, representation)
    save_body_model(run, model)
    touches = np.arange(1, 10)
    life = LifeCurves(
        touches=touches,
        coverage=touches / 9,
        error=0.1 / touches,
        contact=touches / 10,
        block_touches=touches,
        surprise=0.3 / touches,
        changed=touches[4:5],
        noticed=touches[5:6],
        mended=touches[6:7],
    )
    growth = Growth.of([(50, model), (100, model)])
    save_arrays(run.life, life.to_arrays() | growth.to_arrays() | run.stamp())
    metrics = {
        "surface_rms_fraction": 0.0123,
        "unpractised_contact_mean": 0.812,
        "planning_contact_mean": 0.998,
    }
    betti = [list(part.topology.betti) for part in body.parts]
    if len(betti) == 1:
        metrics["topology_betti"] = betti[0]
    else:
        metrics |= {
            "topology_betti_by_part": betti,
            "topology_betti_true_by_part": betti,
            "surface_rms_fraction_by_skin": {"body": 0.012, "forearm": 0.034},
        }
    run.add_metrics(metrics)


def _model_of(run: RunDirectory, laid: _Laid, representation: QuotientRepresentation) -> BodyModel:
    """A model without a flaw; it does not matter that the postures were drawn at random."""
    truth = KernelTruth(
        skin=laid.skin,
        positions=laid.places,
        spread=np.full(len(laid.skin), 0.01),
        share_single=1.0,
    )
    world = world_of("ball" if len(run.experiment.skins) == 1 else "two_skins")
    return true_model(world, representation, truth)


def _part(kernels: np.ndarray, places: np.ndarray, distance: np.ndarray) -> RecoveredPart:
    positions = 4.0 * (places[kernels] - places[kernels].mean(axis=0)) * [1.0, 1.0, -1.0]
    return RecoveredPart(
        doubt=None,
        kernels=kernels,
        distances=distance[np.ix_(kernels, kernels)],
        skin_dimension=2,
        space_dimension=3,
        embedding=Embedding(
            positions=positions, stress=0.001, spectrum=np.linspace(1.0, 0.0, len(kernels))
        ),
        pieces=np.zeros((0, 3)),
        topology=topology(positions),
        dimension=2.0,
    )


def _ball_motion() -> Motion:
    laid = _Laid.of("ball")
    time_s = np.linspace(0.0, 1.2, 121)
    q = laid.q[0] + np.minimum(time_s / 1.2, 1.0)[:, None] * (laid.q[200] - laid.q[0])
    blend = np.linspace(1.0, 0.0, len(time_s))[:, None]
    return Motion(
        plan=Plan(
            nodes=np.array([0, 17, 40]),
            links=np.array([-1, -1]),
            in_air=np.array([False, False]),
            modes=np.full(len(np.array([0, 17, 40])) - 1, -1),
            imagined=np.zeros(len(np.array([0, 17, 40])), bool),
            waypoints_q=q[[0, 60, 120]],
            waypoint_s=time_s[[0, 60, 120]],
            path=smooth_path(q[[0, 60, 120]]),
        ),
        time_s=time_s,
        s=time_s,
        q=q,
        v=np.gradient(q, time_s, axis=0),
        predicted=laid.targets[0] * blend + laid.targets[40] * (1 - blend),
        predicted_spread=np.full(len(time_s), 0.01),
    )


#: Instants of the plan of `two_skins`: on the forearm, in the air, on the ball.
ON_FOREARM, IN_AIR, ON_BALL = slice(0, 50), slice(50, 100), slice(100, 121)


@cache
def sliding_places() -> np.ndarray:
    """`(50, 3)` m, positions of the right fingertip's centre along the forearm, in its frame."""
    along = np.linspace(0.10, 0.18, 50)
    return np.stack([along, np.zeros(50), np.full(50, 0.062)], axis=1)


@cache
def _two_skins_motion() -> Motion:
    laid, robot = _Laid.of("two_skins"), world_of("two_skins").robot
    time_s = np.linspace(0.0, 1.2, 121)
    q = np.zeros((len(time_s), 12))
    # The left arm turns all the time: the forearm moves under the fingertip, and then away.
    q[:, 0] = np.interp(np.arange(len(q)), [0, 50, 70, 120], [-0.5, -0.3, 0.4, 0.5])
    q[:, 1], q[:, 2] = 0.2, 0.4
    wanted: list[np.ndarray | None] = [None] * len(time_s)
    lifted = sliding_places()[-1] + [0.0, 0.0, 0.15]
    for row, place in [*enumerate(sliding_places()), (62, lifted)]:
        (pose,) = robot.skin_positions(q[row][None])[:, 1]
        wanted[row] = pose[:, :3] @ place + pose[:, 3]
    for row, angle in zip(range(100, 121), np.linspace(0.3, 0.6, 21), strict=True):
        wanted[row] = 0.155 * np.array([np.cos(angle), -np.sin(angle), 0.3]) / np.hypot(1.0, 0.3)
    wanted[85] = 1.8 * wanted[100]
    right = np.array([0.5, 0.3, 0.6, 0.0, 0.0, 0.0])
    for row, place in enumerate(wanted):
        if place is not None:
            right = _reaching(robot, q[row], right, place)
            q[row, 6:] = right
    known = [row for row, place in enumerate(wanted) if place is not None]
    for joint in range(6, 12):
        q[:, joint] = np.interp(np.arange(len(q)), known, q[known, joint])
    forearm, ball = 50 + 14, 7
    predicted = np.zeros((len(time_s), laid.targets.shape[1]))
    predicted[ON_FOREARM], predicted[ON_BALL] = laid.targets[forearm], laid.targets[ball]
    return Motion(
        plan=Plan(
            nodes=np.array([forearm, forearm + 1, ball, ball + 1]),
            links=np.array([-1, -1, -1]),
            in_air=np.array([False, True, False]),
            modes=np.full(len(np.array([forearm, forearm + 1, ball, ball + 1])) - 1, -1),
            imagined=np.zeros(len(np.array([forearm, forearm + 1, ball, ball + 1])), bool),
            waypoints_q=q[[0, 49, 100, 120]],
            waypoint_s=time_s[[0, 49, 100, 120]],
            path=smooth_path(q[[0, 49, 100, 120]]),
        ),
        time_s=time_s,
        s=time_s,
        q=q,
        v=np.gradient(q, time_s, axis=0),
        predicted=predicted,
        predicted_spread=np.full(len(time_s), 0.01),
    )


def _reaching(robot: Robot, q: np.ndarray, right: np.ndarray, place: np.ndarray) -> np.ndarray:
    """`(6,)` joints of the right arm that put its fingertip at a place, near the previous ones."""

    def missed(joints: np.ndarray) -> np.ndarray:
        tip = robot.toucher_positions(np.concatenate([q[:6], joints])[None])[0, 1]
        return np.concatenate([100 * (tip - place), 1e-3 * (joints - right)])

    return least_squares(missed, right).x
