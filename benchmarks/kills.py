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

from selftouch_drake import stages  # noqa: F401 - imported once, here
from selftouch_drake.cli import cli, exit_status

SMALL = (
    "{body: {resolution: 0.04}, babbling: {num_samples: 1200, walk_size: 300}, "
    "representation: {num_targets: 50, metric: motor}, "
    "evaluation: {num_pairs: 1, shape_metrics: []}}"
)
SWEEP = f"""
name: kills
experiments: [cube]
set: {SMALL}
grid: {{representation.max_kernel_size: [500, 1000]}}
"""


def commands(folder: Path) -> dict[str, list[str]]:
    """The stages, in order; each begins where the one before came to its end."""
    run = str(folder / "run")
    (folder / "kills.yaml").write_text(SWEEP)
    return {
        "babble": ["babble", "cube", "--out", run, "--set", SMALL, "--workers", "1"],
        "learn": ["learn", run],
        "evaluate": ["evaluate", run],
        "report": ["report", run],
        "sweep": ["sweep", str(folder / "kills.yaml"), "--out", f"{run}_sweep", "--workers", "1"],
    }


def start(command: list[str]) -> multiprocessing.Process:
    """Runs a command line in a process, and a session, of its own."""

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
    """Of every file but those that hold times; figures without those that are times."""
    found = {}
    for path in sorted(folder.rglob("*")):
        content = path.read_bytes() if path.is_file() else b""
        if path.name == "metrics.json":
            figures = json.loads(content)
            timeless = {
                k: v for k, v in figures.items() if not k.endswith(("_s", "_ms_median", "_ms_p95"))
            }
            content = json.dumps(timeless, sort_keys=True).encode()
        if path.is_file() and path.name != ".lock" and path.suffix not in (".html", ".png"):
            if path.name != "table.parquet":
                found[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
        elif path.suffix in (".html", ".png"):
            found[str(path.relative_to(folder))] = "there"
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--stages", nargs="*", default=["babble", "learn", "evaluate", "report", "sweep"]
    )
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    same = {stage: [0, 0] for stage in arguments.stages}
    with tempfile.TemporaryDirectory() as folder:
        base, work = Path(folder) / "base", Path(folder) / "work"
        base.mkdir()
        before: dict[str, Path] = {}
        duration, expected = {}, {}
        for stage, command in commands(base).items():
            before[stage] = Path(folder) / f"before_{stage}"
            shutil.copytree(base, before[stage])
            began = time.perf_counter()
            process = start(command)
            process.join()
            assert process.exitcode == 0, f"{stage} failed"
            duration[stage] = time.perf_counter() - began
            expected[stage] = digests(base)
        for number in range(arguments.kills):
            stage = arguments.stages[number % len(arguments.stages)]
            shutil.rmtree(work, ignore_errors=True)
            # The same path, so that what names it is the same.
            shutil.rmtree(base)
            shutil.copytree(before[stage], base)
            command = commands(base)[stage]
            moment = random.uniform(0, duration[stage])
            process = start(command)
            process.join(moment)
            killed = process.is_alive()
            if killed:
                try:
                    os.killpg(process.pid, signal.SIGKILL)
                except ProcessLookupError:  # it has no session of its own yet
                    process.kill()
            process.join()
            process = start(command)
            process.join()
            good = process.exitcode == 0 and digests(base) == expected[stage]
            same[stage][0] += good
            same[stage][1] += 1
            print(
                f"{number + 1:3d} {stage:9s} killed at {moment:5.1f} of {duration[stage]:5.1f} s"
                f"{'' if killed else ' (was done)'}: {'same' if good else 'DIFFERENT'}",
                flush=True,
            )
            if not good:
                now = digests(base)
                print(
                    {k for k in {**now, **expected[stage]} if now.get(k) != expected[stage].get(k)}
                )
    print({stage: f"{good} of {tried}" for stage, (good, tried) in same.items()})


if __name__ == "__main__":
    main()
