"""Experiments and skins from YAML, and back: files, overrides, paths and repeated keys."""

import contextlib
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter, ValidationError

from selftouch_drake.experiment.errors import ExperimentError, closest, explained, shown
from selftouch_drake.experiment.schema import WITHOUT, Experiment, Name, Skin, is_printable
from selftouch_drake.resources import EXPERIMENTS, shipped

_EXPERIMENT = TypeAdapter(Experiment)
_SKINS = TypeAdapter(dict[Name, Skin])
# What files of robots end in.
_MODELS = (".urdf", ".sdf", ".xml", ".xacro")


def load_experiment(source: str | Path, overrides: Mapping[str, Any] | None = None) -> Experiment:
    """Loads a shipped experiment by name, or a YAML file by path, and checks it.

    Args:
        source: the name of a shipped experiment or the path of a YAML file.
        overrides: a nested mapping of fields to change, as in `{"seed": 1}`; a `surface` is
            replaced as a whole. Relative paths in it start at the working directory.

    Raises:
        ExperimentError: a field is wrong; the text names the field, its value and the remedy.
    """
    path = find_yaml("experiment", source, EXPERIMENTS)
    fields = parse_fields(path.read_bytes(), what=f"experiment {path}")
    try:
        fields = merged(
            _absolute_paths(path.parent, fields), _absolute_paths(Path.cwd(), dict(overrides or {}))
        )
    except RecursionError:
        raise ExperimentError(f"experiment {path} contains itself; leave out the alias") from None
    return experiment_from_fields({"name": path.stem, **fields})


def experiment_from_fields(fields: Mapping[str, Any]) -> Experiment:
    """Makes a checked experiment from a nested mapping; missing fields keep their defaults."""
    try:
        experiment = _EXPERIMENT.validate_python(fields)
    except ValidationError as error:
        raise explained(error) from None
    if experiment.body_from == "robot":
        if not is_printable(directives := experiment.robot.directives):
            raise ExperimentError(
                f"robot.directives is {shown(directives)}; give the path of Drake model directives "
                "(.dmd.yaml), or say what the body is by python or gymnasium"
            )
        for name, what in (("skins", "skin"), ("touching", "ball or link that touches")):
            if not getattr(experiment, name):
                raise ExperimentError(f"{name} is {{}}; give at least one {what}")
    return experiment


def load_skins(path: str | Path) -> dict[str, Skin]:
    """Loads the `skins` of a YAML file, by name, and checks them; other keys are ignored.

    Raises:
        ExperimentError: a field is wrong; the text names the field, its value and the remedy.
    """
    text = yaml_sections(path).get("skins", "")
    fields = parse_fields(text, what=f"skins in {path}")
    return skins_from_fields(_absolute_paths(Path(path).parent.resolve(), fields).get("skins", {}))


def yaml_sections(path: str | Path) -> dict[str, str]:
    """Each top-level entry of a YAML file as YAML text; unknown tags are kept.

    Raises:
        ExperimentError: the file cannot be read, or is not a mapping.
    """
    try:
        root = yaml.compose(Path(path).read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except (OSError, ValueError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise ExperimentError(f"{shown(str(path))} cannot be read as YAML: {reason}") from None
    if not isinstance(root, yaml.MappingNode):
        raise ExperimentError(
            f"{shown(str(path))} is not a mapping; write `skins:` and skins by name"
        )
    return {
        key.value: yaml.serialize(yaml.MappingNode(root.tag, [(key, value)]))
        for key, value in root.value
    }


def skins_from_fields(fields: Any) -> dict[str, Skin]:
    """Makes checked skins from a mapping by name; its values are mappings or skins."""
    try:
        skins = _SKINS.validate_python(fields)
    except ValidationError as error:
        raise explained(error, "skins") from None
    if not skins:
        raise ExperimentError("skins is {}; give at least one skin")
    return skins


def dump_experiment(experiment: Experiment) -> str:
    """The complete experiment as YAML text, with defaults, without fields that have no meaning."""
    fields = dataclasses.asdict(experiment)
    for absent in WITHOUT[experiment.body_from]:
        del fields[absent]
    if experiment.python is not None:
        fields["python"]["class"] = fields["python"].pop("class_")
    return yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=100)


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """The fields of `base`, changed by those of `over`, mapping by mapping.

    A `surface` is replaced as a whole, so that another shape needs no nulls.
    """
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict) and key != "surface"
        result[key] = merged(result[key], value) if both else value
    return result


