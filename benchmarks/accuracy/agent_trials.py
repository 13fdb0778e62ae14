"""Small experiments, one for each part of the agent, that `agent_constants.py` repeats.

Each returns arrays and numbers by name. It imports what it needs when it is called: by then a
constant of the agent may have been changed.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.shared.results import ROOT

#: Results of a trial by name: arrays and numbers.
Results = dict[str, Any]


def recording(name: str, num_rows: int) -> tuple[np.ndarray, np.ndarray]:
    """`q` and sensations of a shipped recording, or of a `sphere` that is made up."""
    if name == "sphere":
        return sphere(num_rows)
    with np.load(ROOT / "recordings" / f"{name}.npz") as file:
        return file["q"][:num_rows].astype(float), file["sensation"][:num_rows]


def sphere(num_rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A sphere with 40 receptors that is touched evenly: five joints, of which three tell where."""
    from benchmarks.shared.raw_skin import fibonacci

    rng = np.random.default_rng(0)
    place, receptors = fibonacci(num_rows), fibonacci(40)
    firm = rng.uniform(0.2, 1.0, (num_rows, 1))
    q = np.hstack([place, rng.uniform(-0.3, 0.3, (num_rows, 2))])
    return q, np.clip(place @ receptors.T, 0.0, None) ** 4 * firm


def known(name: str, num_targets: int) -> Any:
    """The representation of a recording, and what was felt in it; learned once for all trials."""
    from selftouch_drake.agent.representation.kernel_sensations import kernel_sensations
    from selftouch_drake.agent.representation.learning import learn

    kept = Path(os.environ["SELFTOUCH_TRIALS"]) / f"{name}.pickle"
    if kept.exists():
        return pickle.loads(kept.read_bytes())
    q, sensation = recording(name, 12_000 if name == "sphere" else 8000)
    learned = learn(lambda: [(sensation, q)], num_targets=num_targets, max_kernel_size=1000)
    found = learned.representation
    made = found, kernel_sensations(found.kernel_row, [sensation])
    kept.write_bytes(pickle.dumps(made))
    return made


def learning() -> Results:
    """Representations of a cube, and of a body with two arms."""
    from selftouch_drake.agent.representation.learning import learn

    found: Results = {}
    for name, num_targets, num_rows in (("cube_1", 80, 3000), ("two_arms_1", 60, 6000)):
        q, sensation = recording(name, num_rows)
        learned = learn(
            lambda q=q, sensation=sensation: [(sensation, q)],
            num_targets=num_targets,
            max_kernel_size=1000,
        ).representation
        found |= {f"{name}_{key}": value for key, value in learned.to_arrays().items()}
        found[f"{name}_num_parts"] = learned.num_parts
        found[f"{name}_num_modes"] = len(learned.mode_joints)
    return found


def shapes() -> Results:
    """The body of a sphere, by two metrics."""
    from selftouch_drake.agent.shape.recovery import recover

    found: Results = {}
    for metric in ("learned", "sensorimotor"):
        body = recover(known("sphere", 250)[0], metric)
        found[f"{metric}_positions"] = body.parts[0].positions
        found[f"{metric}_stress"] = body.parts[0].embedding.stress
        found[f"{metric}_error"] = body.expected_error or 0.0
    return found


def receptor_map() -> Results:
    """Places of the receptors of a sphere."""
    from benchmarks.shared.raw_skin import recorded
    from selftouch_drake.agent.shape.receptor_map import map_receptors

    skin = recorded(6000, 60)
    touching = skin.force.any(axis=1)
    q, force = skin.q[touching], skin.force[touching]
    found = map_receptors(q, force, [str(n) for n in range(force.shape[1])])
    return {"positions": found.positions, "error": found.error, "part": found.part}


