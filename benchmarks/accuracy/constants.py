"""What depends on the tuned constants of the paper's room: each is halved and doubled.

    python benchmarks/accuracy/constants.py runs/cube_1 runs/turning_body_5
    python benchmarks/accuracy/constants.py runs/cube_1 --only links route._APART

A run that is missing is made, of the body and seed of its name. `quotient.learn`, `recover` and
`plan` run on its first touches, as they are and with one constant changed; only what comes after
the constant is done again. A row of the table is one value of one constant on one run:

- `shape`: % of the body's extent, error of the layout against the true places of the kernels;
- `holes`, `margin`, `dimension`, `skin`, `space`: what `recover` finds;
- `near`: share of the nearest kernels by set distance that are truly near;
- `contact`, `worst`: % of the path of plans that touches, on average and in the worst one;
- `moved`: mu, median length of the plans; `jerk`: of their paths, over that of the first row;
- `same`: whether everything that was found has the same bytes as with the constant as it is.

Constants that numba compiles are changed before it does, in a process and a cache of their own.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from selftouch_drake import quotient
from selftouch_drake.evaluation.shape import neighbour_agreement, shape_rms_fraction
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.quotient import MotorPath, PlanningGraph, Representation, Shape
from selftouch_drake.quotient.learn import learn
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import make_world

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import run_at
from benchmarks.shared.results import add_update_option, results

#: The constants, by the first stage that they act in. Sizes of blocks of work change no result.
CONSTANTS = {
    "learn": (
        *("learn.MAX_ROWS", "sensations._LLOYD", "sensations._SAME", "sensations._LEAST_ALIKE"),
        *("distances.MAX_QUERIES", "distances._FEW_QUERIES"),
        *("scale._SPREAD", "scale._LEAST_INFLUENCE"),
        *("graph.NUM_MUTUAL", "graph.NUM_KEPT"),
    ),
    "recover": (
        *("layout._LEAST_LOWERED", "layout._LEAST_LOWERED_WITH_RIMS", "layout._UNBENDING"),
        *("dimension._NEAR", "dimension._FAR", "dimension._LINE", "dimension._THIN"),
        *("dimension._FLAT", "dimension.MISFIT", "dimension._LACKING", "dimension._SHARES"),
        *("dimension._LEAST_NEIGHBOURS", "dimension._LEAST_GROWTH", "dimension.LEAST_KERNELS"),
        *("holes._UNSURE", "holes._MOST_MARGIN", "holes._LATE", "holes._NEIGHBOURS"),
    ),
    "plan": (
        *("sensations._SPACING_NEIGHBOUR", "links.LINK_SPACINGS", "links._MOST_APART"),
        *("links._LEAP_SPACINGS", "links._LEAP_POWER"),
        *("route.POWER", "route._MAX_VISITS", "route._APART"),
        *("firm._ISOLATED", "smooth.KNOT_SPACING", "smooth._SAMPLES_PER_INTERVAL"),
    ),
}
STAGES = tuple(CONSTANTS)
#: Those that numba freezes when it compiles.
COMPILED = {"route._MAX_VISITS", "route._APART", "firm._ISOLATED"}
#: Shares that only have a meaning below 1: the distance from 1 is halved and doubled.
BELOW_ONE = {"layout._LEAST_LOWERED_WITH_RIMS"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What the paper's room makes of the touches of a run."""

    representation: Representation
    shape: Shape
    plans: list[MotorPath]


