"""Costs of all work, beside what a user would pick instead, in one table. Run: `make bench`.

The alternatives are a bare loop over Drake, MuJoCo, OMPL with the true model, and scipy. With
`make bench BEFORE=path/to/another/checkout` the commands of an earlier version run, too.

Ways take turns in one run; medians. Rows of commands start a process each, and count what it
starts; all others count the time of one core. docs/performance.md holds the table.
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
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_agent, load_representation
from selftouch_drake.run.directory import RunDirectory

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.cost.babbling import measure, measure_steps
from benchmarks.cost.peers import measure_peers
from benchmarks.cost.questions import Question, measure_cpu, questions

HERE = Path(__file__).resolve().parents[2]
#: Names of this version, and of an earlier one that runs beside it.
OURS = "ours"
BEFORE = "before"


class CommandError(Exception):
    """A command of some version failed; the message is the last line that it wrote."""


class Cost(NamedTuple):
    """Time of a command with all its processes."""

    clock_s: float
    processor_s: float

    def __str__(self) -> str:
        return f"{self.clock_s:.1f} s ({self.processor_s:.1f} s of processor)"


@dataclass(frozen=True)
class Row:
    """A line of the table; a ratio above 1 means that ours is better."""

    work: str
    ours: str
    alternative: str = ""
    ratio: float | None = None

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f"{self.ratio:.3g}"
        return f"| {self.work} | {self.ours} | {self.alternative} | {ratio} |"


def note(text: str) -> None:
    """Writes a line on stderr, beside the table."""
    print(f"bench: {text}", file=sys.stderr, flush=True)


def checked_checkout(path: Path) -> Path:
    """The whole path of a checkout; ends the program if it is none."""
    if not (path / "selftouch_drake" / "__init__.py").is_file():
        raise SystemExit(
            f"bench: BEFORE is {str(path)!r}, and no checkout: it has no selftouch_drake; make one "
            "with `git worktree add build/before COMMIT`, or leave BEFORE out"
        )
    return path.resolve()


def cost(checkout: Path, *arguments: str, folder: Path) -> Cost:
    """Runs one command of a version, in a folder, and returns what it takes.

    Raises:
        CommandError: the command failed.
    """
    # Also earlier versions have this module; `python -m selftouch_drake` is newer.
    command = [sys.executable, "-m", "selftouch_drake.cli", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    clock_s = time.perf_counter() - began
    if done.returncode:
        *_, reason = done.stderr.strip().splitlines() or ["it said nothing"]
        raise CommandError(reason)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    user_s = after.ru_utime - before.ru_utime
    system_s = after.ru_stime - before.ru_stime
    return Cost(clock_s, user_s + system_s)


def command_row(
    work: str,
    versions: dict[str, Path],
    arguments: Callable[[str], list[str]],
    *,
    folder: Path,
    turns: int = 1,
) -> Row:
    """A row of what a command takes: medians over the turns of each version that there is.

    An earlier version may not know a command or its options: then the row says only what this
    version takes.

    Args:
        work: what the command does.
        versions: checkouts by name.
        arguments: given the name of a version, the words of its command.
        folder: where the command runs.
        turns: how often it runs.
    """
    costs: dict[str, list[Cost]] = {who: [] for who in versions}
    for _ in range(turns):
        for who in list(costs):
            words = arguments(who)
            try:
                costs[who].append(cost(versions[who], *words, folder=folder))
            except CommandError as error:
                if who == OURS:
                    raise SystemExit(f"bench: {' '.join(words)} failed: {error}") from None
                note(f"the version before fails to {' '.join(words[:2])}: {error}")
                del costs[who]
    ours = Cost(*np.median(costs[OURS], axis=0))
    row = Row(work, str(ours))
    if BEFORE not in costs:
        return row
    before = Cost(*np.median(costs[BEFORE], axis=0))
    return replace(
        row, alternative=f"version before: {before}", ratio=before.clock_s / ours.clock_s
    )


def touch_rows(turns: int) -> Iterator[Row]:
    rates = measure(4000, turns)
    for other, name in (("loop", "bare Drake loop"), ("mujoco", "MuJoCo, point contact")):
        if other in rates:
            ratio = rates["selftouch"] / rates[other]
            alternative = f"{name}: {rates[other]:,.0f} /s"
            yield Row("stored touches, sphere", f"{rates['selftouch']:,.0f} /s", alternative, ratio)
    for name, rate in measure_steps(turns).items():
        yield Row(f"steps that touch nothing, {name}", f"{rate / 1e6:.2f} million /s")


def run_rows(versions: dict[str, Path], folder: Path, touches: int) -> Iterator[Row]:
    """Babbling, learning and the demo as commands; the runs stay in `folder`."""
    size = f"{{babbling: {{num_samples: {touches}}}, representation: {{num_targets: 1000}}}}"

    def run_of(name: str, who: str) -> str:
        return str(folder / f"{name}-{who}")

    def row(work: str, arguments: Callable[[str], list[str]]) -> Row:
        return command_row(work, versions, arguments, folder=folder)

    for name in ("torus", "cube"):
        yield row(
            f"{touches:,} touches, {name}",
            lambda who, name=name: ["babble", name, "--out", run_of(name, who), "--set", size],
        )
    yield row(
        f"learn {touches:,} touches, 1000 targets", lambda who: ["learn", run_of("torus", who)]
    )
    yield row(
        "`make demo`, installed and compiled",
        lambda who: ["run", "cube", "--out", run_of("demo", who)],
    )


def start_rows(versions: dict[str, Path], folder: Path, turns: int) -> Iterator[Row]:
    """Time until a command answers."""

    def row(what: str, arguments: Callable[[str], list[str]]) -> Row:
        return command_row(f"`selftouch {what}`", versions, arguments, folder=folder, turns=turns)

    pair = ["--from", "3", "--to", "50"]
    yield row("experiments", lambda who: ["experiments"])
    yield row("plan", lambda who: ["plan", str(folder / f"demo-{who}"), *pair])
    yield row("robot", lambda who: ["robot", "cube"])


def query_row(run: RunDirectory, num_pairs: int, *, alone: bool = False) -> Row:
    """Queries, including the first, beside OMPL with the true model unless `alone`."""
    world, agent = stages.make_world(run), load_agent(run)
    pilot = pilot_in(stages.run_bodies(run), agent, run.experiment)
    pilot.prepare_queries()
    asked = questions(run, agent.representation, num_pairs)

    def plan(question: Question) -> None:
        with suppress(NoWayError):
            pilot.plan(question.start, question.goal)

    def quantiles_ms(planner: Callable[[Question], object]) -> np.ndarray:
        times_s = [measure_cpu(lambda q=question: planner(q)) for question in asked]
        return 1e3 * np.quantile(times_s, [0.5, 0.95])

    median, most = quantiles_ms(plan)
    row = Row("query, median / 95 %", f"{median:.1f} / {most:.1f} ms")
    if alone:
        return row
    try:
        from benchmarks.cost import ompl_planner
    except ImportError:
        note("OMPL is not installed: `pip install ompl` to compare queries with it")
        return row
    ompl_planner.begin(seed=1)
    theirs = ompl_planner.ompl_planner(world)
    theirs(asked[0])  # compiles what is compiled
    their_median, their_most = quantiles_ms(theirs)
    return replace(
        row,
        alternative=f"OMPL with the true model: {their_median:,.0f} / {their_most:,.0f} ms",
        ratio=their_median / median,
    )


def nearest_row(run: RunDirectory, turns: int) -> Row:
    """Exact nearest distances between kernel sets."""
    ours, tree, _ = measure_peers(load_representation(run), 12, turns)
    return Row(
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
    return Row("evaluation of 50 pairs, memory", f"{peak_mb('evaluate', str(copy)):.0f} MB")


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


def all_rows(versions: dict[str, Path], folder: Path, options: argparse.Namespace) -> Iterator[Row]:
    """Measures one row after another; runs are made in `folder`."""
    if options.query:
        yield query_row(RunDirectory.open(options.query), options.pairs, alone=True)
        return
    yield from touch_rows(options.turns)
    if options.touching:
        return
    yield from run_rows(versions, folder, options.touches)
    torus = RunDirectory.open(folder / f"torus-{OURS}")
    yield query_row(torus, options.pairs)
    yield nearest_row(torus, options.turns)
    yield from start_rows(versions, folder, options.turns)
    yield memory_row(folder / f"demo-{OURS}", folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="a checkout of the version to compare with")
    parser.add_argument("--touches", type=int, default=200_000, help="a million takes five minutes")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=20, help="that are planned")
    parser.add_argument("--touching", action="store_true", help="only the rows of stored touches")
    parser.add_argument("--query", type=Path, help="only queries, of a run that has learned")
    options = parser.parse_args()
    versions = {OURS: HERE}
    if options.before:
        versions[BEFORE] = checked_checkout(options.before)
    elif not (options.touching or options.query):
        note(
            "no earlier version runs beside this one; name a checkout of it to compare with: "
            "`make bench BEFORE=path/to/another/checkout`"
        )
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for row in all_rows(versions, Path(folder), options):
            print(row, file=sys.stderr, flush=True)
            rows.append(row)
    print(f"\n{machine()}\n\n| work | ours | the alternative | ratio |\n|---|---|---|---|")
    print("\n".join(map(str, rows)))


if __name__ == "__main__":
    main()
