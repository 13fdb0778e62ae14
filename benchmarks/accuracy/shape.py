"""Accuracy of every shape metric on runs that have babbled. Run it as a script.

    python benchmarks/accuracy/shape.py runs/torus runs/cube
    python benchmarks/accuracy/shape.py runs/torus --skins lopsided noisy worn --metrics learned
    python benchmarks/accuracy/shape.py runs/torus --samples 30000 100000 --targets 100 300

Every combination is a row of the table; `revolute_reference` knows that joints turn. Seconds are of
CPU time, so that other work does not change them. At the end the rows are printed as a table:
medians and worst over the seeds of runs and networks.

Of a body in several parts the error is that of the worst skin, the numbers of holes are those of
each part, the other figures those of the worst part, and the dimension is that of the largest.

Skins are worn out after the fact, in the stored sensations; rows left null are dropped:

- `whole`: as it is;
- `lopsided`: on one half of each skin every third receptor is missing, drawn at random;
- `noisy`: every reading is wrong by 5 % (normal), and 5 % of the receptors are dead;
- `worn`: all of this;
- `patchy`: the same, and on that half two of three receptors are missing.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS, ShapeMetric
from selftouch_drake.agent.shape.recovery import RecoveredBody, recover, trusted
from selftouch_drake.evaluation.shape import kernel_truth, neighbour_agreement, shape_errors
from selftouch_drake.experience.store import Contacts, ExperienceReader
from selftouch_drake.files import load_arrays
from selftouch_drake.quotient.dimension import intrinsic_dimension
from selftouch_drake.quotient.holes import topology
from selftouch_drake.quotient.layout import curvature_corrected_mds
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.revolute import revolute_reference
from benchmarks.shared.babbled import run_at
from benchmarks.shared.results import add_update_option, results

#: Share of the receptors of one half that are missing, and whether readings are noisy.
SKINS = {
    "whole": (0.0, False),
    "lopsided": (1 / 3, False),
    "noisy": (0.0, True),
    "worn": (1 / 3, True),
    "patchy": (2 / 3, True),
}
LEARNING_METRICS = ("learned",)
SHAPE_METRICS["revolute_reference"] = ShapeMetric(revolute_reference, curvature_corrected_mds)

#: Adds a row to a table.
Add = Callable[[dict[str, object]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Touches to learn from."""

    body: str
    seed: int
    skin: str
    samples: int
    targets: int
    receptors: int

    @classmethod
    def of(cls, run: RunDirectory, *, skin: str, samples: int, targets: int) -> Case:
        """The first touches of a run, with a worn skin."""
        return cls(
            body=run.experiment.name,
            seed=run.experiment.seed,
            skin=skin,
            samples=samples,
            targets=targets,
            receptors=run.experiment.num_receptors,
        )

    @property
    def name(self) -> str:
        return "-".join(str(value) for value in dataclasses.astuple(self))


class Experience:
    """The first touches of a run, with a worn skin."""

    def __init__(self, run: RunDirectory):
        self.run = run
        self.q = ExperienceReader(run.experience).read("q")
        self.sensation = ExperienceReader(run.experience).read("sensation")
        self.contacts = Contacts.joined(list(ExperienceReader(run.truth).contacts()))
        world = stages.make_world(run)
        self.fields, self.receptor_skin = [s.fields for s in world.skins], world.receptor_skin

    def felt(self, case: Case) -> tuple[np.ndarray, np.ndarray, Contacts]:
        """Sensations, motor configurations and true contacts of rows that are not null."""
        rows = slice(case.samples)
        sensation = self.sensation[rows]
        share, noisy = SKINS[case.skin]
        rng = np.random.default_rng(case.seed)
        if share:
            sensation = sensation[:, ~self._missing(share, rng)]
        if noisy:
            error = rng.standard_normal(sensation.shape, dtype=np.float32)
            sensation = np.maximum(sensation * (1.0 + np.float32(0.05) * error), 0.0)
            dead = rng.choice(sensation.shape[1], round(0.05 * sensation.shape[1]), replace=False)
            sensation[:, dead] = 0.0
        touching = np.flatnonzero(sensation.any(axis=1))
        return sensation[touching], self.q[touching], self.contacts[touching]

    def _missing(self, share: float, rng: np.random.Generator) -> np.ndarray:
        """Missing receptors: a share of those on one half of each skin."""
        arrays = load_arrays(self.run.skin)
        missing = np.zeros(self.run.experiment.num_receptors, dtype=bool)
        for number, name in enumerate(self.run.experiment.skins):
            side = arrays[f"{name}_p_LS"][:, 0]
            here = np.flatnonzero(arrays["receptor_skin"] == number)
            half = here[side > np.median(side)]
            missing[rng.choice(half, int(share * len(half)), replace=False)] = True
        return missing


def learned_representation(
    case: Case, sensation: np.ndarray, q: np.ndarray
) -> tuple[QuotientRepresentation, float]:
    """What is learned from these touches, and the CPU seconds that it takes."""
    began = time.process_time()
    learner = QuotientLearner(case.targets, random_state=case.seed)
    learned = learner.fit(sensation, q).representation_
    return learned, time.process_time() - began