def plans() -> Results:
    """Plans, practised in a body without dynamics, timed and predicted."""
    from selftouch_drake.agent.agent import Agent
    from selftouch_drake.agent.pilot import Pilot
    from selftouch_drake.agent.planning.touch_model import TouchModel
    from selftouch_drake.bodies.drake import DrakeBody
    from selftouch_drake.experiment import load_experiment
    from selftouch_drake.robot import World

    representation, felt = known("cube_1", 80)
    touch_model = TouchModel.learn(representation, lambda: felt)
    agent = Agent.of(representation, kernel_sensation=felt, touch_model=touch_model)
    pilot = Pilot(agent, DrakeBody(World(load_experiment("cube"))))
    found: Results = {}
    for start, goal in ((3, 60), (10, 44), (71, 20)):
        tries = pilot.rehearse(start, goal, max_tries=2)
        motion, last = tries[-1].execution.motion, tries[-1].execution
        key = f"plan_{start}_{goal}"
        found |= {f"{key}_q": motion.q, f"{key}_predicted": motion.predicted}
        found[f"{key}_contact"] = motion.contact(last.felt)
        found[f"{key}_seconds"] = float(motion.time_s[-1])
        found[f"{key}_length"] = float(motion.plan.waypoint_s[-1])
    return found


def readings() -> Results:
    """Touches in raw readings with spikes, lost packets and a turning joint."""
    from benchmarks.shared.raw_skin import fibonacci, recorded
    from selftouch_drake.agent.readings.found_touches import find_touches
    from selftouch_drake.agent.readings.turns import turning, wrapping

    skin = recorded(6000, 60)
    raw = skin.raw.astype(float)
    raw[1000:1040] = raw[1000]
    raw[2000:2010] = 0.0
    found = find_touches(skin.q, raw)
    felt = found.sensation
    turned = skin.q[found.rows].copy()
    turned[:, 0] = np.mod(7.0 * turned[:, 0], 2 * np.pi)
    follows = np.diff(found.rows) == 1
    # A table that turns under a finger, within one turn and through nearly two.
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(-np.pi, np.pi, 4000), rng.uniform(-0.9, 0.9, 4000)
    flat = np.sqrt(1 - height**2)
    place = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    on_table = np.clip(place @ fibonacci(40).T, 0.0, None) ** 4
    round_once = np.column_stack([angle, height])
    round_twice = np.column_stack([angle + 2 * np.pi * rng.integers(2, size=4000), height])
    return {
        "rows": found.rows,
        "null": found.null,
        "sensation": np.asarray(felt.todense() if hasattr(felt, "todense") else felt),
        "threshold": found.baseline.threshold,
        "lost": found.lost,
        "turning": turning(turned, found.sensation),
        "wrapping": wrapping(turned, follows),
        "round_once": turning(round_once, on_table),
        "round_twice": turning(round_twice, on_table),
    }


def life() -> Results:
    """A life in which a joint's zero moves and a receptor dies."""
    from benchmarks.shared.raw_skin import recorded
    from selftouch_drake.agent.lifelong.learner import OnlineLearner
    from selftouch_drake.agent.lifelong.life import Life

    skin = recorded(26_000, 30)
    touching = np.flatnonzero(skin.force.any(axis=1))[:9500]
    q, force = skin.q[touching].astype(np.float32), skin.force[touching]
    q[6500:, 1] += 0.4
    force[6500:, 3] = 0.0
    lived = Life(lambda: OnlineLearner(40, 60), num_steps=3000)
    lived.take(q, force)
    noticed = lived.noticed
    known_now = lived.learner.representation
    return {
        "num_noticed": len(noticed),
        "first_noticed": noticed[0].row if noticed else -1,
        "surprise": np.concatenate(lived.surprise),
        "doubts": np.array(lived.doubts),
        "targets": known_now.target_sensations,
        "edges": known_now.edges,
    }


def exploring() -> Results:
    """Rounds of all explorers on a cube, and of one on a body with two arms."""
    from selftouch_drake.agent.agent import Agent
    from selftouch_drake.agent.lifelong import explorer
    from selftouch_drake.bodies.drake import DrakeBody
    from selftouch_drake.experiment import load_experiment
    from selftouch_drake.robot import World

    found: Results = {}
    for kind, name, recorded, more in (
        ("ContactExplorer", "cube", "cube_1", {}),
        ("ContactExplorer", "cube", "cube_1", {"dwell": explorer.RESTLESS}),
        ("ModelExplorer", "cube", "cube_1", {"chain": chain()}),
        ("ModelExplorer", "two_arms", "two_arms_1", {}),
        ("PostureHolder", "cube", "cube_1", {}),
    ):
        representation, felt = known(recorded, 80)
        body = DrakeBody(World(load_experiment(name)))
        q = representation.kernel_q[0].astype(float)
        one = getattr(explorer, kind)(
            agent=Agent.of(representation, kernel_sensation=felt),
            q=q,
            felt=body.feel(q[None]).sensation[0],
            rng=np.random.default_rng(0),
            lower=body.lower,
            upper=body.upper,
            stride=0.15 * np.ones(len(q)),
            **more,
        )
        moves = one.moves()
        path, went, touched = next(moves), [], 0
        for _ in range(300):
            sensation = body.feel(path).sensation
            went.append(path)
            touched += int(sensation.any(axis=1).sum())
            path = moves.send((path, sensation))
        key = "_".join([kind, name, *more])
        found[f"{key}_path"] = np.concatenate(went)
        found[f"{key}_touched"] = touched
    return found


