"""Learns from a run here and on a local Dask cluster, and compares times and bytes.

    python benchmarks/cost/cluster.py RUN

RUN has babbled. Both ways learn a copy of it, one after the other. Times are of the clock.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

from distributed import LocalCluster

from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import dask_executor

MADE = (
    "representation.npz",
    "touch_model.npz",
    "topology.npz",
    "body_distances.npz",
    "body_model.npz",
)


def learned(run: Path, folder: Path, scheduler: str | None) -> dict[str, bytes]:
    """The bytes of what is learned in a copy of a run whose shards are links."""
    for file in run.rglob("*"):
        if file.is_file() and not file.name.startswith("."):
            there = folder / file.relative_to(run)
            there.parent.mkdir(parents=True, exist_ok=True)
            if file.name == "metrics.json":  # learning adds to it
                shutil.copy(file, there)
            else:
                there.symlink_to(file.resolve())
    copy = RunDirectory.open(folder)
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        began = time.perf_counter()
        stages.learn(copy, executor=executor)
    where = "on the cluster" if scheduler else "here"
    print(f"{where}: {time.perf_counter() - began:.1f} s", flush=True)
    return {name: (folder / name).read_bytes() for name in MADE}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(
            n_workers=arguments.workers, threads_per_worker=1, dashboard_address=None
        ) as cluster,
    ):
        here = learned(arguments.run, Path(folder) / "here", None)
        there = learned(arguments.run, Path(folder) / "there", cluster.scheduler_address)
    differ = [name for name in MADE if here[name] != there[name]]
    print(f"different bytes: {', '.join(differ)}" if differ else "the same bytes")


if __name__ == "__main__":
    main()
