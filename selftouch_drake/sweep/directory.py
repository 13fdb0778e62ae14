"""Where a sweep keeps its runs, its table and its figures."""

import hashlib
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import yaml

from selftouch_drake.experiment import Experiment, dump_experiment
from selftouch_drake.files import locked, write_text_whole
from selftouch_drake.run.directory import Inside, RunDirectory, RunError
from selftouch_drake.sweep.design import Sweep

_HEADER = "# A sweep of selftouch_drake, format 1\n"


@dataclass(frozen=True, slots=True)
class SweepDirectory:
    """Where a sweep keeps its runs, its table and its figures."""

    path: Path

    table = Inside("table.parquet", "All metrics of all runs.")
    figures = Inside("figures", "Pictures.")

    @staticmethod
    def create(path: Path, sweep: Sweep) -> "SweepDirectory":
        """Begins or resumes a sweep; existing runs are kept.

        Raises:
            RunError: the folder is not empty, and is not a sweep of that name.
        """
        header = f"{_HEADER}name: {sweep.name}\n"
        file = path / "sweep.yaml"
        if file.is_file():
            if not file.read_bytes().startswith(header.encode()):
                raise RunError(f"{path} belongs to another sweep; choose another --out")
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise RunError(f"{path} is neither a sweep nor empty; choose another --out")
        path.mkdir(parents=True, exist_ok=True)
        names = [run_name(experiment) for experiment in sweep.experiments]
        content = {"fields": list(sweep.fields), "runs": names}
        write_text_whole(file, header + yaml.safe_dump(content, sort_keys=False))
        return SweepDirectory(path)

    def writing(self) -> AbstractContextManager[None]:
        """Locks the sweep for one writer, as `locked`; a RunError refuses a second one."""
        reason = "is being run by another process; wait for it, or choose another --out"
        return locked(self.path, RunError(f"{self.path} {reason}"))

    def run(self, experiment: Experiment) -> RunDirectory:
        """The run of an experiment, whether it exists or not."""
        return RunDirectory(self.path.resolve() / "runs" / run_name(experiment), experiment)


def run_name(experiment: Experiment) -> str:
    """The name of a run in its sweep: the experiment's, its seed, and a digest of all fields."""
    digest = hashlib.sha256(dump_experiment(experiment).encode()).hexdigest()[:8]
    word = "".join(c if c.isalnum() else "_" for c in experiment.name)[:40]
    return f"{word}-s{experiment.seed}-{digest}"
