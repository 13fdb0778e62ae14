"""The sweep file: which experiments, which fields vary, which seeds."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic.dataclasses import dataclass

from selftouch_drake.experiment import Experiment, ExperimentError, dump_experiment, load_experiment
from selftouch_drake.experiment.errors import explained
from selftouch_drake.experiment.loading import find_yaml, merged, parse_fields
from selftouch_drake.experiment.schema import Printable, Settings, Text, Whole, that
from selftouch_drake.resources import SWEEPS
from selftouch_drake.run.naming import leaves

# A typing error should not start a month of computing.
MOST_RUNS = 2000

_FIELD_NAME = that(lambda name: all(name.split(".")), "use dots, as in skins.body.num_receptors")
_NOT_EMPTY = that(bool, "give one value or more")
# Dotted names of fields, and the values of each.
Axes = dict[Annotated[Text, _FIELD_NAME], Annotated[list[Any], _NOT_EMPTY]]


@dataclass(kw_only=True, slots=True, frozen=True)
class _File(Settings):
    """The content of a sweep file; see `load_sweep`."""

    name: Printable
    experiments: Annotated[list[Text], _NOT_EMPTY] = field(default_factory=lambda: ["sphere"])
    set: dict[Any, Any] = field(default_factory=dict)
    seeds: Annotated[list[Whole], _NOT_EMPTY] = field(default_factory=lambda: [0])
    grid: Axes = field(default_factory=dict)
    each: Axes = field(default_factory=dict)
    cases: list[dict[Any, Any]] = field(default_factory=list)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
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
        ExperimentError: the file is not such a mapping, or an experiment in it is wrong.
    """
    path = find_yaml("sweep", source, SWEEPS)
    fields = parse_fields(path.read_bytes(), what=f"sweep {path}")
    try:
        file = pydantic.TypeAdapter(_File).validate_python({"name": path.stem, **fields})
        return _sweep(file, path)
    except pydantic.ValidationError as error:
        raise ExperimentError(f"sweep {path}: {explained(error)}") from None
    except RecursionError:
        raise ExperimentError(f"sweep {path} contains itself; leave out the alias") from None


def _sweep(file: _File, path: Path) -> Sweep:
    """Resolves the experiments of a sweep file; equal ones are kept once."""
    num_runs = _num_runs(file)
    if num_runs > MOST_RUNS:
        raise ExperimentError(f"sweep {path} has {num_runs} runs; give at most {MOST_RUNS}")

    cases = list(_cases(file))
    experiments: dict[str, Experiment] = {}
    for seed, case, source in itertools.product(file.seeds, cases, file.experiments):
        overrides = merged(merged(file.set, case), {"seed": seed})
        experiment = load_experiment(_beside(path, source), overrides)
        experiments[dump_experiment(experiment)] = experiment
    varied = dict.fromkeys(leaf for case in cases for leaf in leaves(case))
    return Sweep(name=file.name, experiments=tuple(experiments.values()), fields=tuple(varied))


def _num_runs(file: _File) -> int:
    """How many runs a sweep file asks for, equal ones included; none of them is made."""
    num_in_grid = math.prod(len(values) for values in file.grid.values()) if file.grid else 0
    num_alone = sum(len(values) for values in file.each.values())
    num_cases = num_in_grid + num_alone + len(file.cases)
    return max(num_cases, 1) * len(file.experiments) * len(file.seeds)


def _beside(path: Path, source: str) -> str:
    """The path of an experiment's file if it stands beside the sweep's, else `source` as it is."""
    # The system refuses to look for other texts.
    may_be_a_path = "\0" not in source and len(source) < 1000
    file = path.parent / source
    return str(file) if may_be_a_path and file.is_file() else source


def _cases(file: _File) -> Iterator[dict[str, Any]]:
    """What is laid over the experiments, case by case."""
    if file.grid or not (file.each or file.cases):
        for point in itertools.product(*file.grid.values()):
            yield nested(dict(zip(file.grid, point, strict=True)))
    for name, values in file.each.items():
        for value in values:
            yield nested({name: value})
    yield from file.cases


def nested(dotted: dict[str, Any]) -> dict[str, Any]:
    """`{"joints.noise": 0.1}` as `{"joints": {"noise": 0.1}}`."""
    result: dict[str, Any] = {}
    for name, value in dotted.items():
        for key in reversed(name.split(".")):
            value = {key: value}
        result = merged(result, value)
    return result
