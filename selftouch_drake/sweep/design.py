"""The sweep file: which experiments, which fields vary, which seeds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from selftouch_drake.experiment import (
    Experiment,
    closest,
    dump_experiment,
    load_experiment,
    merged,
    parse_fields,
    shown,
)
from selftouch_drake.resources import SWEEPS
from selftouch_drake.run.naming import leaves

KEYS = ("name", "experiments", "set", "seeds", "grid", "each", "cases")
# A typing error should not start a month of computing.
MOST_RUNS = 2000


class SweepError(ValueError):
    """A user's mistake in a sweep file: its text names the key, the value and the remedy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Experiments to run, each once.

    Attributes:
        name: of the sweep.
        experiments: all of them, seeds and varied fields resolved; no two alike.
        fields: names of the fields that vary, dotted, as in `skins.body.num_receptors`.
    """

    name: str
    experiments: tuple[Experiment, ...]
    fields: tuple[str, ...]


def shipped_sweeps() -> list[str]:
    """The names of the sweeps that come with the package."""
    return sorted(path.stem for path in SWEEPS.glob("*.yaml"))


def load_sweep(source: str | Path) -> Sweep:
    """Loads a shipped sweep by name, or a sweep file by path, and checks every experiment in it.

    The file is a mapping of

    - `name`: of the sweep; by default the file's own;
    - `experiments`: names of shipped experiments or paths, which start at the file;
    - `set`: fields laid over each of them;
    - `seeds`: a list;
    - `grid`: dotted fields and lists of values, for which every combination is run;
    - `each`: the same, but each field varies alone, while the others stay as they are;
    - `cases`: a list of mappings of fields, each laid over the experiment.

    Raises:
        SweepError: the file is not such a mapping.
        ExperimentError: an experiment in it is wrong.
    """
    path = _find(source)
    try:
        fields = parse_fields(path.read_bytes(), what=f"sweep {path}")
        return _sweep(fields, path)
    except RecursionError:
        raise SweepError(f"sweep {path} contains itself; leave out the alias") from None


def _find(source: str | Path) -> Path:
    for path in (SWEEPS / f"{source}.yaml", Path(source)):
        try:
            if path.is_file():
                return path
        except (OSError, ValueError):  # too long for a file, or with a null character
            continue
    names = shipped_sweeps()
    hint = closest(str(source), names) or f"shipped are {', '.join(names)}"
    raise SweepError(f"sweep {shown(str(source))} is neither shipped nor a file; {hint}")


def _sweep(fields: dict[str, Any], path: Path) -> Sweep:
    for key in fields:
        if key not in KEYS:
            hint = closest(str(key)[:100], KEYS) or f"known are {', '.join(KEYS)}"
            raise SweepError(f"sweep {path}: unknown key {shown(key)}; {hint}")
    name = fields.get("name", path.stem)
    if not (isinstance(name, str) and name and name.isprintable()):
        raise SweepError(f"sweep {path}: name is {shown(name)}; give a printable name")
    sources = _list_of(str, "experiments", fields.get("experiments", ["sphere"]), path)
    seeds = _list_of(int, "seeds", fields.get("seeds", [0]), path)
    base = _mapping("set", fields.get("set", {}), path)
    cases = list(_cases(fields, path))
    num_runs = len(sources) * len(seeds) * len(cases)
    if num_runs > MOST_RUNS:
        raise SweepError(f"sweep {path} has {num_runs} runs; give at most {MOST_RUNS}")

    experiments: dict[str, Experiment] = {}
    for seed, case, source in itertools.product(seeds, cases, sources):
        beside = path.parent / source
        overrides = merged(merged(base, case), {"seed": seed})
        if "\0" not in source and len(source) < 1000 and beside.is_file():
            source = str(beside)
        experiment = load_experiment(source, overrides)
        experiments[dump_experiment(experiment)] = experiment
    varied = dict.fromkeys(leaf for case in cases for leaf in leaves(case))
    return Sweep(name=name, experiments=tuple(experiments.values()), fields=tuple(varied))


def _cases(fields: dict[str, Any], path: Path) -> Iterator[dict[str, Any]]:
    """What is laid over the experiments, case by case."""
    grid, each = (_axes(key, fields.get(key, {}), path) for key in ("grid", "each"))
    cases = fields.get("cases", [])
    if not isinstance(cases, list):
        raise SweepError(f"sweep {path}: cases is {shown(cases)}; give a list of mappings")
    if grid or not (each or cases):
        total = 1
        for values in grid.values():
            total *= len(values)
        if total > MOST_RUNS:
            raise SweepError(f"sweep {path} has {total} runs; give at most {MOST_RUNS}")
        for point in itertools.product(*grid.values()):
            yield nested(dict(zip(grid, point, strict=True)))
    for field, values in each.items():
        for value in values:
            yield nested({field: value})
    for number, case in enumerate(cases):
        yield _mapping(f"cases[{number}]", case, path)


def _axes(key: str, axes: Any, path: Path) -> dict[str, list]:
    axes = _mapping(key, axes, path)
    for field, values in axes.items():
        if not isinstance(field, str) or not all(field.split(".")):
            raise SweepError(
                f"sweep {path}: {key} has {shown(field)}; give the name of a field, as in "
                "skins.body.num_receptors"
            )
        if not isinstance(values, list) or not values:
            raise SweepError(
                f"sweep {path}: {key}.{field[:100]} is {shown(values)}; give a list of values"
            )
    return axes


def _mapping(key: str, value: Any, path: Path) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise SweepError(f"sweep {path}: {key} is {shown(value)}; give a mapping of fields")
    return value


def _list_of(kind: type, key: str, values: Any, path: Path) -> list:
    words = {str: "texts", int: "whole numbers"}[kind]
    right = isinstance(values, list) and values
    if not right or any(isinstance(v, bool) or not isinstance(v, kind) for v in values):
        raise SweepError(f"sweep {path}: {key} is {shown(values)}; give a list of {words}")
    return list(dict.fromkeys(values))


def nested(dotted: dict[str, Any]) -> dict[str, Any]:
    """`{"joints.noise": 0.1}` as `{"joints": {"noise": 0.1}}`."""
    result: dict[str, Any] = {}
    for name, value in dotted.items():
        *sections, key = name.split(".")
        leaf: dict[str, Any] = {key: value}
        for section in reversed(sections):
            leaf = {section: leaf}
        result = merged(result, leaf)
    return result


def fields_of(experiment: Experiment) -> dict[str, Any]:
    """All fields of an experiment by their dotted names."""
    return leaves(yaml.safe_load(dump_experiment(experiment)))
