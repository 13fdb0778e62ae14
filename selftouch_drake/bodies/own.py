"""Makes the body that an experiment names by `python` or `gymnasium`, or a file and a class do."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from selftouch_drake.agent.body import BodyError
from selftouch_drake.bodies.checked import CheckedBody, Worker
from selftouch_drake.bodies.class_of_file import (
    load_class,
    make_instance,
    require_file,
    split_reference,
)
from selftouch_drake.experiment import Experiment, shown

#: Seconds in which a body must be made: models load, and a robot may have to be homed.
_MADE_IN_S = 300.0


def open_body(experiment: Experiment) -> CheckedBody:
    """The body of an experiment with `python` or `gymnasium`; close it, or use it in a `with`.

    Raises:
        BodyError: it cannot be made, or does not do what a body must.
        ValueError: the experiment has no such body.
    """
    if (own := experiment.python) is not None:
        return _of_class(Path(own.file), own.class_, own.arguments, own.timeout_s)
    if (settings := experiment.gymnasium) is not None:
        from selftouch_drake.bodies.gymnasium import body_from_settings

        return _opened(partial(body_from_settings, settings), f"gymnasium {settings.env}")
    raise ValueError(f"{experiment.name} has a body from {experiment.body_from}; give python")


def open_reference(text: str) -> CheckedBody:
    """The body that `my_body.py:MyBody` names, made without arguments.

    Raises:
        BodyError: the text is no such reference, or as in `open_body`.
    """
    if (reference := split_reference(text)) is None:
        raise BodyError(f"{shown(text)} names no body; give a file and a class: my_body.py:MyBody")
    return _of_class(*reference)


def body_files(experiment: Experiment, announce: Callable[[str], None] | None = None) -> list[Path]:
    """The files that decide the body: those of a robot's model, or the Python file that is named.

    Imported experience is complete: no file decides anything. If meshes were converted for Drake,
    `announce` is called with one line.

    Raises:
        BodyError: a Python file does not exist.
        ExperimentError: a file of a model is not found, or cannot be read.
    """
    if experiment.has_truth:
        # Others need not wait for Drake.
        from selftouch_drake.robot.models import load_model

        robot = experiment.robot
        return list(load_model(robot.directives, robot.packages, announce).files)
    if experiment.python is not None:
        return [require_file(Path(experiment.python.file))]
    if experiment.gymnasium is not None and (found := split_reference(experiment.gymnasium.env)):
        return [require_file(found[0])]
    return []


def _of_class(
    file: Path, name: str, arguments: Mapping[str, Any] | None = None, timeout_s: float = 60.0
) -> CheckedBody:
    """The body that a class in a file makes."""
    make = partial(make_instance, load_class(file, name), arguments or {})
    return _opened(make, name, timeout_s)


def _opened(make: Callable[[], Any], name: str, timeout_s: float = 60.0) -> CheckedBody:
    """Makes a body and checks it; one that fails the checks is closed."""
    worker = Worker()
    body = worker.call(make, f"{name}()", _MADE_IN_S)
    try:
        return CheckedBody(body, name=name, timeout_s=timeout_s, worker=worker)
    except BaseException:
        if callable(close := getattr(body, "close", None)):
            worker.call(close, f"{name}.close", _MADE_IN_S)
        raise
