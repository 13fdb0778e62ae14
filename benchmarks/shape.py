"""How well every metric recovers the body of runs that have babbled. Run it as a script.

    python benchmarks/shape.py runs/torus runs/cube --out docs/data/shape.csv
    python benchmarks/shape.py runs/torus --skins lopsided noisy worn --metrics learned
    python benchmarks/shape.py runs/torus --samples 30000 100000 --targets 100 300

    python benchmarks/shape.py --out docs/data/shape.csv

Every combination is a row of the CSV file. Rows that it holds already are not computed again, so
that a long table can be stopped and resumed. What was learned is kept in `--cache`. Seconds are of
CPU time, so that other work does not change them. At the end all rows of the file are printed as a
table: medians and worst over the seeds of runs and networks.

Skins are worn out after the fact, in the stored sensations; rows left null are dropped:

- `whole`: as it is;
- `lopsided`: on one half of the body every third receptor is missing, drawn at random;
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
from selftouch_drake.agent.shape import METRICS, intrinsic_dimension, recover, topology
from selftouch_drake.evaluation import (
    kernel_positions,
    kernel_spread,
    neighbour_agreement,
    shape_rms_fraction,
)
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.files import load_arrays
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
    """What is learned from."""

    body: str
    seed: int
    skin: str
    samples: int
    targets: int
    receptors: int
    queries: int

    @property
    def name(self) -> str:
        return "-".join(str(value) for value in dataclasses.astuple(self))


class Experience:
    """The first touches of a run, felt through a skin of some wear."""

    def __init__(self, run: RunDirectory):
        self.run = run
        self.q = ExperienceReader(run.experience).read("q")
        self.sensation = ExperienceReader(run.experience).read("sensation")
        self.p_WF = ExperienceReader(run.truth).read("p_WF")

    def felt(self, case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sensations, motor configurations and true positions, of rows that are not null."""
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
        touching = sensation.any(axis=1)
        return sensation[touching], self.q[rows][touching], self.p_WF[rows][touching]

    def _missing(self, share: float, rng: np.random.Generator) -> np.ndarray:
        """Which receptors are missing: a share of those on one half of the body."""
        side = load_arrays(self.run.skin)["p_BS"][:, 0]
        half = np.flatnonzero(side > np.median(side))
        missing = np.zeros(len(side), dtype=bool)
        missing[rng.choice(half, int(share * len(half)), replace=False)] = True
        return missing


def learned_representation(
    case: Case, sensation: np.ndarray, q: np.ndarray, cache: Path
) -> tuple[QuotientRepresentation, float]:
    """Learns, or takes what was learned before, and tells the CPU seconds it took."""
    path, clock = cache / f"{case.name}.npz", cache / f"{case.name}.txt"
    if not clock.exists():
        began = time.process_time()
        learner = QuotientLearner(
            case.targets, max_queries=case.queries, random_state=case.seed
        ).fit(sensation, q)
        seconds = time.process_time() - began
        cache.mkdir(parents=True, exist_ok=True)
        learner.representation_.save(path)
        clock.write_text(f"{seconds:.1f}")
    return QuotientRepresentation.load(path), float(clock.read_text())


def score(representation: QuotientRepresentation, metric: str, seed: int) -> dict[str, object]:
    """Recovers the body; the truth is not needed yet."""
    began = time.process_time()
    body = recover(representation, metric, seed=seed)
    seconds = time.process_time() - began
    found = topology(body.places)
    return {
        "positions": body.embedding.positions,
        "betti": " ".join(map(str, found.betti)),
        "margin": round(found.margin, 2),
        "dimension": round(intrinsic_dimension(body.distances), 2),
        "fourth_eigenvalue": round(float(body.embedding.spectrum[3]), 4),
        "stress": round(body.embedding.stress, 5),
        "metric_cpu_s": round(seconds, 1),
    }