class Touches:
    """The first touches of a run, and the truth about them."""

    def __init__(self, run: RunDirectory, num_touches: int, num_targets: int, num_pairs: int):
        self.name = run.path.name
        reader = ExperienceReader(run.experience)
        self.q, self.sensation = reader.read("q")[:num_touches], reader.read("sensation")
        self.sensation = self.sensation[:num_touches]
        self.truth = ExperienceReader(run.truth)
        self.world = make_world(run)
        self.num_targets = num_targets
        rng = np.random.default_rng(0)
        self.pairs = [rng.choice(num_targets, 2, replace=False).tolist() for _ in range(num_pairs)]

    def found(self, before: Found | None = None, stage: str = "learn") -> Found:
        """Learns, recovers and plans; what comes before the stage is taken from `before`."""
        if before is None or stage == "learn":
            known = learn(self.q, self.sensation, num_targets=self.num_targets)
        else:
            known = before.representation
        shape = before.shape if before and stage == "plan" else quotient.recover(known)
        if before and stage == "recover":
            return Found(representation=known, shape=shape, plans=before.plans)
        planning_graph = PlanningGraph.of(known)
        plans = [quotient.plan(known, *pair, planning_graph=planning_graph) for pair in self.pairs]
        return Found(representation=known, shape=shape, plans=plans)

    def scores(self, found: Found) -> dict[str, Any]:
        """A row of the table."""
        known, shape = found.representation, found.shape
        true = self._true_places(known)
        contact = [self._contact(plan) for plan in found.plans]
        jerks = [_jerk(plan, known.joint_scale) for plan in found.plans]
        holes = shape.topology
        return {
            "shape": round(100 * shape_rms_fraction(shape.positions, true), 2),
            "holes": "" if holes is None else "".join(map(str, holes.betti)),
            "margin": 0.0 if holes is None else round(holes.margin, 2),
            "dimension": round(shape.dimension or 0.0, 2),
            "skin": shape.skin_dimension,
            "space": shape.space_dimension,
            "near": round(neighbour_agreement(known.set_distance, true), 3),
            "contact": round(100 * float(np.mean(contact)), 2),
            "worst": round(100 * min(contact), 1),
            "moved": round(float(np.median([plan.waypoint_s[-1] for plan in found.plans])), 2),
            "jerk": round(float(np.median(jerks)), 1),
        }

    def _true_places(self, known: Representation) -> np.ndarray:
        """`(K, 3)` m, the median of the true contacts of each kernel."""
        contacts = self.truth.take_contacts(known.kernel_row)
        kernel = known.kernel_sets.kernel[contacts.row]
        return np.array(
            [np.median(contacts.p_LC[kernel == k], axis=0) for k in range(known.num_targets)]
        )

    def _contact(self, plan: MotorPath) -> float:
        """Share of the path of a plan that touches."""
        length = plan.waypoint_s[-1]
        q = plan.path(np.linspace(0.0, length, max(2, int(length / 0.03))))
        return float(np.mean(self.world.probe.sensations(q).any(axis=1)))


def _jerk(plan: MotorPath, joint_scale: np.ndarray) -> float:
    """Root mean square of the third derivative of a path, by its own length."""
    s = np.linspace(0.0, plan.waypoint_s[-1], 1000)
    return float(np.sqrt(np.mean(np.square(plan.path(s, 3) * joint_scale))))


def same(one: Found, other: Found) -> bool:
    """Whether two findings have the same bytes."""
    return all(
        np.array_equal(here, there, equal_nan=True)
        for here, there in zip(_arrays(one), _arrays(other), strict=True)
    )


def _arrays(found: Found) -> list[np.ndarray]:
    known, shape, holes = found.representation, found.shape, found.shape.topology
    arrays = [known.target_sensations, known.kernel_row, known.joint_scale, known.set_distance]
    arrays += [known.edges, known.edge_cost, shape.positions, np.array(shape.space_dimension)]
    arrays += [np.array([shape.dimension or np.nan])]
    arrays += [np.array([*holes.betti, holes.margin]) if holes else np.zeros(0)]
    return arrays + [array for plan in found.plans for array in (plan.nodes, plan.path.c)]


def modules() -> list[ModuleType]:
    """The modules of the paper's room."""
    names = [found.name for found in pkgutil.iter_modules(quotient.__path__)]
    return [importlib.import_module(f"{quotient.__name__}.{name}") for name in names]


@contextmanager
def changed(constant: str, value: Any) -> Iterator[None]:
    """The constant has another value, wherever it was imported and in default arguments."""
    _, name = constant.split(".")
    old = value_of(constant)
    holders = [module for module in modules() if vars(module).get(name, None) is old]
    functions = [
        held
        for module in modules()
        for held in vars(module).values()
        if callable(held) and getattr(held, "__module__", None) == module.__name__
    ]

    def put(this: Any, instead_of: Any) -> None:
        for module in holders:
            setattr(module, name, this)
        for function in functions:
            _put_default(function, name.lower(), this, instead_of)
            if hasattr(function, "cache_clear"):
                function.cache_clear()

    put(value, old)
    try:
        yield
    finally:
        put(old, value)


