"""Costs of all work, compared with alternatives, in one table. Run: `make bench`.

Ways take turns in one run; medians. With `--before CHECKOUT` the rows that compare with an earlier
version run its command line, too. Those rows start a process each, and count what it starts; all
others count the time of one core. docs/performance.md holds the table.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from babbling import measure, measure_steps
from peers import measure_peers

from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_agent, load_representation
from selftouch_drake.run.directory import RunDirectory

HERE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """A line of the table; a ratio above 1 means that ours is better."""

    work: str
    ours: str
    alternative: str
    ratio: float | None = None

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f"{self.ratio:.3g}"
        return f"| {self.work} | {self.ours} | {self.alternative} | {ratio} |"


def cost(checkout: Path, *arguments: str, folder: Path) -> tuple[float, float]:
    """Wall and CPU time of one command of a version, with all its processes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    command = [sys.executable, "-m", "selftouch_drake.cli", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    clock = time.perf_counter() - began
    if done.returncode:
        raise SystemExit(f"{checkout}: {' '.join(arguments)} failed: {done.stderr.strip()}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return clock, spent


def beside(work: str, costs: dict[str, list[tuple[float, float]]]) -> Row:
    """A row of wall and CPU times, medians over the turns of each version that there is."""
    clock, spent = np.median(costs["ours"], axis=0)
    row = Row(work, f"{clock:.1f} s ({spent:.1f} s of processor)", "")
    if "before" not in costs:
        return row
    before = np.median(costs["before"], axis=0)
    alternative = f"version before: {before[0]:.1f} s ({before[1]:.1f} s)"
    return replace(row, alternative=alternative, ratio=before[0] / clock)


def touch_rows(turns: int) -> Iterator[Row]:
    rates = measure(4000, turns)
    for other, name in (("loop", "bare Drake loop"), ("mujoco", "MuJoCo, point contact")):
        if other in rates:
            ratio = rates["selftouch"] / rates[other]
            alternative = f"{name}: {rates[other]:,.0f} /s"
            yield Row("stored touches, sphere", f"{rates['selftouch']:,.0f} /s", alternative, ratio)
    for name, rate in measure_steps(turns).items():
        yield Row(f"steps that touch nothing, {name}", f"{rate / 1e6:.2f} million /s", "")


def run_rows(versions: dict[str, Path], folder: Path, touches: int) -> Iterator[Row]:
    """Babbling, learning and the demo as commands; the runs stay in `folder`."""
    small = f"{{babbling: {{num_samples: {touches}}}, representation: {{num_targets: 1000}}}}"
    babbled: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for name in ("torus", "cube"):
        for who, checkout in versions.items():
            where = str(folder / f"{name}-{who}")
            spent = cost(checkout, "babble", name, "--out", where, "--set", small, folder=folder)
            babbled.setdefault(name, {})[who] = [spent]
    learned = {
        who: [cost(checkout, "learn", str(folder / f"torus-{who}"), folder=folder)]
        for who, checkout in versions.items()
    }
    demo = {
        who: [cost(checkout, "run", "cube", "--out", str(folder / f"demo-{who}"), folder=folder)]
        for who, checkout in versions.items()
    }
    for name, costs in babbled.items():
        yield beside(f"{touches:,} touches, {name}", costs)
    yield beside(f"learn {touches:,} touches, 1000 targets", learned)
    yield beside("`make demo`, installed and compiled", demo)


def start_rows(versions: dict[str, Path], folder: Path, turns: int) -> Iterator[Row]:
    """Time until a command answers."""
    for what, *options in (
        ("experiments",),
        ("plan", "--from", "3", "--to", "50"),
        ("robot", "cube"),
    ):
        costs: dict[str, list[tuple[float, float]]] = {}
        for _ in range(turns):
            for who, checkout in versions.items():
                if what == "robot" and who == "before":
                    continue
                run = [str(folder / f"demo-{who}")] if what == "plan" else []
                spent = cost(checkout, what, *run, *options, folder=folder)
                costs.setdefault(who, []).append(spent)
        yield beside(f"`selftouch {what}`", costs)


def query_row(run: RunDirectory, num_pairs: int, *, alone: bool = False) -> Iterator[Row]:
    """Queries, including the first, compared with OMPL with the true model unless `alone`."""
    # Only this row needs OMPL.
    from ompl import util as ou
    from ompl_planner import measure_cpu, ompl_planner, questions

    ou.setLogLevel(ou.LogLevel.LOG_ERROR)
    ou.RNG.setSeed(1)
    world, agent = stages.make_world(run), load_agent(run)
    pilot = pilot_in(stages.run_bodies(run), agent, run.experiment)
    pilot.get_ready()
    asked = questions(run, agent.representation, num_pairs)

    def plan(start: int, goal: int) -> None:
        with suppress(NoWayError):
            pilot.plan(start, goal)

    ours = [measure_cpu(lambda q=q: plan(q.start, q.goal)) for q in asked]
    median, most = 1e3 * np.quantile(ours, [0.5, 0.95])
    row = Row("query, median / 95 %", f"{median:.1f} / {most:.1f} ms", "")
    if alone:
        yield row
        return
    ompl = ompl_planner(world)
    ompl(asked[0])  # compiles what is compiled
    theirs = [measure_cpu(lambda q=q: ompl(q)) for q in asked]
    their, their_most = 1e3 * np.quantile(theirs, [0.5, 0.95])
    other = f"OMPL with the true model: {their:,.0f} / {their_most:,.0f} ms"
    yield replace(row, alternative=other, ratio=their / median)


def nearest_row(run: RunDirectory, turns: int) -> Iterator[Row]:
    """Exact nearest distances between kernel sets."""
    ours, tree, _ = measure_peers(load_representation(run), 12, turns)
    yield Row(
        "nearest distances, exact, one core",
        f"{ours['ns_per_pair']:.3f} ns a pair",
        f"scipy cKDTree: {tree['ns_per_pair']:.3f} ns",
        tree["times_here"],
    )


def memory_row(run: Path, folder: Path) -> Row:
    """Peak memory of an evaluation of 50 pairs with all its processes."""
    copy = shutil.copytree(run, folder / "pairs-50")
    text = (copy / "experiment.yaml").read_text().replace("num_pairs: 20", "num_pairs: 50")
    (copy / "experiment.yaml").write_text(text)
    return Row("evaluation of 50 pairs, memory", f"{peak_mb('evaluate', str(copy)):.0f} MB", "")


def peak_mb(*arguments: str) -> float:
    """Peak memory of a command and the processes that it starts; shared pages count once."""
    command = [sys.executable, "-m", "selftouch_drake.cli", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(HERE)}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    peak = 0.0
    while process.poll() is None:
        peak = max(peak, _share_mb(process.pid))
        time.sleep(0.2)
    if process.returncode:
        raise SystemExit(f"{' '.join(arguments)} failed")
    return peak


def _share_mb(pid: int) -> float:
    """Memory of a process and those that it started, in MB; 0 if it has just ended."""
    of_process = Path(f"/proc/{pid}")
    try:
        memory = (of_process / "smaps_rollup").read_text()
        started = (of_process / f"task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    own = int(memory.partition("\nPss:")[2].split()[0]) if "\nPss:" in memory else 0
    return own / 1024 + sum(_share_mb(int(child)) for child in started)


def machine() -> str:
    names = [
        line for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    packages = ", ".join(f"{name} {version(name)}" for name in ("drake", "numba", "numpy", "scipy"))
    processor = names[0].split(":")[1].strip() if names else platform.processor()
    return f"{os.cpu_count()} cores of {processor}, Python {platform.python_version()}, {packages}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="a checkout of the version to compare with")
    parser.add_argument("--touches", type=int, default=200_000, help="a million takes five minutes")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=20, help="that are planned")
    parser.add_argument("--touching", action="store_true", help="only the rows of stored touches")
    parser.add_argument("--query", type=Path, help="only queries, of a run that has learned")
    options = parser.parse_args()
    versions = {"ours": HERE} | ({"before": options.before.resolve()} if options.before else {})
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def parts() -> Iterator[Row]:
            if options.query:
                run = RunDirectory.open(options.query)
                yield from query_row(run, options.pairs, alone=True)
                return
            yield from touch_rows(options.turns)
            if options.touching:
                return
            yield from run_rows(versions, folder, options.touches)
            torus = RunDirectory.open(folder / "torus-ours")
            yield from query_row(torus, options.pairs)
            yield from nearest_row(torus, options.turns)
            yield from start_rows(versions, folder, options.turns)
            yield memory_row(folder / "demo-ours", folder)

        for row in parts():
            print(row, file=sys.stderr, flush=True)
            rows.append(row)
    print(f"\n{machine()}\n\n| work | ours | the alternative | ratio |\n|---|---|---|---|")
    print("\n".join(map(str, rows)))


if __name__ == "__main__":
    main()
