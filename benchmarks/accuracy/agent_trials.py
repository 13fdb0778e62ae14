"""Small experiments, one for each part of the agent, that `agent_constants.py` repeats.

Each returns arrays and numbers by name. It imports what it needs when it is called: by then a
constant of the agent may have been changed.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
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
    from benchmarks.shared.raw_skin import recorded
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
    return {
        "rows": found.rows,
        "null": found.null,
        "sensation": np.asarray(felt.todense() if hasattr(felt, "todense") else felt),
        "threshold": found.baseline.threshold,
        "lost": found.lost,
        "turning": turning(turned, found.sensation),
        "wrapping": wrapping(turned, follows),
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
    """Rounds of all explorers on a cube."""
    from selftouch_drake.agent.agent import Agent
    from selftouch_drake.agent.lifelong import explorer
    from selftouch_drake.bodies.drake import DrakeBody
    from selftouch_drake.experiment import load_experiment
    from selftouch_drake.robot import World

    representation, felt = known("cube_1", 80)
    agent = Agent.of(representation, kernel_sensation=felt)
    body = DrakeBody(World(load_experiment("cube")))
    found: Results = {}
    for kind in ("ContactExplorer", "ModelExplorer", "PostureHolder"):
        q = representation.kernel_q[0].astype(float)
        one = getattr(explorer, kind)(
            agent=agent,
            q=q,
            felt=body.feel(q[None]).sensation[0],
            rng=np.random.default_rng(0),
            lower=body.lower,
            upper=body.upper,
            stride=0.15 * np.ones(len(q)),
        )
        moves = one.moves()
        path, went, touched = next(moves), [], 0
        for _ in range(400):
            sensation = body.feel(path).sensation
            went.append(path)
            touched += int(sensation.any(axis=1).sum())
            path = moves.send((path, sensation))
        found[f"{kind}_path"] = np.concatenate(went)
        found[f"{kind}_touched"] = touched
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
    "lifelong": life,
    "planning": plans,
    "practice": plans,
    "memory": plans,
    "pilot": plans,
}


def trial_of(module: str) -> Callable[[], Results] | None:
    """The experiment of a module below `selftouch_drake.agent`; None if there is none."""
    return next((trial for start, trial in TRIALS.items() if module.startswith(start)), None)
