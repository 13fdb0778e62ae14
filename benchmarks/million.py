"""A million touches: wall time, size on disk and memory of a worker. Run: `make million`.

For every experiment a small and a large run, in two processes; the store is read back and checked.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from memory import peak_memory_mb

from selftouch_drake.experience import ExperienceReader, collect, require_complete
from selftouch_drake.experiment import load_experiment
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor


def peak_memory_of_worker_mb(delay_s: float) -> float:
    """Peak memory of the process that runs this, in MB."""
    time.sleep(delay_s)  # so that every worker takes one of these
    return peak_memory_mb()


def measure(name: str, num_samples: int, workers: int, folder: Path) -> str:
    """Collects touches, reads and checks them; returns a line of the table."""
    # Nothing is learned, so that the number of targets only has to be one that is valid.
    overrides = {"babbling": {"num_samples": num_samples}, "representation": {"num_targets": 50}}
    run = RunDirectory.create(folder / f"{name}-{num_samples}", load_experiment(name, overrides))
    fingerprint = run.fingerprint()
    began = time.perf_counter()
    with local_executor(workers) as executor:
        collect(run.experiment, run.path, fingerprint=fingerprint, executor=executor)
        wall = time.perf_counter() - began
        memory = max(executor.map(peak_memory_of_worker_mb, [0.2] * 2 * workers))
    for truth in (False, True):
        require_complete(run.experiment, run.path, fingerprint=fingerprint, truth=truth)
    experience = ExperienceReader(run.experience)
    rows = 0
    for q, sensation in zip(experience.batches("q"), experience.batches("sensation"), strict=True):
        assert np.isfinite(q).all()
        assert (sensation >= 0).all()
        assert sensation.any(axis=1).all()
        rows += len(q)
    assert rows == experience.num_rows == num_samples
    size = sum(path.stat().st_size for path in run.experience.iterdir()) / rows
    return f"{name:<20}{rows:>12,}{wall:>10.1f}{rows / wall:>12,.0f}{size:>12.1f}{memory:>12.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("experiments", nargs="*", default=["sphere", "cube", "torus"])
    parser.add_argument("--touches", type=int, default=1_000_000, help="of the large run")
    parser.add_argument("--workers", type=int, default=2, help="processes that babble")
    parser.add_argument("--keep", type=Path, help="keep the runs in this folder")
    arguments = parser.parse_args()
    header = ("touches", 12), ("wall s", 10), ("touches/s", 12), ("bytes/row", 12), ("peak MB", 12)
    print(f"{'experiment':<20}" + "".join(f"{name:>{width}}" for name, width in header))
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.experiments:
            for num_samples in (arguments.touches // 10, arguments.touches):
                where = arguments.keep or Path(folder)
                print(measure(name, num_samples, arguments.workers, where), flush=True)


if __name__ == "__main__":
    main()