def chain() -> Any:
    """The chain of a cube, from 200 touches; found once for all trials."""
    from selftouch_drake.agent.body_model.known_chain import found_chain

    kept = Path(os.environ["SELFTOUCH_TRIALS"]) / "chain.pickle"
    if not kept.exists():
        kept.write_bytes(pickle.dumps(found_chain(*recording("cube_1", 200))))
    return pickle.loads(kept.read_bytes())


def given_models() -> Results:
    """A drawn arm on a ball: two numbers of the drawing are wrong, and two receptors exchanged."""
    from selftouch_drake.agent.given_model import refit, taxels, wrong

    rng = np.random.default_rng(2)
    drawn, radius = drawn_arm(), 0.01
    changes = [one for one in drawn.changes() if one.text in ("offset", "shift along x")][1:3]
    true = drawn.changed(changes, np.array([0.06, 0.02]))
    q = rng.uniform(-1.5, 1.5, (40_000, 5))
    places = true.places(q)
    middle = places.mean(axis=0)
    q = q[np.abs(np.linalg.norm(places - middle, axis=1) - 0.3) < 0.01][:160]
    away = true.places(q) - middle
    touched = middle + 0.29 * away / np.linalg.norm(away, axis=1, keepdims=True)
    receptors = middle + 0.29 * farthest(away, 24)
    apart = np.linalg.norm(touched[:, None] - receptors, axis=2)
    sensation = np.maximum(1 - (apart / 0.3) ** 2, 0) ** 2
    felt = sensation.any(axis=1)
    q, sensation = q[felt], sensation[felt]

    found: Results = {}
    for name, way in (("right", drawn), ("wrong", _with_axis(drawn, 2, (0.0, -1.0, 0.0)))):
        verdict = wrong.judged_tree(way, q, sensation)
        found |= {f"{name}_apart": verdict.apart, f"{name}_best": verdict.best_apart}
        found |= {f"{name}_fits": verdict.fits, f"{name}_new": verdict.new_axes}
    mended = refit.refitted(drawn, q, sensation, radius)
    for name in ("amounts", "sigma", "kept", "places", "place_sigma", "normals", "suspect"):
        found[name] = getattr(mended, name)
    found["looked_for"] = np.array([f"{one.frame} {one.text}" for one in mended.changes])
    found["error"] = float(np.abs(mended.way.places(q) - true.places(q)).mean())
    # Receptors 15 cm apart: two are exchanged, three are 6, 12 and 9 cm from where the file says,
    # the last of them found less exactly.
    said, error = receptors.copy(), np.full(receptors.shape, 0.0005)
    said[[3, 11]] = said[[11, 3]]
    said[[7, 15, 20], 2] += 0.06, 0.12, 0.09
    error[20] = 0.01
    beside = taxels.compared(receptors + rng.normal(0, 0.0005, error.shape), error, said)
    for name in ("off", "elsewhere", "read_as", "turn", "scale"):
        found[f"taxels_{name}"] = getattr(beside, name)
    return found