def parse_fields(text: str | bytes, *, what: str = "--set") -> dict[str, Any]:
    """Reads a YAML mapping, as that of `--set`; `what` names it in errors.

    Raises:
        ExperimentError: it is not YAML, not a mapping, or contains a key twice.
    """
    try:
        fields = yaml.load(text, Loader=_UniqueKeys)
    except RecursionError:
        raise ExperimentError(f"{what} is nested too deeply; give a mapping of fields") from None
    # PyYAML does not catch errors of its constructors, for instance of an invalid date.
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, ArithmeticError) as error:
        problem = " ".join(str(getattr(error, "problem", error)).split())
        raise ExperimentError(f"{what} is not YAML: {problem}") from None
    if fields is None:
        return {}
    if not isinstance(fields, dict):
        raise ExperimentError(
            f"{what} is {shown(fields)}, not a mapping; write for instance {{seed: 1}}"
        )
    return fields


class _UniqueKeys(yaml.SafeLoader):
    """Raises an error for a repeated key; PyYAML would keep the last value."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{shown(key)} is given twice; give it once", key_node.start_mark
                )
            seen.add(key if isinstance(key, str) else None)
        return super().construct_mapping(node, deep)


def find_yaml(what: str, source: str | Path, folder: Path) -> Path:
    """The YAML file that comes with the package in `folder` by name, or any by its path.

    Raises:
        ExperimentError: there is no such file; `what` says of what kind it was to be.
    """
    for path in (folder / f"{source}.yaml", Path(source)):
        if _is_file(path):
            if path.suffix.lower() in _MODELS:
                raise ExperimentError(
                    f"{what} {shown(str(source))} is the model of a robot; write an experiment "
                    "whose robot.directives add it: `selftouch experiments --show cube` prints "
                    "one"
                )
            return path
    if what == "experiment" and _is_file(Path(source, "experiment.yaml")):
        raise ExperimentError(
            f"experiment {shown(str(source))} is a run: `selftouch learn {source}` and `selftouch "
            f"report {source}` take it; to go on with its babbling, give "
            f"{Path(source) / 'experiment.yaml'} --out {source}"
        )
    names = shipped(folder)
    hint = closest(str(source), names) or f"shipped are {', '.join(names)}"
    raise ExperimentError(f"{what} {shown(str(source))} is neither shipped nor a file; {hint}")


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that is too long for one raises no error here."""
    with contextlib.suppress(OSError, ValueError):
        return path.is_file()
    return False


def _absolute_paths(folder: Path, fields: Any, section: str = "") -> Any:
    """The fields with relative paths made absolute, starting at `folder`."""
    if not isinstance(fields, dict) or section == "arguments":
        return fields
    return {
        key: _absolute(folder, value)
        if (key in ("directives", "mesh", "receptors") and isinstance(value, str))
        or section == "packages"
        or (key == "file" and section in ("receptors", "python"))
        or ((section, key) == ("gymnasium", "env") and ".py:" in str(value))
        else _absolute_paths(folder, value, key)
        for key, value in fields.items()
    }


def _absolute(folder: Path, path: Any) -> Any:
    if not isinstance(path, str) or not path or not path.isprintable():
        return path
    if "://" in path or path.startswith("{prefix}") or Path(path).is_absolute():
        return path
    return str((folder / path).resolve())
