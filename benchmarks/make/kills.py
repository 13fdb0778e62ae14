"""Kills at random moments of every stage, each resumed: are the bytes the same? Run: `make kills`.

A stage runs in a process of its own, forked so that nothing is imported anew, and is killed with
all its children at a moment drawn from the time that it takes; then the same command goes on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
from pathlib import Path

import numpy as np

# Imported once, here.
from selftouch_drake.cli import cli, exit_status
from selftouch_drake.run import stages  # noqa: F401
from selftouch_drake.show import outputs  # noqa: F401
from selftouch_drake.sweep.table import read_table

SMALL = (
    "{skins: {body: {surface: {shape: cube, side: 0.44, resolution: 0.04}}}, "
    "babbling: {num_samples: 900, walk_size: 300}, "
    "representation: {num_targets: 50, metric: sensorimotor}, execution: {max_tries: 2}, "
    "evaluation: {num_pairs: 1, shape_metrics: []}}"
)
# A resumed command may not take longer than this many times an undisturbed one, plus a minute.
PATIENCE = 10
SWEEP = f"""
name: kills
experiments: [cube]
set: {SMALL}
grid: {{representation.max_kernel_size: [500, 1000]}}
"""


def commands(folder: Path) -> dict[str, list[str]]:
    """The stages in order; each starts where the previous one ended."""
    run = str(folder / "run")
    (folder / "kills.yaml").write_text(SWEEP)
    return {
        "babble": ["babble", "cube", "--out", run, "--set", SMALL, "--workers", "1"],
        "learn": ["learn", run],
        "plan": ["plan", run, "--from", "3", "--to", "40"],
        "execute": ["execute", run, "--from", "3", "--to", "40"],
        "evaluate": ["evaluate", run],
        "report": ["report", run],
        "sweep": ["sweep", str(folder / "kills.yaml"), "--out", f"{run}_sweep", "--workers", "1"],
    }


def start(command: list[str]) -> multiprocessing.Process:
    """Runs a command line in its own process and session."""

    def work():
        os.setsid()
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        os._exit(exit_status(lambda: cli.main(command, standalone_mode=False)))

    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    return process


def digests(folder: Path) -> dict[str, str]:
    """Content of every file without its times; for pages full of times, only their existence."""
    return {
        str(path.relative_to(folder)): _digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def _digest(path: Path) -> str:
    if path.name == "metrics.json":
        content = json.dumps(_timeless(json.loads(path.read_bytes())), sort_keys=True)
    elif path.name == "table.parquet":
        content = json.dumps([_timeless(row) for row in read_table(path).to_pylist()])
    # They say how long the stages took, or have random names inside.
    elif path.suffix == ".html" or path.parent.parent.name.endswith("_sweep"):
        return "there" if path.stat().st_size else "empty"
    else:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    return hashlib.sha256(content.encode()).hexdigest()


def _timeless(figures: dict[str, object]) -> dict[str, object]:
    times = ("_s", "_ms_median", "_ms_p95")
    return {k: v for k, v in figures.items() if not k.endswith(times) or k.endswith("off_skin_s")}


class Stage:
    """A stage of a run in `folder`: files before and after it, and its duration."""

    def __init__(self, name: str, command: list[str], folder: Path, before: Path):
        self.name, self._command, self._folder, self._before = name, command, folder, before
        shutil.copytree(folder, before)
        began = time.perf_counter()
        process = start(command)
        process.join()
        assert process.exitcode == 0, f"{name} failed"
        self.duration = time.perf_counter() - began
        self._expected = digests(folder)

    def kill(self, random: np.random.Generator) -> float:
        """Begins the stage anew and kills it on the way; returns after how many seconds.

        A stage that was done before its moment came begins again.
        """
        while True:
            # The same path, so that what names it is the same.
            shutil.rmtree(self._folder)
            shutil.copytree(self._before, self._folder)
            moment = random.uniform(0, self.duration)
            process = start(self._command)
            process.join(moment)
            if process.is_alive():
                break
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:  # it has no session of its own yet
            process.kill()
        process.join()
        return moment

    def resume(self) -> list[str]:
        """Gives the same command again; returns the differences."""
        process = start(self._command)
        process.join(PATIENCE * self.duration + 60)
        if process.is_alive():
            os.killpg(process.pid, signal.SIGKILL)
            return ["hangs"]
        if process.exitcode:
            return [f"exit status {process.exitcode}"]
        now = digests(self._folder)
        names = sorted(now.keys() | self._expected.keys())
        return [name for name in names if now.get(name) != self._expected.get(name)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50, help="over all stages")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base"
        base.mkdir()
        stages = []
        for name, command in commands(base).items():
            stages.append(Stage(name, command, base, Path(folder) / f"before_{name}"))
            print(f"{name:9s}{stages[-1].duration:6.1f} s", flush=True)
        same = {stage.name: [0, 0] for stage in stages}
        for number in range(arguments.kills):
            stage = stages[number % len(stages)]
            moment = stage.kill(random)
            wrong = stage.resume()
            same[stage.name][0] += not wrong
            same[stage.name][1] += 1
            found = f"DIFFERENT: {', '.join(wrong)}" if wrong else "same"
            when = f"{moment:5.1f} of {stage.duration:5.1f} s"
            print(f"{number + 1:3d} {stage.name:9s} killed at {when}: {found}", flush=True)
    good, tried = np.sum(list(same.values()), axis=0)
    each = ", ".join(f"{name} {good} of {tried}" for name, (good, tried) in same.items())
    print(f"resumed to the same bytes: {good} of {tried} ({each})")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
