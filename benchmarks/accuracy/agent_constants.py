"""Which of the agent's own constants change anything: each is doubled and halved.

    python benchmarks/accuracy/agent_constants.py
    python benchmarks/accuracy/agent_constants.py --only shape lifelong.alarm
    python benchmarks/accuracy/agent_constants.py --list

Every value is tried in a process of its own, in which the module is loaded with the other number in
its source. So it holds in default arguments, in constants that follow from it, and in what numba
compiles. Each part of the agent has a small experiment (`TRIALS`). A row of the table is one value
of one constant: whether all arrays of its experiment have the same bytes as with the constant as it
is, how many of them differ, and the first metrics that do, with their values before and after.

A constant of which both rows say `same` is one on which these experiments do not depend; it may
still guard against input that none of them holds. Sizes of blocks of work change no result.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import ROOT, add_update_option, results

PACKAGE = "selftouch_drake.agent"
FOLDER = ROOT / "selftouch_drake" / "agent"
#: Decorators of functions that numba compiles, with the numbers that they mention.
COMPILERS = {"njit", "compiled", "inner", "inner_in_any_order"}
#: Series, numbers of files and kinds: no choices.
NO_CHOICES = {"body_model.model", "records", "motions"}

#: Results of a trial by name: arrays and numbers.
Results = dict[str, Any]


# --- constants -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A number, or several, at the top of a module; as text `shape.metrics._MOST_UNLIKE`.

    Attributes:
        module: below `selftouch_drake.agent`.
        name: as it is assigned.
        value: as it is.
        is_compiled: whether numba freezes it.
    """

    module: str
    name: str
    value: Any
    is_compiled: bool

    def __str__(self) -> str:
        return f"{self.module}.{self.name}"

    def times(self, factor: float) -> Any:
        """The value times a factor; whole numbers stay whole, and at least 1."""
        return _times(self.value, factor)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_times(one, factor) for one in value)
    if isinstance(value, dict):
        return {key: _times(one, factor) for key, one in value.items()}
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def constants() -> Iterator[Constant]:
    """All constants of the agent that are numbers, tuples of them, or dictionaries to them."""
    for path in sorted(FOLDER.rglob("*.py")):
        module = path.relative_to(FOLDER).with_suffix("").as_posix().replace("/", ".")
        if module in NO_CHOICES:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        frozen = _names_that_numba_freezes(tree)
        for name, node in _assigned(tree):
            value = _number(node)
            if value is not None:
                yield Constant(module=module, name=name, value=value, is_compiled=name in frozen)


def _assigned(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Names in capitals that a module assigns, and what to each."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        for target in targets:
            value = node.value  # type: ignore[attr-defined]
            pairs = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=True))
            for one, held in pairs:
                if isinstance(one, ast.Name) and one.id == one.id.upper() and held is not None:
                    yield one.id, held


def _number(node: ast.expr) -> Any:
    """The value of an expression of numbers alone; None of any other."""
    if any(isinstance(part, ast.Name | ast.Call | ast.Attribute) for part in ast.walk(node)):
        return None
    value = eval(compile(ast.Expression(node), "constant", "eval"))  # only numbers and signs
    held = value if isinstance(value, tuple) else tuple(value.values()) if _is_dict(value) else None
    numbers = (value,) if held is None else held
    nested = [one for part in numbers for one in (part if isinstance(part, tuple) else (part,))]
    known = all(isinstance(one, int | float) and not isinstance(one, bool) for one in nested)
    return value if nested and known else None


def _is_dict(value: Any) -> bool:
    return isinstance(value, dict)


