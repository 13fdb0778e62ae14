"""Cost of learning: set distances compared with scipy, all of `learn`, and their growth.

Run: `python benchmarks/learning.py RUN`, on a run that has learned 1000 targets from a million
touches. It reads the run and leaves it as it is. Times are of the processor, not of the clock, so
that a machine with other work gives nearly the same; the clock stands beside them.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from memory import peak_memory_mb
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation import QuotientLearner, QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import _NOT_TOLD, _nearest_squared
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_representation
from selftouch_drake.run.directory import RunDirectory

# Where one thing grows, the others stay at these.
NUM_ROWS, NUM_TARGETS, KERNEL_SIZE = 300_000, 300, 300


def measure_peers(representation: QuotientRepresentation, num_sets: int, turns: int) -> list[dict]:
    """Nearest distances between a part of all sets, by each way, on one core.

    The ways take turns; each has float32 or float64 as it likes best, trees included.
    """
    chosen = np.random.default_rng(0).choice(representation.num_targets, num_sets, replace=False)
    sets = [
        representation.scaled(representation.kernel_q[representation.members(k)]).astype(np.float32)
        for k in chosen
    ]
    doubles = [np.asarray(members, dtype=float) for members in sets]
    members, offsets = np.concatenate(sets), np.cumsum([0, *map(len, sets)])
    nearest_squared = _nearest_squared(members.shape[1], False)

    def here() -> list[np.ndarray]:
        tables = [np.empty((num_sets, len(a)), dtype=np.float32) for a in sets]
        for a, table in zip(sets, tables, strict=True):
            nearest_squared(
                np.ascontiguousarray(a.T), members, offsets[:-1], offsets[1:], table, _NOT_TOLD
            )
        return [np.sqrt(table) for table in tables]

    def tree() -> list[np.ndarray]:
        trees = [cKDTree(b) for b in doubles]
        return [np.array([tree.query(a)[0] for tree in trees]) for a in doubles]

    def distances() -> list[np.ndarray]:
        return [np.sqrt([cdist(a, b, "sqeuclidean").min(axis=1) for b in doubles]) for a in doubles]

    ways: dict[str, Callable[[], list[np.ndarray]]]
    ways = {"selftouch_drake": here, "scipy cKDTree": tree, "scipy cdist": distances}
    here()  # compiled now
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    found = {}
    for _ in range(turns):
        for name, way in ways.items():
            began = time.thread_time()
            found[name] = way()
            seconds[name].append(time.thread_time() - began)
    num_pairs = float(len(members)) ** 2
    nanoseconds = {name: 1e9 * statistics.median(s) / num_pairs for name, s in seconds.items()}
    return [
        {
            "way": name,
            "ns_per_pair": cost,
            "times_here": cost / nanoseconds["selftouch_drake"],
            "all_pairs_2_cores_s": cost * 1e-9 * 1e12 / 2,
            "largest_difference_rad": max(
                float(np.abs(a - b).max())
                for a, b in zip(found[name], found["scipy cdist"], strict=True)
            ),
        }
        for name, cost in nanoseconds.items()
    ]


def fit(run: Path, num_rows: int, num_targets: int, kernel_size: int) -> QuotientLearner:
    """Learns from the first rows of a run; at its end the shards repeat."""
    reader = ExperienceReader(run / "experience")

    def batches() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        left = num_rows
        for sensation, q in itertools.chain.from_iterable(
            reader.touches() for _ in itertools.count()
        ):
            yield sensation[:left], q[:left]
            left -= len(q[:left])
            if left == 0:
                return

    return QuotientLearner(num_targets, kernel_size).fit_batches(batches)


def learn(run: Path) -> None:
    """All of `selftouch learn`, on a copy that shares the shards."""
    with tempfile.TemporaryDirectory(dir=run.parent) as folder:
        copy = shutil.copytree(run, Path(folder) / "run", copy_function=os.link)
        stages.learn(RunDirectory.open(copy))


def measure_in_child(run: Path, *arguments: int) -> dict[str, float]:
    """Time and peak memory of `fit`, or of `learn` without arguments, in a new process."""
    command = [sys.executable, __file__, str(run), "--child", json.dumps(arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def child(run: Path, arguments: list[int]) -> dict[str, float]:
    began = time.perf_counter()
    if arguments:
        fit(run, *arguments)
    else:
        learn(run)
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "processor_s": used.ru_utime + used.ru_stime,
        "clock_s": time.perf_counter() - began,
        "peak_MB": peak_memory_mb(),
    }


def grid(largest: int) -> list[tuple[str, int, int, int]]:
    """The quantity that grows; rows, targets and kernel size of each point."""
    rows = [n for n in (100_000, 300_000, 1_000_000, 3_000_000, 10_000_000) if n <= largest]
    return [
        *(("rows", n, NUM_TARGETS, KERNEL_SIZE) for n in rows),
        *(("targets", NUM_ROWS, n, KERNEL_SIZE) for n in (100, 300, 1000)),
        *(("kernel size", NUM_ROWS, NUM_TARGETS, n) for n in (100, 300, 1000)),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--sets", type=int, default=12, help="whose nearest are searched")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--largest", type=int, default=10_000_000, help="most touches")
    parser.add_argument("--data", type=Path, default=Path("learning.csv"))
    parser.add_argument("--child", type=json.loads, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child is not None:
        print(json.dumps(child(arguments.run, arguments.child)))
        return

    num_rows = ExperienceReader(arguments.run / "experience").num_rows
    learned = load_representation(RunDirectory.open(arguments.run))
    print(
        f"{'nearest, one core':<20}{'ns/pair':>10}{'times':>8}{'1e12, 2 cores':>16}{'differs':>12}"
    )
    for row in measure_peers(learned, arguments.sets, arguments.turns):
        print(
            f"{row['way']:<20}{row['ns_per_pair']:>10.3f}{row['times_here']:>8.1f}"
            f"{row['all_pairs_2_cores_s']:>14,.0f} s{row['largest_difference_rad']:>8.0e} rad",
            flush=True,
        )
    header = f"{'processor s':>14}{'clock s':>10}{'peak MB':>10}"
    print(f"\n{'all of learn':<34}{header}")
    whole = measure_in_child(arguments.run)
    print(f"{f'{num_rows:,} touches':<34}{_costs(whole)}", flush=True)
    print(f"\n{'touches':>12}{'targets':>10}{'kernel':>8}{'':<4}{header}")
    points: list[dict] = []
    known: dict[tuple[int, int, int], dict[str, float]] = {}
    with arguments.data.open("w", newline="") as file:
        names = ("grown", "rows", "targets", "kernel_size", *whole)
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        for grown, *sizes in grid(arguments.largest):
            key = (sizes[0], sizes[1], sizes[2])
            known[key] = known.get(key) or measure_in_child(arguments.run, *key)
            point = dict(zip(names, (grown, *key, *known[key].values()), strict=True))
            points.append(point)
            writer.writerow(point)
            file.flush()
            print(f"{key[0]:>12,}{key[1]:>10,}{key[2]:>8,}{'':<4}{_costs(point)}", flush=True)


def _costs(found: dict[str, float]) -> str:
    return f"{found['processor_s']:>14.1f}{found['clock_s']:>10.1f}{found['peak_MB']:>10.0f}"


if __name__ == "__main__":
    main()
