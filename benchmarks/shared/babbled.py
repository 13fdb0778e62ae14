"""Runs with touches; a missing run is made, so that a benchmark is one command."""

from __future__ import annotations

from pathlib import Path

from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor


def babbled(path: Path, experiment: Experiment) -> RunDirectory:
    """The run directory of an experiment, with all its touches, on two processes."""
    run = RunDirectory.create(path, experiment)
    if not stages.has_babbled(run):
        with local_executor(2) as executor:
            stages.babble(run, executor)
    return run


def learned(path: Path, experiment: Experiment) -> RunDirectory:
    """As `babbled`, and it has learned, the body model too."""
    run = babbled(path, experiment)
    if not (stages.has_learned(run) and stages.has_modelled(run)):
        stages.learn(run)
    return run


def run_at(path: Path, num_samples: int) -> RunDirectory:
    """The run at a path; one that is missing is made, of the body and seed of its name.

    Args:
        path: of a run, such as `runs/torus_951`.
        num_samples: touches of a run that is made.
    """
    if path.exists():
        return RunDirectory.open(path)
    body, _, seed = path.name.rpartition("_")
    size = {"seed": int(seed), "babbling": {"num_samples": num_samples}}
    path.parent.mkdir(parents=True, exist_ok=True)
    return babbled(path, load_experiment(body, size))
