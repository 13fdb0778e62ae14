"""Makes the body that an experiment names by `python` or `gymnasium`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from selftouch_drake.agent.body import BodyError
from selftouch_drake.bodies.checked import CheckedBody, Worker
from selftouch_drake.bodies.own import load_class, make_instance, require_file, split_reference
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
        return open_class(Path(own.file), own.class_, own.arguments, timeout_s=own.timeout_s)
    if (settings := experiment.gymnasium) is not None:
        from selftouch_drake.bodies.gymnasium import body_from_settings

        name = f"gymnasium {settings.env}"
        return _opened(lambda: body_from_settings(settings), name)
    raise ValueError(f"{experiment.name} has a body from {experiment.body_from}; give python")


def open_class(
    file: Path, name: str, arguments: Mapping[str, Any] | None = None, *, timeout_s: float = 60.0
) -> CheckedBody:
    """The body that a class in a file makes.

    Raises:
        BodyError: it cannot be made, or does not do what a body must.
    """
    kind = load_class(file, name)
    return _opened(lambda: make_instance(kind, arguments or {}), name, timeout_s)


def open_reference(text: str) -> CheckedBody:
    """The body that `my_body.py:MyBody` names, made without arguments.

    Raises:
        BodyError: the text is no such reference, or as of `open_class`.
    """
    reference = split_reference(text)
    if reference is None:
        raise BodyError(f"{shown(text)} names no body; give a file and a class: my_body.py:MyBody")
    return open_class(*reference)


def body_files(experiment: Experiment, announce: Callable[[str], None] | None = None) -> list[Path]:
    """The files that decide the body: those of a robot's model, or the Python file that is named.

    Imported experience is complete: no file decides anything.

    Args:
        experiment: which names them.
        announce: called with one line if meshes were converted for Drake.

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
    if experiment.gymnasium is not None:
        reference = split_reference(experiment.gymnasium.env)
        return [require_file(reference[0])] if reference else []
    return []


def _opened(make: Callable[[], Any], name: str, timeout_s: float = 60.0) -> CheckedBody:
    worker = Worker()
    body = worker.call(make, f"{name}()", _MADE_IN_S)
    try:
        return CheckedBody(body, name=name, timeout_s=timeout_s, worker=worker)
    except BaseException:
        if callable(close := getattr(body, "close", None)):
            worker.call(close, f"{name}.close", _MADE_IN_S)
        raise
