"""Peak memory of every stage at a million touches and at ten million. Run: `make memory`.

The smaller run is made if it is missing. The larger one has its shards ten times, under the names
and stamps of its own. In both the last walks are left out, and babbled where memory is measured,
after the main process has checked all the others. Every stage, and every worker, is a process of
its own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from selftouch_drake.experience.collect import walk_sizes
from selftouch_drake.experience.store import ExperienceReader, Shard, write_shard
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.outputs import write_report

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import babbled
from benchmarks.shared.results import add_update_option, results

# Walks that are babbled where memory is measured.
NUM_BABBLED = 10
STAGES = ("babble, a worker", "babble, the main process", "learn", "evaluate", "report")


def peak_memory_mb() -> float:
    """Peak memory of this process, in MB; `getrusage` would include memory of its parent."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def repeated(source: Path, times: int, num_targets: int, path: Path) -> None:
    """Makes a run with the experience of `source`, repeated, without the last walks."""
    whole = RunDirectory.open(source)
    known = whole.experiment
    experiment = replace(
        known,
        babbling=replace(known.babbling, num_samples=times * known.babbling.num_samples),
        representation=replace(known.representation, num_targets=num_targets),
        execution=replace(known.execution, max_tries=1),
        evaluation=replace(known.evaluation, num_pairs=4, shape_metrics=[]),
    )
    run = RunDirectory.create(path, experiment)
    felt, true = ExperienceReader(whole.experience), ExperienceReader(whole.truth)
    num_shards = len(walk_sizes(experiment)) - NUM_BABBLED
    again = itertools.chain.from_iterable(
        zip(felt.batches("q"), felt.batches("sensation"), true.contacts(), strict=True)
        for _ in itertools.count()
    )
    for walk, (q, sensation, contacts) in zip(range(num_shards), again, strict=False):
        shard = Shard(
            walk=walk,
            num_steps=30 * len(q),
            num_impossible=0,
            step=30 * np.arange(len(q)),
            q=q,
            sensation=sensation,
            contacts=contacts,
        )
        write_shard(path, shard, fingerprint=run.fingerprint())


def do(stage: str, path: Path) -> dict[str, float]:
    """Runs a stage in this process; returns the peak memory of its processes, in MB."""
    run = RunDirectory.open(path)
    if stage == "babble":
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=spawn) as executor:
            stages.babble(run, executor)
            worker = executor.submit(peak_memory_mb).result()
        return {STAGES[0]: worker, STAGES[1]: peak_memory_mb()}
    if stage == "learn":
        stages.learn(run)
    elif stage == "evaluate":
        stages.evaluate(run)
    else:
        write_report(run)
    return {stage: peak_memory_mb()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, nargs="?", default=Path("runs/memory"))
    parser.add_argument("--touches", type=int, default=1_000_000, help="of a run that is made")
    parser.add_argument("--times", type=int, default=10, help="as many touches in the larger")
    parser.add_argument("--targets", type=int, default=300, help="target sensations of both")
    add_update_option(parser, "memory")
    parser.add_argument("--stage", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.stage:
        print(json.dumps(do(arguments.stage, arguments.run)))
        return

    if not arguments.run.exists():
        walks = {"num_samples": arguments.touches, "walk_size": arguments.touches // 50}
        babbled(arguments.run, load_experiment("cube", {"babbling": walks}))
    num_touches = RunDirectory.open(arguments.run).experiment.babbling.num_samples
    peaks: dict[str, list[float]] = {stage: [] for stage in STAGES}
    with tempfile.TemporaryDirectory(dir=arguments.run.parent) as folder:
        for times in (1, arguments.times):
            copy = Path(folder) / f"times_{times}"
            repeated(arguments.run, times, arguments.targets, copy)
            for stage in ("babble", "learn", "evaluate", "report"):
                command = [sys.executable, __file__, str(copy), "--stage", stage]
                done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
                for name, peak in json.loads(done.stdout).items():
                    peaks[name].append(peak)
                    print(f"{times * num_touches:>12,}  {name:<26}{peak:8.0f} MB", flush=True)
            shutil.rmtree(copy)
    sizes = [num_touches, arguments.times * num_touches]
    with results("memory", update=arguments.update) as add:
        for stage in STAGES:
            mb = (f"MB_at_{size}_touches" for size in sizes)
            add({"stage": stage} | dict(zip(mb, map(round, peaks[stage]), strict=True)))
    print(f"\n{'':<26}{sizes[0]:>12,}{sizes[1]:>12,}{'more':>8}")
    for stage, (small, large) in peaks.items():
        print(f"{stage:<26}{small:>9.0f} MB{large:>9.0f} MB{large / small - 1:>8.1%}")


if __name__ == "__main__":
    main()