def _put_default(function: Any, argument: str, value: Any, old: Any) -> None:
    """The default of an argument becomes the value, if it is the old one."""
    by_name = getattr(function, "__kwdefaults__", None) or {}
    if by_name.get(argument) is old:
        by_name[argument] = value
    by_place = getattr(function, "__defaults__", None) or ()
    if by_place and isinstance(function, FunctionType):
        code = function.__code__
        names = code.co_varnames[: code.co_argcount][-len(by_place) :]
        function.__defaults__ = tuple(
            value if name == argument and default is old else default
            for name, default in zip(names, by_place, strict=True)
        )


def value_of(constant: str) -> Any:
    """The value of a constant such as `links._LEAP_POWER`."""
    module, name = constant.split(".")
    return getattr(importlib.import_module(f"{quotient.__name__}.{module}"), name)


def values(constant: str) -> list[Any]:
    """Half and twice the value; whole numbers stay whole."""
    return [_times(value_of(constant), factor, constant in BELOW_ONE) for factor in (0.5, 2.0)]


def _times(value: Any, factor: float, below_one: bool) -> Any:
    if isinstance(value, tuple):
        return tuple(_times(one, factor, below_one) for one in value)
    if isinstance(value, dict):
        return {key: _times(one, factor, below_one) for key, one in value.items()}
    if below_one:
        return 1.0 - factor * (1.0 - value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def rows(
    touches: Touches, constants: Sequence[tuple[str, str]], compiled: bool = False
) -> Iterator[dict[str, Any]]:
    """A row for the constants as they are, then two for each of `(stage, constant)`."""
    before = touches.found()
    first = touches.scores(before)
    if not compiled:
        yield {"run": touches.name, "constant": "", "value": "", **first, "same": True}
    for stage, constant in constants:
        for value in values(constant):
            row = {"run": touches.name, "constant": constant, "value": str(value)}
            try:
                with changed(constant, value):
                    after = touches.found(before, stage)
            except (ValueError, IndexError) as error:
                yield row | dict.fromkeys(first, "") | {"holes": str(error)[:60], "same": False}
                continue
            yield row | touches.scores(after) | {"same": same(before, after)}


def compiled_rows(path: Path, options: argparse.Namespace, constant: str) -> Iterator[list[str]]:
    """The two rows of a constant that numba compiles, each from a process of its own."""
    for number in (0, 1):
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, __file__, str(path), "--only", constant]
            command += ["--touches", str(options.touches), "--targets", str(options.targets)]
            command += ["--pairs", str(options.pairs), "--compiled", str(number)]
            environment = os.environ | {"NUMBA_CACHE_DIR": cache}
            done = subprocess.run(
                command, env=environment, check=True, capture_output=True, text=True
            )
        yield done.stdout.strip().splitlines()[-1].split("\t")


def compiled_row(touches: Touches, constant: str, number: int) -> dict[str, Any]:
    """One row, in a process that compiles anew; it cannot tell whether findings are the same."""
    value = values(constant)[number]
    with changed(constant, value):
        scores = touches.scores(touches.found())
    return {"run": touches.name, "constant": constant, "value": str(value), **scores, "same": "?"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--only", nargs="+", default=[], help="constants, modules or stages")
    parser.add_argument("--touches", type=int, default=30_000)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--pairs", type=int, default=40)
    add_update_option(parser, "constants")
    parser.add_argument("--compiled", type=int, choices=(0, 1), help=argparse.SUPPRESS)
    options = parser.parse_args()

    chosen = [
        (stage, constant)
        for stage in STAGES
        for constant in CONSTANTS[stage]
        if not options.only or {stage, constant, constant.partition(".")[0]} & set(options.only)
    ]
    sizes = options.touches, options.targets, options.pairs
    if options.compiled is not None:
        touches = Touches(run_at(options.runs[0], options.touches), *sizes)
        row = compiled_row(touches, chosen[0][1], options.compiled)
        print(*row.values(), sep="\t")
        return
    with results("constants", update=options.update) as add:
        for path in options.runs:
            touches = Touches(run_at(path, options.touches), *sizes)
            names: list[str] = []
            for row in rows(touches, [one for one in chosen if one[1] not in COMPILED]):
                names = list(row)
                add(row)
                print(*row.values(), sep="\t", flush=True)
            for _, constant in chosen:
                if constant in COMPILED:
                    for found in compiled_rows(path, options, constant):
                        add(dict(zip(names, found, strict=True)))
                        print(*found, sep="\t", flush=True)


if __name__ == "__main__":
    main()
