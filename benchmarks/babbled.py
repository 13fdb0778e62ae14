"""Runs with touches; a missing run is made, so that a benchmark is one command."""

from __future__ import annotations

from pathlib import Path

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import World
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor


def babbled(path: Path, experiment: Experiment) -> RunDirectory:
    """The run directory of an experiment, with all its touches, on two processes."""
    run = RunDirectory.create(path, experiment)
    if not stages.has_babbled(run):
        with local_executor(2) as executor:
            stages.babble(run, World(experiment), executor)
    return run