def _names_that_numba_freezes(tree: ast.Module) -> set[str]:
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            decorators = {
                part.id if isinstance(part, ast.Name) else part.attr
                for decorator in node.decorator_list
                for part in ast.walk(decorator)
                if isinstance(part, ast.Name | ast.Attribute)
            }
            if decorators & COMPILERS:
                names |= {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
    return names


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module with another value of one constant."""

    def __init__(self, module: str, name: str, value: Any):
        self._module, self._name, self._value = f"{PACKAGE}.{module}", name, value

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        """The module, if it is the one; then this object loads it."""
        if fullname != self._module:
            return None
        found = importlib.machinery.PathFinder.find_spec(fullname, path)
        return importlib.util.spec_from_file_location(fullname, found.origin, loader=self)

    def create_module(self, spec: Any) -> None:
        """As any module."""

    def exec_module(self, module: ModuleType) -> None:
        """Runs the source with the other value."""
        file = module.__spec__.origin
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
        for name, node in _assigned(tree):
            if name == self._name:
                _replace(tree, node, ast.parse(repr(self._value), mode="eval").body)
        exec(compile(ast.fix_missing_locations(tree), file, "exec"), module.__dict__)


def _replace(tree: ast.Module, old: ast.expr, new: ast.expr) -> None:
    for node in ast.walk(tree):
        for field, held in ast.iter_fields(node):
            if held is old:
                setattr(node, field, ast.copy_location(new, old))
            elif isinstance(held, list) and any(one is old for one in held):
                setattr(node, field, [new if one is old else one for one in held])


# --- trials: each imports what it needs after the constant was changed ------------------------


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


def trial_of(constant: Constant) -> Callable[[], Results] | None:
    """The experiment of a constant; None if there is none."""
    fits = (trial for start, trial in TRIALS.items() if constant.module.startswith(start))
    return next(fits, None)


# --- runs ------------------------------------------------------------------------------------


def digests(found: Results) -> dict[str, Any]:
    """Numbers as they are, and what stands for the bytes of each array."""
    plain: dict[str, Any] = {}
    for name, value in found.items():
        array = np.asarray(value)
        if array.ndim == 0 and array.dtype.kind in "iufb":
            plain[name] = array.item()
        else:
            text = np.ascontiguousarray(array)
            plain[name] = hashlib.sha256(text.tobytes() + str(text.shape).encode()).hexdigest()[:12]
    return plain


def run_here(trial: str, change: str | None) -> None:
    """Prints the digests of a trial, with the constant changed as the text says."""
    if change:
        module, name, value = json.loads(change)
        value = tuple(map(_as_tuple, value)) if isinstance(value, list) else value
        sys.meta_path.insert(0, Changed(module, name, value))
    warnings.simplefilter("ignore")
    print(json.dumps(digests(globals()[trial]())))


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def run(trial: str, folder: Path, constant: Constant | None = None, value: Any = None) -> Any:
    """The digests of a trial in a process of its own; a text says what went wrong."""
    command = [sys.executable, __file__, "--trial", trial]
    environment = os.environ | {"SELFTOUCH_TRIALS": str(folder), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as cache:
        if constant is not None:
            command += ["--change", json.dumps([constant.module, constant.name, value])]
            if constant.is_compiled:
                environment["NUMBA_CACHE_DIR"] = cache
        try:
            done = subprocess.run(
                command,
                env=environment,
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
                timeout=600,
            )
        except subprocess.TimeoutExpired:
            return "takes more than 600 s"
    if done.returncode:
        return done.stderr.strip().splitlines()[-1][:100]
    return json.loads(done.stdout.strip().splitlines()[-1])


def compared(before: dict[str, Any], after: Any) -> dict[str, Any]:
    """The part of a row that says what changed."""
    if isinstance(after, str):
        return {"same": False, "differ": "", "metrics": after}
    names = sorted(before.keys() | after.keys())
    differ = [name for name in names if before.get(name) != after.get(name)]
    numbers = [name for name in differ if not isinstance(before.get(name, ""), str)]
    text = "; ".join(
        f"{name} {before[name]:.4g} -> {after[name]:.4g}" for name in numbers[:3] if name in after
    )
    return {"same": not differ, "differ": f"{len(differ)} of {len(names)}", "metrics": text}


def rows(chosen: Sequence[Constant], folder: Path) -> Iterator[dict[str, Any]]:
    """Two rows for each constant that has an experiment."""
    before: dict[str, Any] = {}
    for constant in chosen:
        trial = trial_of(constant)
        if trial is None:
            continue
        name = trial.__name__
        if name not in before:
            before[name] = run(name, folder)
            if isinstance(before[name], str):
                raise SystemExit(f"the trial {name} fails as it is: {before[name]}")
        for factor in (0.5, 2.0):
            value = constant.times(factor)
            row = {"constant": str(constant), "is": constant.value, "value": value, "trial": name}
            if value == constant.value:
                yield row | {"same": True, "differ": "", "metrics": "the same number"}
            else:
                yield row | compared(before[name], run(name, folder, constant, value))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[], help="constants, modules or rooms")
    parser.add_argument("--list", action="store_true", help="only print them")
    parser.add_argument("--trial", help=argparse.SUPPRESS)
    parser.add_argument("--change", help=argparse.SUPPRESS)
    add_update_option(parser, "agent_constants")
    options = parser.parse_args()
    if options.trial:
        run_here(options.trial, options.change)
        return
    chosen = [
        constant
        for constant in constants()
        if not options.only or any(f"{constant}.".startswith(f"{start}.") for start in options.only)
    ]
    if options.list:
        for constant in chosen:
            trial = trial_of(constant)
            print(constant, constant.value, trial.__name__ if trial else "no trial", sep="\t")
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        results("agent_constants", update=options.update) as add,
    ):
        for row in rows(chosen, Path(folder)):
            add(row)
            print(*row.values(), sep="\t", flush=True)


if __name__ == "__main__":
    main()
