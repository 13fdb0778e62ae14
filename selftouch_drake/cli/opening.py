"""How a command comes by its run: it begins one, or opens one that is there."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake.cli.options import BODY, RUN

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from selftouch_drake.experiment import Experiment
    from selftouch_drake.run.directory import RunDirectory


def of_a_run(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the run of a command that writes in it, as `directory`."""

    @functools.wraps(command)
    def opened(run: Path, **options: Any) -> None:
        command(directory=open_to_write(run), **options)

    return RUN(opened)


def in_a_body(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the option of a user's own body to a command, and keeps the touches that it meets."""

    @functools.wraps(command)
    def with_body(directory: "RunDirectory", *given: Any, body: str | None, **options: Any) -> None:
        from selftouch_drake.run.worlds import with_user_body

        with with_user_body(directory, body):
            command(directory, *given, **options)

    return BODY(with_body)


def open_to_write(run: Path) -> "RunDirectory":
    """Opens a run, and keeps other programs from writing in it until the command ends."""
    from selftouch_drake.run.directory import RunDirectory

    directory = RunDirectory.open(run)
    click.get_current_context().with_resource(directory.writing())
    return directory


def require_something_to_show(directory: "RunDirectory", verb: str) -> None:
    """Refuses to record or play an imported run, and says what can be done instead."""
    from selftouch_drake.run.directory import MissingError

    if directory.experiment.imported is not None:
        run = directory.path
        raise MissingError(
            f"{directory.experiment.name} was imported, without a robot to simulate, so there is "
            f"nothing to {verb}: `selftouch report {run}` draws the body that it recovered, "
            f"`selftouch live {run}` lets the agent live through the recording, and "
            f"`selftouch plan {run} --from 0 --to 1` writes a joint trajectory for the robot"
        )


def is_run(experiment: str) -> bool:
    """Whether this is the directory of a run, and no experiment."""
    return (Path(experiment) / "experiment.yaml").is_file()


def load(experiment: str, overrides: dict[str, Any]) -> tuple["Experiment", dict[str, str]]:
    """Loads an experiment, and announces meshes that are converted for Drake.

    Returns the experiment, and the digest of each file that decides its robot.
    """
    from selftouch_drake.experiment import load_experiment
    from selftouch_drake.run.fingerprint import model_digests

    def announce(line: str) -> None:
        click.echo(f"selftouch: {line}", err=True)

    loaded = load_experiment(experiment, overrides)
    return loaded, model_digests(loaded, announce)


def begin(
    experiment: str, out: Path | None, overrides: dict[str, Any], executor: "Executor | None" = None
) -> "RunDirectory":
    """Begins or resumes a run, prints its path, and builds its bodies.

    The workers of an executor get ready to babble.
    """
    from selftouch_drake.run.directory import RunDirectory
    from selftouch_drake.run.executors import InTurn
    from selftouch_drake.run.naming import default_path

    loaded, digests = load(experiment, overrides)
    path = out or default_path(loaded.name, overrides)
    if not (isinstance(executor, InTurn | None) or path.exists()):
        _get_workers_ready(executor, loaded, digests)

    from selftouch_drake.bodies.embodiment import make_bodies
    from selftouch_drake.run.stages import keep_bodies

    bodies = make_bodies(loaded.after(0))  # errors appear before anything is written
    directory = RunDirectory.create(path, loaded)
    click.get_current_context().with_resource(directory.writing())
    keep_bodies(directory, bodies)
    click.echo(f"run: {directory.path}")
    return directory


def _get_workers_ready(
    executor: "Executor", experiment: "Experiment", digests: dict[str, str]
) -> None:
    """Lets two workers load Drake and build the bodies while this process does the same."""
    from selftouch_drake.bodies.embodiment import compile_for_babbling
    from selftouch_drake.run.fingerprint import experience_fingerprint

    fingerprint = experience_fingerprint(experiment, digests)
    for number in range(2):
        executor.submit(compile_for_babbling, experiment.after(0), fingerprint, number)