def drawn_arm() -> Any:
    """A head that turns on a trunk, and an arm of four joints; the last but one slides."""
    from selftouch_drake.agent.given_model.way import GivenWay

    def pose(*shift: float) -> np.ndarray:
        X = np.eye(4)
        X[:3, 3] = shift
        return X

    origins = [(0, 0, 0.5), (0.3, 0, 0), (0, 0.1, 0), (0.4, 0, 0), (0.2, 0, 0)]
    return GivenWay(
        names=("neck", "yaw", "pitch", "slide", "wrist"),
        slides=np.array([False, False, False, True, False]),
        axes=np.array([[0, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [0.6, 0, 0.8]]),
        signs=np.array([-1.0, 1, 1, 1, 1]),
        origins=np.array([pose(*shift) for shift in origins]),
        skin=pose(0, 0, 0.1),
        toucher=pose(0.1, 0, 0),
        mount="tip",
    )


def _with_axis(way: Any, joint: int, axis: tuple[float, float, float]) -> Any:
    axes = np.array(way.axes, dtype=float)
    axes[joint] = axis
    return replace(way, axes=axes)


def farthest(directions: np.ndarray, number: int) -> np.ndarray:
    """`(number, 3)` unit vectors among some directions, each the farthest from those before."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    kept, apart = [], np.full(len(unit), np.inf)
    for _ in range(number):
        kept.append(unit[apart.argmax()])
        apart = np.minimum(apart, np.linalg.norm(unit - kept[-1], axis=1))
    return np.array(kept)


def lessons() -> Results:
    """What a lesson asks for a body model, when it is enough, and what it asks a person to do."""
    from selftouch_drake.agent import lesson

    found: Results = {}

    def asked(q: np.ndarray, sensation: object, label: np.ndarray, part: np.ndarray, **_: object):
        found[f"{len(q)}_label"], found[f"{len(q)}_part"] = label, part

    lesson.find_body_model = asked  # type: ignore[assignment]
    q, sensation = recording("two_arms_1", 1000)
    for num_touches in (150, 500, 1000):
        lesson.ask(q[:num_touches], sensation[:num_touches], ["joint"] * q.shape[1])
    joints = [
        lesson.JointKnown(name="joint", seen=seen, kind="turns", error_deg=error)
        for seen in (0.1, 0.3, 0.6, 0.9)
        for error in (1.0, 2.0, 5.0, 9.0)
    ]
    states = [
        lesson.Known(
            num_touches=num_touches,
            joints=some,
            felt=np.repeat([0, 2, 4, 9], [less, 2, 2, 36 - less]),
            names=[f"taxel {n}" for n in range(40)],
            accepted=True,
            reason="",
        )
        for num_touches in (200, 400, 800)
        for some in (joints[-4:-2], joints)
        for less in (1, 4, 12)
    ]
    found["is_enough"] = np.array([state.is_enough for state in states])
    said = [step.text for state in states for step in lesson.next_steps(state)]
    found["steps"] = np.array(said)
    return found


def body_models() -> Results:
    """The body model of a cube from 1,000 touches by sensations, and from 8,000 by labels."""
    from selftouch_drake.agent.body_model.asking import kernel_of_rows
    from selftouch_drake.agent.body_model.find import find_body_model
    from selftouch_drake.agent.representation.learning import learn

    found: Results = {}
    q, sensation = recording("cube_1", 1000)
    few = learn(lambda: [(sensation, q)], num_targets=60, max_kernel_size=1000).representation
    many, _ = known("cube_1", 80)
    for name, representation in (("few", few), ("many", many)):
        from scipy.sparse import csr_array

        felt = csr_array(recording("cube_1", 8000)[1][representation.kernel_row])
        model = find_body_model(
            representation.kernel_q.astype(float),
            felt,
            kernel_of_rows(representation),
            representation.part,
            joint_names=[str(n) for n in range(6)],
        )
        arrays = model.to_arrays()
        found |= {f"{name}_{key}": value for key, value in arrays.items()}
        for key in ("held_out", "criterion"):
            found[f"{name}_{key}"] = float(np.ravel(arrays[key])[0])
    return found


#: The experiment of each module, by the beginning of its name; the first that fits.
TRIALS: dict[str, Callable[[], Results]] = {
    "body_model": body_models,
    "representation": learning,
    "shape.receptor_map": receptor_map,
    "shape.unfolding": receptor_map,
    "shape": shapes,
    "network": shapes,
    "clusters": learning,
    "readings": readings,
    "lifelong.explorer": exploring,
    "given_model": given_models,
    "lesson": lessons,
    "lifelong": life,
    "planning": plans,
    "practice": plans,
    "memory": plans,
    "pilot": plans,
}


def trial_of(module: str) -> Callable[[], Results] | None:
    """The experiment of a module below `selftouch_drake.agent`; None if there is none."""
    return next((trial for start, trial in TRIALS.items() if module.startswith(start)), None)
