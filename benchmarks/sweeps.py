"""A sweep compared with single runs: `python benchmarks/sweeps.py`, on an idle machine.

By hand they are `selftouch run`, one command after the other, each with a process a core while it
babbles; it draws a report besides, which a sweep does not. So the same is done once more with the
verbs that a sweep does: `babble`, `learn` and `evaluate`. The sweep comes first and last. By hand
each run begins with nothing, whatever was run before. So only some of them, drawn at random, are
made, and the time of all is estimated from these.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from selftouch_drake.experiment import Experiment, dump_experiment
from selftouch_drake.sweep import Sweep, load_sweep
from selftouch_drake.sweep.runs import SweepDirectory
from selftouch_drake.sweep.table import read_table


def selftouch(*arguments: object) -> None:
    command = [sys.executable, "-m", "selftouch_drake.cli", *map(str, arguments)]
    subprocess.run(command, check=True, capture_output=True)


def now() -> np.ndarray:
    """Wall time and CPU time of all commands so far, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return np.array([time.perf_counter(), used.ru_utime + used.ru_stime])


def as_sweep(name: str, folder: Path, workers: int) -> np.ndarray:
    began = now()
    selftouch("sweep", name, "--out", folder, "--workers", workers)
    return now() - began


def by_hand(
    experiments: list[Experiment], folder: Path, workers: int, *, report: bool
) -> np.ndarray:
    began = now()
    for number, experiment in enumerate(experiments):
        file, run = folder / f"{number}.yaml", folder / str(number)
        file.write_text(dump_experiment(experiment))
        verbs = [["run" if report else "babble", file, "--out", run, "--workers", workers]]
        verbs += [] if report else [["learn", run], ["evaluate", run]]
        for verb in verbs:
            selftouch(*verb)
    return now() - began


def num_files(sweep: Sweep, folder: Path, name: str) -> int:
    """Number of files of that name on disk; shared files count once."""
    runs = [SweepDirectory(folder).run(experiment) for experiment in sweep.experiments]
    return len({(run.path / name).stat().st_ino for run in runs})


def print_line(what: str, seconds: np.ndarray) -> None:
    print(f"{what:<36}{seconds[0]:7.0f} s{seconds[1]:7.0f} s of processors", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sweep", default="quick", help="name of a shipped one, or a file")
    parser.add_argument("--workers", type=int, default=2, help="runs at a time")
    parser.add_argument("--by-hand", type=int, default=24, help="runs that are made by hand")
    arguments = parser.parse_args()
    sweep = load_sweep(arguments.sweep)
    number = min(arguments.by_hand, len(sweep.experiments))
    drawn = np.random.default_rng(0).choice(len(sweep.experiments), number, replace=False)
    some = [sweep.experiments[i] for i in drawn]
    times = len(sweep.experiments) / number
    print(f"{len(sweep.experiments)} runs, {arguments.workers} of {os.cpu_count()} cores")
    print(f"by hand {number} of them, times {times:g}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("hand", "verbs"):
            (folder / part).mkdir()
        first = as_sweep(arguments.sweep, folder / "first", arguments.workers)
        print_line("sweep", first)
        hand = times * by_hand(some, folder / "hand", arguments.workers, report=True)
        print_line("run, one by one", hand)
        verbs = times * by_hand(some, folder / "verbs", arguments.workers, report=False)
        print_line("babble, learn, evaluate, one by one", verbs)
        last = as_sweep(arguments.sweep, folder / "last", arguments.workers)
        print_line("sweep again", last)
        assert read_table(folder / "last" / "table.parquet")["error"].null_count == len(
            sweep.experiments
        )
        experiences, representations = (
            num_files(sweep, folder / "last", file)
            for file in ("experience/part-00000.parquet", "representation.npz")
        )
    print(f"experiences collected: {experiences}, representations learned: {representations}")
    mean = (first + last) / 2
    for what, (clock, processors) in (("`run`", hand / mean), ("the verbs", verbs / mean)):
        print(f"{what} one by one: {clock:.1f} x the clock, {processors:.1f} x the processors")


if __name__ == "__main__":
    main()
