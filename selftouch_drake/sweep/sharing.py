"""A stage that several runs share: one of them does it, and gives its files to the others."""

import os
import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from selftouch_drake.files import written_whole
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn
from selftouch_drake.run.metrics import keys_of


class Outcome(NamedTuple):
    """What came of a stage.

    Attributes:
        failed: the reason by the name of each run that failed by a mistake of its own.
        warned: warnings, each beginning with the name of a run.
    """

    failed: dict[str, str]
    warned: list[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stage:
    """How a stage is done and shared.

    Attributes:
        is_done: whether a run has it.
        do: does it for a run.
        files: what it leaves in the first run and another may share, without metrics.
    """

    is_done: Callable[[RunDirectory], bool]
    do: Callable[[RunDirectory], object]
    files: Callable[[RunDirectory, RunDirectory], list[Path]]


def do_stage(name: str, runs: list[RunDirectory]) -> Outcome:
    """Does a stage for the first of `runs`, and shares it with the others.

    Args:
        name: of the stage: `babble`, `learn` or `evaluate`.
        runs: those that share it; they need not exist.
    """
    if not runs:
        return Outcome({}, [])
    failed: dict[str, str] = {}
    # Runs are many and cores are few: one thread each.
    with threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            _do_once(name, [RunDirectory.create(run.path, run.experiment) for run in runs])
        except ValueError as error:
            reason = " ".join(str(error).split())
            failed = {run.path.name: reason for run in runs}
    first = runs[0].path.name
    # Warnings of other packages are for developers.
    ours = [one for one in caught if one.category.__module__.startswith("selftouch_drake.")]
    return Outcome(failed, [f"{first}: {one.message}" for one in ours])


def _do_once(name: str, runs: list[RunDirectory]) -> None:
    """Gives all runs what one of them has done already, or what the first does now."""
    stage = _STAGES[name]
    donor = next((run for run in runs if stage.is_done(run)), runs[0])
    if not stage.is_done(donor):
        with donor.writing():
            stage.do(donor)
    for run in runs:
        if run is not donor and not stage.is_done(run):
            _share(donor, run, stage.files(donor, run), keys_of(name))
            if not stage.is_done(run):  # a part of it is of this run alone
                with run.writing():
                    stage.do(run)


def _share(donor: RunDirectory, run: RunDirectory, files: list[Path], keys: frozenset[str]) -> None:
    """Gives `run` the files of a stage, then its metrics, which mark the stage as done."""
    with run.writing():
        for file in files:
            _link_or_copy(file, run.path / file.relative_to(donor.path))
        metrics = donor.metrics()
        run.add_metrics({key: value for key, value in metrics.items() if key in keys})


def _link_or_copy(file: Path, there: Path) -> None:
    """Puts a file at a second place, as a hard link where the disk has them."""
    there.parent.mkdir(exist_ok=True)
    there.unlink(missing_ok=True)
    try:
        os.link(file, there)
    except OSError:  # a disk without hard links
        with written_whole(there) as aside:
            shutil.copyfile(file, aside)


def _files_of_babbling(donor: RunDirectory, run: RunDirectory) -> list[Path]:
    """Truth and experience, walk by walk, the skin, and the joints, which older runs lack."""
    truth, experience = donor.path / "truth", donor.path / "experience"
    joints = [donor.joints] if donor.joints.exists() else []
    return [*sorted([*truth.iterdir(), *experience.iterdir()]), donor.skin, *joints]


def _files_of_learning(donor: RunDirectory, run: RunDirectory) -> list[Path]:
    """The representation, and the body model if both runs ask for the same."""
    wanted = [one.experiment.representation.body_model for one in (donor, run)]
    model = [donor.body_model] if wanted[0] == wanted[1] else []
    return [donor.representation, donor.topology, donor.body_distances, *model]


# Stages are looked up by name, because what goes to a worker must pickle.
_STAGES = {
    "babble": _Stage(
        is_done=lambda run: stages.has_babbled(run),
        do=lambda run: stages.babble(run, InTurn()),
        files=_files_of_babbling,
    ),
    "learn": _Stage(
        is_done=lambda run: stages.has_learned(run) and stages.has_modelled(run),
        do=lambda run: stages.learn(run),
        files=_files_of_learning,
    ),
    "evaluate": _Stage(
        is_done=lambda run: stages.has_evaluated(run),
        do=lambda run: stages.evaluate(run),
        files=lambda donor, run: [],  # it is of one run alone
    ),
}
