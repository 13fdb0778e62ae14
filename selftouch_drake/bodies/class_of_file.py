"""Classes that a user names by a file and a name: `my_body.py:MyBody`."""

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from selftouch_drake.agent.body import BodyError
from selftouch_drake.experiment import closest, shown


def split_reference(text: str) -> tuple[Path, str] | None:
    """The file and the class of `my_body.py:MyBody`; None if the text is no such reference."""
    file, found, name = text.rpartition(":")
    return (Path(file), name) if found and file.endswith(".py") else None


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
    path = require_file(file).resolve()
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


def require_file(file: Path) -> Path:
    """The file; a BodyError if there is none."""
    if not file.is_file():
        raise BodyError(f"{shown(str(file))} does not exist; give the path of a Python file")
    return file