def score(body: RecoveredBody, seconds: float) -> dict[str, object]:
    """Results of the agent, without the truth."""
    found = [topology(part.places) for part in body.parts]
    (largest, *_), layouts = body.parts, [part.embedding for part in body.parts]
    return {
        "betti": ", ".join(" ".join(map(str, one.betti)) for one in found),
        "margin": round(min(one.margin for one in found), 2),
        "dimension": round(intrinsic_dimension(largest.distances, largest.skin_dimension), 2),
        "fourth_eigenvalue": round(max(layout.fourth_eigenvalue for layout in layouts), 4),
        "stress": round(max(layout.stress for layout in layouts), 5),
        "metric_cpu_s": round(seconds, 1),
    }


def rows(
    experience: Experience, case: Case, metrics: list[tuple[str, int]]
) -> Iterator[dict[str, object]]:
    """The rows of one case, one per metric and network seed."""
    sensation, q, contacts = experience.felt(case)
    representation, seconds = learned_representation(case, sensation, q)
    contacts = contacts[representation.kernel_row]
    truth = kernel_truth(representation, contacts, experience.receptor_skin)
    on_surface = truth.on_surface(experience.fields)
    common = {
        "rows": len(q),
        "spread_median_m": round(float(np.median(truth.spread)), 4),
        "spread_worst_m": round(float(truth.spread.max()), 4),
        "agreement": round(neighbour_agreement(representation.set_distance, truth.positions), 4),
        "learn_cpu_s": round(seconds, 1),
    }
    for metric, network_seed in metrics:
        began = time.process_time()
        body = recover(representation, metric, seed=network_seed, holes=False)
        figures = score(body, time.process_time() - began)
        errors, from_surface = (
            shape_errors(body.positions, representation.part, where)
            for where in (truth, on_surface)
        )
        yield {
            **dataclasses.asdict(case),
            "metric": metric,
            "network_seed": network_seed,
            "error": round(max(errors.values()), 4),
            "surface_error": round(max(from_surface.values()), 4),
            **figures,
            **common,
            "expected_error": np.nan if body.expected_error is None else body.expected_error,
            "trusted": trusted(body.expected_error, float(str(figures["margin"]))),
        }


def measure(
    run: RunDirectory, cases: list[Case], wanted: list[tuple[str, int]], add: Add
) -> list[dict[str, str]]:
    """Adds a row for each of a run's cases, metrics and network seeds; returns them as text."""
    experience, found = Experience(run), []
    for case in cases:
        for row in rows(experience, case, wanted):
            add(row)
            found.append({name: str(value) for name, value in row.items()})
            figures = ("body", "seed", "skin", "metric", "network_seed", "error", "betti")
            print(*(row[name] for name in figures), file=sys.stderr, flush=True)
    return found


def read(path: Path) -> list[dict[str, str]]:
    """The rows of a table."""
    with path.open() as file:
        return list(csv.DictReader(file))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "runs", nargs="+", type=Path, help="a missing one, such as torus_951, is babbled"
    )
    parser.add_argument("--metrics", nargs="+", choices=SHAPE_METRICS, default=list(SHAPE_METRICS))
    parser.add_argument("--skins", nargs="+", choices=SKINS, default=["whole"])
    parser.add_argument("--samples", nargs="+", type=int, default=[1_000_000])
    parser.add_argument("--targets", nargs="+", type=int, default=[1000])
    parser.add_argument("--network-seeds", nargs="+", type=int, default=[0])
    add_update_option(parser, "shape")
    arguments = parser.parse_args()

    wanted = [
        (metric, seed)
        for metric in arguments.metrics
        for seed in (arguments.network_seeds if metric in LEARNING_METRICS else [0])
    ]
    found = []
    with results("shape", update=arguments.update) as add:
        for path in arguments.runs:
            run = run_at(path, max(arguments.samples))
            grid = itertools.product(arguments.skins, arguments.samples, arguments.targets)
            cases = [
                Case.of(run, skin=skin, samples=samples, targets=targets)
                for skin, samples, targets in grid
            ]
            found += measure(run, cases, wanted, add)
    print(summary(found))


def summary(rows: list[dict[str, str]]) -> str:
    """The table as Markdown: a line for each body, skin, size and metric."""
    columns = ("body", "skin", "samples", "targets", "receptors", "metric")
    groups: dict[tuple[str, ...], list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in columns), []).append(row)
    header = (
        *columns,
        "times",
        "error, median / worst",
        "from the surface",
        "Betti numbers",
        "least margin",
        "dimension",
        "4th eigenvalue",
        "CPU s",
    )
    lines = [" | ".join(header), "|".join(["---"] * len(header))]
    for group, found in sorted(groups.items()):
        figure = {
            name: np.array([float(row[name]) for row in found])
            for name in (
                *("error", "surface_error", "margin"),
                *("dimension", "fourth_eigenvalue", "metric_cpu_s"),
            )
        }
        cells = (
            *group,
            str(len(found)),
            *(
                f"{np.median(figure[name]):.1%} / {figure[name].max():.1%}"
                for name in ("error", "surface_error")
            ),
            "; ".join(sorted({row["betti"] for row in found})),
            f"{figure['margin'].min():.1f}",
            f"{figure['dimension'].min():.2f} to {figure['dimension'].max():.2f}",
            f"{figure['fourth_eigenvalue'].max():.0%}",
            f"{np.median(figure['metric_cpu_s']):.0f}",
        )
        lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


if __name__ == "__main__":
    main()
