"""Makes the body that an experiment names by `python` or `gymnasium`, or a file and a class do."""

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from selftouch_drake.agent.body import BodyError
from selftouch_drake.bodies.checked import CheckedBody, Worker
from selftouch_drake.experiment import Experiment, closest, shown

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


def split_reference(text: str) -> tuple[Path, str] | None:
    """The file and the class of `my_body.py:MyBody`; None if the text is no such reference."""
    file, found, name = text.rpartition(":")
    return (Path(file), name) if found and file.endswith(".py") else None


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
        return [_require_file(Path(experiment.python.file))]
    if experiment.gymnasium is not None and (found := split_reference(experiment.gymnasium.env)):
        return [_require_file(found[0])]
    return []


def load_class(file: Path, name: str) -> type:
    """Loads a class from a file; the file may import others beside it.

    Raises:
        BodyError: the file does not exist, cannot be run, or has no such class.
    """
    key = _loaded_module(file)
    found = getattr(sys.modules[key], name, None)
    if not isinstance(found, type):
        there = vars(sys.modules[key]).items()
        classes = [n for n, one in there if isinstance(one, type) and one.__module__ == key]
        hint = closest(name, classes) or f"it has {', '.join(classes) or 'none'}"
        raise BodyError(f"{file} has no class {shown(name)}; {hint}")
    return found


def _loaded_module(file: Path) -> str:
    """Runs a Python file as a module, once; returns the name of the module."""
    path = _require_file(file).resolve()
    # By its path and content, so that two files with one name do not meet.
    digest = hashlib.sha256(str(path).encode() + path.read_bytes()).hexdigest()[:12]
    key = f"_selftouch_{path.stem}_{digest}"
    if key in sys.modules:
        return key
    spec = importlib.util.spec_from_file_location(key, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[key] = module  # dataclasses and pickles look their module up
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[key]
        if not isinstance(error, (Exception, SystemExit)):
            raise
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise BodyError(f"{file} cannot be run: {reason}; correct it") from error
    return key


def make_instance(kind: type, arguments: Mapping[str, Any]) -> Any:
    """An instance of a class.

    Raises:
        BodyError: the arguments are not those of the class.
    """
    try:
        inspect.signature(kind).bind(**arguments)
    except TypeError as error:
        raise BodyError(
            f"arguments of {kind.__name__} are {shown(dict(arguments))}: {error}; it takes "
            f"{inspect.signature(kind)}"
        ) from None
    except ValueError:
        pass  # no signature is known
    return kind(**arguments)


def _require_file(file: Path) -> Path:
    """The file; a BodyError if there is none."""
    if not file.is_file():
        raise BodyError(f"{shown(str(file))} does not exist; give the path of a Python file")
    return file


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
