"""Numbers at the top of modules: found in their source, and changed where they are loaded.

A module is loaded with another number in its source, in a process of its own: so the change holds
in default arguments, in constants that follow from it, and in what numba compiles.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.machinery
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.shared.results import ROOT

PACKAGE = "selftouch_drake.agent"
FOLDER = ROOT / "selftouch_drake" / "agent"
#: Decorators of functions that numba compiles, with the numbers that they mention.
COMPILERS = {"njit", "compiled", "inner", "inner_in_any_order"}
#: Series, numbers of files and kinds: no choices.
NO_CHOICES = {"body_model.model", "records", "motions"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A number, or several, at the top of a module; as text `shape.metrics._MOST_UNLIKE`.

    Attributes:
        module: below `selftouch_drake.agent`.
        name: as it is assigned.
        value: as it is.
        is_compiled: whether numba freezes it.
    """

    module: str
    name: str
    value: Any
    is_compiled: bool

    def __str__(self) -> str:
        return f"{self.module}.{self.name}"

    def times(self, factor: float) -> Any:
        """The value times a factor; whole numbers stay whole, and at least 1."""
        return _times(self.value, factor)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_times(one, factor) for one in value)
    if isinstance(value, dict):
        return {key: _times(one, factor) for key, one in value.items()}
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def constants() -> Iterator[Constant]:
    """All constants of the agent that are numbers, tuples of them, or dictionaries to them."""
    for path in sorted(FOLDER.rglob("*.py")):
        module = path.relative_to(FOLDER).with_suffix("").as_posix().replace("/", ".")
        if module in NO_CHOICES:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        frozen = _names_that_numba_freezes(tree)
        for name, node in _assigned(tree):
            value = _number(node)
            if value is not None:
                yield Constant(module=module, name=name, value=value, is_compiled=name in frozen)


def _assigned(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Names in capitals that a module assigns, and what to each."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        for target in targets:
            value = node.value  # type: ignore[attr-defined]
            pairs = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=True))
            for one, held in pairs:
                if isinstance(one, ast.Name) and one.id == one.id.upper() and held is not None:
                    yield one.id, held


def _number(node: ast.expr) -> Any:
    """The value of an expression of numbers alone; None of any other."""
    if any(isinstance(part, ast.Name | ast.Call | ast.Attribute) for part in ast.walk(node)):
        return None
    value = eval(compile(ast.Expression(node), "constant", "eval"))  # only numbers and signs
    held = value if isinstance(value, tuple) else tuple(value.values()) if _is_dict(value) else None
    numbers = (value,) if held is None else held
    nested = [one for part in numbers for one in (part if isinstance(part, tuple) else (part,))]
    known = all(isinstance(one, int | float) and not isinstance(one, bool) for one in nested)
    return value if nested and known else None


def _is_dict(value: Any) -> bool:
    return isinstance(value, dict)


def _names_that_numba_freezes(tree: ast.Module) -> set[str]:
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            decorators = {
                part.id if isinstance(part, ast.Name) else part.attr
                for decorator in node.decorator_list
                for part in ast.walk(decorator)
                if isinstance(part, ast.Name | ast.Attribute)
            }
            if decorators & COMPILERS:
                names |= {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
    return names


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module with another value of one constant."""

    def __init__(self, module: str, name: str, value: Any):
        self._module, self._name, self._value = f"{PACKAGE}.{module}", name, value

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        """The module, if it is the one; then this object loads it."""
        if fullname != self._module:
            return None
        found = importlib.machinery.PathFinder.find_spec(fullname, path)
        return importlib.util.spec_from_file_location(fullname, found.origin, loader=self)

    def create_module(self, spec: Any) -> None:
        """As any module."""

    def exec_module(self, module: ModuleType) -> None:
        """Runs the source with the other value."""
        file = module.__spec__.origin
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
        for name, node in _assigned(tree):
            if name == self._name:
                _replace(tree, node, ast.parse(repr(self._value), mode="eval").body)
        exec(compile(ast.fix_missing_locations(tree), file, "exec"), module.__dict__)


def _replace(tree: ast.Module, old: ast.expr, new: ast.expr) -> None:
    for node in ast.walk(tree):
        for field, held in ast.iter_fields(node):
            if held is old:
                setattr(node, field, ast.copy_location(new, old))
            elif isinstance(held, list) and any(one is old for one in held):
                setattr(node, field, [new if one is old else one for one in held])
