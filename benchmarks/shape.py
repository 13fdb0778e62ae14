"""Accuracy of every shape metric on runs that have babbled. Run it as a script.

    python benchmarks/shape.py runs/torus runs/cube --out docs/data/shape.csv
    python benchmarks/shape.py runs/torus --skins lopsided noisy worn --metrics learned
    python benchmarks/shape.py runs/torus --samples 30000 100000 --targets 100 300

    python benchmarks/shape.py --out docs/data/shape.csv

Every combination is a row of the CSV file. Rows that it holds already are not computed again, so
that a long table can be stopped and resumed. What was learned is kept in `--cache`. Seconds are of
CPU time, so that other work does not change them. At the end all rows of the file are printed as a
table: medians and worst over the seeds of runs and networks.

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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from selftouch_drake.agent.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import MAX_QUERIES
from selftouch_drake.agent.shape import SHAPE_METRICS, Body, intrinsic_dimension, recover, topology
from selftouch_drake.agent.shape.confidence import trusted
from selftouch_drake.evaluation import kernel_truth, neighbour_agreement, shape_errors
from selftouch_drake.experience import Contacts, ExperienceReader
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory

#: Share of the receptors of one half that are missing, and whether readings are noisy.
SKINS = {
    "whole": (0.0, False),
    "lopsided": (1 / 3, False),
    "noisy": (0.0, True),
    "worn": (1 / 3, True),
    "patchy": (2 / 3, True),
}
LEARNING_METRICS = ("learned",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Touches to learn from."""

    body: str
    seed: int
    skin: str
    samples: int
    targets: int
    receptors: int
    queries: int

    @classmethod
    def of(
        cls, run: RunDirectory, *, skin: str, samples: int, targets: int, queries: int = MAX_QUERIES
    ) -> Case:
        """The first touches of a run, with a worn skin."""
        return cls(
            body=run.experiment.name,
            seed=run.experiment.seed,
            skin=skin,
            samples=samples,
            targets=targets,
            receptors=run.experiment.num_receptors,
            queries=queries,
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
        self.fields = [skin.fields for skin in stages.make_world(run).skins]

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
    case: Case, sensation: np.ndarray, q: np.ndarray, cache: Path
) -> tuple[QuotientRepresentation, float]:
    """Learns, or loads an earlier result; also returns the CPU seconds."""
    path, clock = cache / f"{case.name}.npz", cache / f"{case.name}.txt"
    if not clock.exists():
        began = time.process_time()
        learner = QuotientLearner(
            case.targets, max_queries=case.queries, random_state=case.seed
        ).fit(sensation, q)
        seconds = time.process_time() - began
        cache.mkdir(parents=True, exist_ok=True)
        save_arrays(path, learner.representation_.to_arrays())
        clock.write_text(f"{seconds:.1f}")
    return QuotientRepresentation.from_arrays(load_arrays(path)), float(clock.read_text())


def score(body: Body, seconds: float) -> dict[str, object]:
    """Results of the agent, without the truth."""
    found = [topology(part.places) for part in body.parts]
    (largest, *_), layouts = body.parts, [part.embedding for part in body.parts]
    return {
        "betti": ", ".join(" ".join(map(str, one.betti)) for one in found),
        "margin": round(min(one.margin for one in found), 2),
        "dimension": round(intrinsic_dimension(largest.distances), 2),
        "fourth_eigenvalue": round(max(layout.fourth_eigenvalue for layout in layouts), 4),
        "stress": round(max(layout.stress for layout in layouts), 5),
        "metric_cpu_s": round(seconds, 1),
    }


def rows(
    experience: Experience, case: Case, metrics: list[tuple[str, int]], cache: Path
) -> Iterator[dict[str, object]]:
    """The rows of one case, one per metric and network seed."""
    sensation, q, contacts = experience.felt(case)
    representation, seconds = learned_representation(case, sensation, q, cache)
    truth = kernel_truth(representation, contacts[representation.kernel_row])
    on_surface = truth.on_surface(experience.fields)
    common = {
        "rows": len(q),
        "spread_median_m": round(float(np.median(truth.spread)), 4),
        "spread_worst_m": round(float(truth.spread.max()), 4),
        "agreement": round(neighbour_agreement(representation.set_distance, truth.positions), 4),
        "learn_cpu_s": seconds,
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
            "expected_error": body.expected_error,
            "trusted": trusted(body.expected_error, float(str(figures["margin"]))),
        }


def measure(
    run: RunDirectory, cases: list[Case], wanted: list[tuple[str, int]], out: Path, cache: Path
) -> None:
    """Adds missing rows of a run's cases, by metrics and network seeds, to a file."""
    done = {_key(row) for row in read(out)}
    experience = None
    for case in cases:
        missing = [
            (metric, seed)
            for metric, seed in wanted
            if _key({**dataclasses.asdict(case), "metric": metric, "network_seed": seed})
            not in done
        ]
        if not missing:
            continue
        experience = experience or Experience(run)
        for row in rows(experience, case, missing, cache):
            _append(out, row)
            figures = ("body", "seed", "skin", "metric", "network_seed", "error", "betti")
            print(*(row[name] for name in figures), file=sys.stderr, flush=True)


def read(path: Path) -> list[dict[str, str]]:
    """The rows of a table; none if it does not exist yet."""
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.DictReader(file))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="*", type=Path, help="that have babbled")
    parser.add_argument("--out", type=Path, default=Path("shape.csv"), help="where rows are added")
    parser.add_argument("--cache", type=Path, default=Path("shape-cache"))
    parser.add_argument("--metrics", nargs="+", choices=SHAPE_METRICS, default=list(SHAPE_METRICS))
    parser.add_argument("--skins", nargs="+", choices=SKINS, default=["whole"])
    parser.add_argument("--samples", nargs="+", type=int, default=[1_000_000])
    parser.add_argument("--targets", nargs="+", type=int, default=[1000])
    parser.add_argument("--queries", type=int, default=MAX_QUERIES, help="of set distances")
    parser.add_argument("--network-seeds", nargs="+", type=int, default=[0])
    arguments = parser.parse_args()

    wanted = [
        (metric, seed)
        for metric in arguments.metrics
        for seed in (arguments.network_seeds if metric in LEARNING_METRICS else [0])
    ]
    for path in arguments.runs:
        run = RunDirectory.open(path)
        grid = itertools.product(arguments.skins, arguments.samples, arguments.targets)
        cases = [
            Case.of(run, skin=skin, samples=samples, targets=targets, queries=arguments.queries)
            for skin, samples, targets in grid
        ]
        measure(run, cases, wanted, arguments.out, arguments.cache)
    if arguments.out.exists():
        print(summary(arguments.out))


def summary(path: Path) -> str:
    """The table as Markdown: a line for each body, skin, size and metric."""
    columns = ("body", "skin", "samples", "targets", "receptors", "metric")
    groups: dict[tuple[str, ...], list[dict[str, str]]] = {}
    for row in read(path):
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


def _key(row: dict) -> tuple[str, ...]:
    names = [field.name for field in dataclasses.fields(Case)] + ["metric", "network_seed"]
    return tuple(str(row[name]) for name in names)


def _append(path: Path, row: dict[str, object]) -> None:
    """Adds a row, without columns that the table lacks."""
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = list(read(path)[0]) if read(path) else list(row)
    begins = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=columns, extrasaction="ignore")
        if begins:
            writer.writeheader()
        writer.writerow(row)


if __name__ == "__main__":
    main()