def rows(
    experience: Experience, case: Case, metrics: list[tuple[str, int]], cache: Path
) -> Iterator[dict[str, object]]:
    """The rows of one case, a metric and network seed each."""
    sensation, q, p_WF = experience.felt(case)
    representation, seconds = learned_representation(case, sensation, q, cache)
    kernel_p_WF = p_WF[representation.kernel_row]
    positions = kernel_positions(representation, kernel_p_WF)
    spread = kernel_spread(representation, kernel_p_WF)
    common = {
        "rows": len(q),
        "spread_median_m": round(float(np.median(spread)), 4),
        "spread_worst_m": round(float(spread.max()), 4),
        "agreement": round(neighbour_agreement(representation.set_distance, positions), 4),
        "learn_cpu_s": seconds,
    }
    for metric, network_seed in metrics:
        figures = score(representation, metric, network_seed)
        error = shape_rms_fraction(figures.pop("positions"), positions)
        yield {
            **dataclasses.asdict(case),
            "metric": metric,
            "network_seed": network_seed,
            "error": round(error, 4),
            **figures,
            **common,
        }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--out", type=Path, default=Path("shape.csv"))
    parser.add_argument("--cache", type=Path, default=Path("shape-cache"))
    parser.add_argument("--metrics", nargs="+", choices=METRICS, default=list(METRICS))
    parser.add_argument("--skins", nargs="+", choices=SKINS, default=["whole"])
    parser.add_argument("--samples", nargs="+", type=int, default=[1_000_000])
    parser.add_argument("--targets", nargs="+", type=int, default=[1000])
    parser.add_argument("--queries", type=int, default=MAX_QUERIES, help="of set distances")
    parser.add_argument("--network-seeds", nargs="+", type=int, default=[0])
    arguments = parser.parse_args()

    done = set()
    if arguments.out.exists():
        with arguments.out.open() as file:
            done = {_key(row) for row in csv.DictReader(file)}
    for path in arguments.runs:
        run, experience = RunDirectory.open(path), None
        grid = itertools.product(arguments.skins, arguments.samples, arguments.targets)
        for skin, samples, targets in grid:
            case = Case(
                body=run.experiment.name,
                seed=run.experiment.seed,
                skin=skin,
                samples=samples,
                targets=targets,
                receptors=run.experiment.skin.num_receptors,
                queries=arguments.queries,
            )
            wanted = [
                (metric, seed)
                for metric in arguments.metrics
                for seed in (arguments.network_seeds if metric in LEARNING_METRICS else [0])
            ]
            missing = [
                (metric, seed)
                for metric, seed in wanted
                if _key({**dataclasses.asdict(case), "metric": metric, "network_seed": seed})
                not in done
            ]
            if not missing:
                continue
            experience = experience or Experience(run)
            for row in rows(experience, case, missing, arguments.cache):
                _append(arguments.out, row)
                figures = ("body", "seed", "skin", "metric", "network_seed", "error", "betti")
                print(*(row[name] for name in figures), file=sys.stderr, flush=True)
    if arguments.out.exists():
        print(summary(arguments.out))


def summary(path: Path) -> str:
    """The table as Markdown: a line for each body, skin, size and metric."""
    columns = ("body", "skin", "samples", "targets", "receptors", "metric")
    groups: dict[tuple[str, ...], list[dict[str, str]]] = {}
    with path.open() as file:
        for row in csv.DictReader(file):
            groups.setdefault(tuple(row[name] for name in columns), []).append(row)
    header = (
        *columns,
        "times",
        "error, median / worst",
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
            for name in ("error", "margin", "dimension", "fourth_eigenvalue", "metric_cpu_s")
        }
        cells = (
            *group,
            str(len(found)),
            f"{np.median(figure['error']):.1%} / {figure['error'].max():.1%}",
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
    path.parent.mkdir(parents=True, exist_ok=True)
    begins = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(row))
        if begins:
            writer.writeheader()
        writer.writerow(row)


if __name__ == "__main__":
    main()
