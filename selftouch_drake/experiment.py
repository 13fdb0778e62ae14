"""The experiment: everything that decides what a run does, as one dataclass tree.

Every field has a valid default; `load_experiment` fills a tree from a shipped experiment or a YAML
file, checks it, and says in one line which field is wrong and what to do about it.
"""

import contextlib
import dataclasses
import difflib
import math
import reprlib
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from selftouch_drake.resources import EXPERIMENTS

# The dimensions that each shape needs, in metres.
SHAPES = {
    "sphere": ("radius",),
    "cube": ("side",),
    "torus": ("major_radius", "minor_radius"),
    "ellipsoid": ("semi_axes",),
    "cylinder": ("radius", "height"),
    "mesh": ("mesh",),
}
END_EFFECTORS = {"one_finger": 1, "two_fingers": 2, "two_wide_fingers": 2}
BABBLING_MODES = ("kinematic", "dynamic")
METRICS = ("learned", "sensorimotor", "motor", "literal", "revolute_reference")
# Purposes of randomness; a new one goes to the end, so that the others stay as they are.
STREAMS = ("walk", "pairs", "start", "skin", "joints")


class ExperimentError(ValueError):
    """A user's mistake in an experiment: its text names the field, the value and the remedy."""


@dataclass(kw_only=True, slots=True)
class Body:
    """The hollow body, a closed surface centred between the walls it is made of."""

    # One of SHAPES. Only the dimensions of that shape are given.
    shape: str = "sphere"
    # Metres, to the outer face of the skin.
    radius: float | None = None
    side: float | None = None
    major_radius: float | None = None
    minor_radius: float | None = None
    height: float | None = None
    semi_axes: list[float] | None = None
    # A closed surface in metres (.obj, .stl, .ply); a relative path starts at the experiment file.
    mesh: str | None = None
    # Metres, edge length of the skin's triangles: finer is rounder, and slower to touch.
    resolution: float = 0.03


@dataclass(kw_only=True, slots=True)
class Imperfections:
    """What a real skin does to a sensation, in this order; by default nothing.

    Noise is drawn from the seed and the motor configuration: another configuration has other noise.
    """

    # Share of each reading that leaks to the receptors whose fields overlap with its own.
    cross_talk: float = 0.0
    # Standard deviation of a reading's error, as a share of the reading.
    multiplicative_noise: float = 0.0
    # N, standard deviation of a reading's error, touched or not; a firm reading is 1 to 3 N.
    additive_noise: float = 0.0
    # N, the largest reading that a receptor gives; null if there is none.
    saturation: float | None = None
    # N, the step of the readings, as of a converter to numbers; 0 if there is none.
    quantisation: float = 0.0
    # Share of receptors that never read anything; the seed decides which.
    dead: float = 0.0
    # N, the agent's own: smaller readings count as none. Null is six standard deviations of the
    # additive noise, which makes one false touch in 500,000; five make one in 1,700.
    threshold: float | None = None
    # Seconds from touch to reading, where there is time: under dynamics.
    delay: float = 0.0


@dataclass(kw_only=True, slots=True)
class Skin:
    """The soft tactile skin that makes up the body's wall."""

    # Metres, from the outer face to the cavity.
    thickness: float = 0.03
    # Tactile sensors, 20 to 200 as in the paper.
    num_receptors: int = 100
    # Pa. Soft skin keeps contact forces at a few newtons; 1e6 gives hundreds.
    hydroelastic_modulus: float = 3.0e4
    # 0 is an even layout; at u, receptors are 1 / (1 - u) times as far apart on one side of the
    # body as on the other. The seed decides which side.
    unevenness: float = 0.0
    # Radius of the receptive fields, as a multiple of the least with which three overlap
    # everywhere.
    field_width: float = 1.0
    imperfections: Imperfections = field(default_factory=Imperfections)


@dataclass(kw_only=True, slots=True)
class Joints:
    """How well the agent knows its motor configuration; by default exactly."""

    # Rad, standard deviation of the error of each angle that the agent remembers of its babbling.
    noise: float = 0.0
    # Rad, standard deviation of a constant offset of each joint that comes before plans are
    # executed, as when an encoder slips. One from the beginning would change nothing: true angles
    # are never known.
    offset: float = 0.0


@dataclass(kw_only=True, slots=True)
class Babbling:
    """The random walk in motor space, and how much of it is kept."""

    # `kinematic`: positions are set and contact is evaluated. `dynamic`: joint controllers follow
    # the walk under gravity, torque limits and contact forces; slower and more real.
    mode: str = "kinematic"
    # Touching motor configurations to keep; the paper's limit is one million.
    num_samples: int = 100_000
    # Rad a step, standard deviation of the walk's joint velocity.
    step_size: float = 0.15
    # Share of the velocity kept from step to step: 0 is Brownian, near 1 is ballistic.
    persistence: float = 0.9
    # Seconds a step, in dynamic mode: the time that the arm has for it.
    step_duration: float = 0.1
    # Kept configurations in one walk, which is one shard of the store.
    walk_size: int = 10_000


@dataclass(kw_only=True, slots=True)
class Representation:
    """The quotient representation that is learned from the experience."""

    # Target sensations K, up to 1000 as in the paper.
    num_targets: int = 300
    # Motor configurations kept in one motor kernel set.
    max_kernel_size: int = 1000
    # The metric that the embedding is drawn from; METRICS.
    metric: str = "learned"


@dataclass(kw_only=True, slots=True)
class Planning:
    """From a route on the quotient graph to a smooth path in motor space."""

    # Rad of path length between the knots of the smoothing spline.
    knot_spacing: float = 0.15


@dataclass(kw_only=True, slots=True)
class Execution:
    """The dynamic world in which plans are executed."""

    # Seconds, the plant's discrete step.
    time_step: float = 0.005
    # N·m/rad and N·m·s/rad of the joint controllers.
    stiffness: float = 2000.0
    damping: float = 100.0
    # Rad/s and rad/s², limits of the timed plans, every joint.
    max_velocity: float = 1.0
    max_acceleration: float = 5.0
    # Tries of a rehearsal: after six, those pairs that still lose contact seldom get better.
    max_tries: int = 6


@dataclass(kw_only=True, slots=True)
class Evaluation:
    """How the agent is scored."""

    # Random pairs of start and goal sensation that are planned and executed.
    num_pairs: int = 20
    # Metrics whose shape error is told beside that of representation.metric; null is all that are
    # naive. The learned one takes some ten seconds.
    shape_metrics: list[str] | None = None


@dataclass(kw_only=True, slots=True)
class Experiment:
    """One experiment: an agent, its babbling, what it learns and how it is scored."""

    name: str = "sphere"
    # The one source of randomness; the same seed gives the same bytes.
    seed: int = 0
    body: Body = field(default_factory=lambda: Body(shape="sphere", radius=0.25))
    skin: Skin = field(default_factory=Skin)
    # One of END_EFFECTORS; the tips of two fingers are 6 cm apart, of two wide ones 34 cm.
    end_effector: str = "one_finger"
    joints: Joints = field(default_factory=Joints)
    babbling: Babbling = field(default_factory=Babbling)
    representation: Representation = field(default_factory=Representation)
    planning: Planning = field(default_factory=Planning)
    execution: Execution = field(default_factory=Execution)
    evaluation: Evaluation = field(default_factory=Evaluation)

    @property
    def num_fingers(self) -> int:
        """One or two."""
        return END_EFFECTORS[self.end_effector]

    def random_stream(self, purpose: str, *index: int) -> np.random.SeedSequence:
        """An independent stream of randomness for one of `STREAMS`, numbered by `index`."""
        return np.random.SeedSequence(self.seed, spawn_key=(STREAMS.index(purpose), *index))


def shipped_experiments() -> list[str]:
    """The names of the experiments that come with the package."""
    return sorted(path.stem for path in EXPERIMENTS.glob("*.yaml"))


def load_experiment(source: str | Path, overrides: Mapping[str, Any] | None = None) -> Experiment:
    """Loads a shipped experiment by name, or a YAML file by path, and checks it.

    Args:
        source: the name of a shipped experiment or the path of a YAML file.
        overrides: a nested mapping laid over the file, as in `{"skin": {"num_receptors": 50}}`; a
            relative `mesh` in it starts at the working directory.

    Raises:
        ExperimentError: naming the field, its value and the remedy.
    """
    path = _find(source)
    fields = parse_fields(path.read_bytes(), what=f"experiment {path}")
    try:
        fields = merged(
            _mesh_from(path.parent, fields), _mesh_from(Path.cwd(), dict(overrides or {}))
        )
    except RecursionError:
        raise ExperimentError(f"experiment {path} contains itself; leave out the alias") from None
    return experiment_from_fields(fields)


def parse_overrides(text: str) -> dict[str, Any]:
    """Reads the YAML mapping of a `--set` option."""
    return parse_fields(text, what="--set")


def experiment_from_fields(fields: Mapping[str, Any]) -> Experiment:
    """Makes a checked experiment of a nested mapping; absent fields keep their defaults."""
    checked = _checked_fields(fields, Experiment, prefix="")
    experiment = yaml_load_typed(
        schema=Experiment, data=yaml.safe_dump(checked), defaults=_bare_defaults(checked)
    )
    _check_values(experiment)
    return experiment


def dump_experiment(experiment: Experiment) -> str:
    """The resolved experiment as YAML text, every field spelled out."""
    return yaml_dump_typed(experiment, schema=Experiment)


def _find(source: str | Path) -> Path:
    for path in (EXPERIMENTS / f"{source}.yaml", Path(source)):
        # A name that is too long for a file is an error elsewhere, and no file here.
        with contextlib.suppress(OSError):
            if path.is_file():
                return path
    names = shipped_experiments()
    close = difflib.get_close_matches(str(source), names, n=1)
    hint = f"did you mean {close[0]}?" if close else f"shipped are {', '.join(names)}"
    raise ExperimentError(f"experiment {shown(str(source))} is neither shipped nor a file; {hint}")


def parse_fields(text: str | bytes, *, what: str) -> dict[str, Any]:
    """Reads a YAML mapping; `what` names it in errors.

    Raises:
        ExperimentError: it is not YAML, or no mapping.
    """
    try:
        fields = yaml.safe_load(text)
    except RecursionError:
        raise ExperimentError(f"{what} is nested too deeply; give a mapping of fields") from None
    # PyYAML lets the errors of its constructors through: dates, numbers and tags that are none.
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


def _mesh_from(folder: Path, fields: dict[str, Any]) -> dict[str, Any]:
    """The fields with a relative path of a mesh made to start at `folder`."""
    body = fields.get("body")
    if not isinstance(body, dict):
        return fields
    mesh = body.get("mesh")
    if not isinstance(mesh, str) or not mesh.isprintable() or Path(mesh).is_absolute():
        return fields
    return {**fields, "body": {**body, "mesh": str((folder / mesh).resolve())}}


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """The fields of `over` laid over those of `base`, mapping by mapping."""
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


def _checked_fields(fields: Any, schema: type, *, prefix: str) -> dict[str, Any]:
    """Names unknown keys and wrong types by their full path, which the YAML loader does not."""
    if not isinstance(fields, Mapping):
        raise ExperimentError(f"{prefix[:-1]} is {shown(fields)}; give a mapping of its fields")
    types = typing.get_type_hints(schema)
    checked = {}
    for key, value in fields.items():
        if key not in types:
            text = shown(key).strip("'")
            close = difflib.get_close_matches(text, types, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(types)}"
            raise ExperimentError(f"unknown key {prefix}{text}; {hint}")
        if dataclasses.is_dataclass(types[key]):
            checked[key] = _checked_fields(
                value, typing.cast(type, types[key]), prefix=f"{prefix}{key}."
            )
        else:
            checked[key] = _checked_value(value, types[key], name=f"{prefix}{key}")
    return checked


def _checked_value(value: Any, kind: Any, *, name: str) -> Any:
    optional = type(None) in typing.get_args(kind)
    if optional:
        if value is None:
            return None
        kind = next(arg for arg in typing.get_args(kind) if arg is not type(None))
    if kind is float and isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:  # YAML 1.1 reads 3e4 as text
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if math.isfinite(number):
            return number
    if kind is int and isinstance(value, int) and not isinstance(value, bool):
        if abs(value) < 2**63:
            return value
        raise ExperimentError(f"{name} is {shown(value)}; give a whole number below 2^63")
    if kind is str and isinstance(value, str):
        return value
    if typing.get_origin(kind) is list and isinstance(value, list):
        (item,) = typing.get_args(kind)
        return [_checked_value(entry, item, name=f"{name}[{i}]") for i, entry in enumerate(value)]
    wanted = {float: "a finite number", int: "a whole number", str: "a text"}.get(kind, "a list")
    raise ExperimentError(f"{name} is {shown(value)}; give {wanted}")


def shown(value: object) -> str:
    """A value as an error quotes it: on one line, and short whatever it is."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 100
    short.maxlevel = 3
    try:
        text = " ".join(short.repr(value).split())
        return text if len(text) <= 150 else f"{text[:150]}..."
    except ValueError:  # Python does not spell out numbers beyond some thousand digits
        return "a number of thousands of digits"


def _bare_defaults(fields: Mapping[str, Any]) -> Experiment:
    """Defaults without the default body's radius when the file describes a body of its own."""
    return Experiment(body=Body(shape="sphere")) if "body" in fields else Experiment()


def _check_values(experiment: Experiment) -> None:
    def require(valid: bool, name: str, value: object, remedy: str) -> None:
        if not valid:
            raise ExperimentError(f"{name} is {shown(value)}; {remedy}")

    def one_of(name: str, value: str, choices: typing.Iterable[str]) -> None:
        require(value in choices, name, value, f"choose one of {', '.join(choices)}")

    e = experiment
    require(e.name != "" and e.name.isprintable(), "name", e.name, "give a printable name")
    require(0 <= e.seed < 2**63, "seed", e.seed, "give a number from 0 to 2^63 - 1")
    _check_body(e.body, require, one_of)
    one_of("end_effector", e.end_effector, END_EFFECTORS)
    positive = {
        "skin.thickness": e.skin.thickness,
        "skin.hydroelastic_modulus": e.skin.hydroelastic_modulus,
        "babbling.step_size": e.babbling.step_size,
        "babbling.step_duration": e.babbling.step_duration,
        "planning.knot_spacing": e.planning.knot_spacing,
        "execution.time_step": e.execution.time_step,
        "execution.stiffness": e.execution.stiffness,
        "execution.damping": e.execution.damping,
        "execution.max_velocity": e.execution.max_velocity,
        "execution.max_acceleration": e.execution.max_acceleration,
    }
    for name, value in positive.items():
        require(value > 0, name, value, "give a number above 0")
    require(
        20 <= e.skin.num_receptors <= 200,
        "skin.num_receptors",
        e.skin.num_receptors,
        "give 20 to 200",
    )
    _check_imperfections(e, require)
    one_of("babbling.mode", e.babbling.mode, BABBLING_MODES)
    require(
        0 <= e.babbling.persistence < 1,
        "babbling.persistence",
        e.babbling.persistence,
        "give a share from 0 to below 1",
    )
    for name, value, least in (
        ("babbling.num_samples", e.babbling.num_samples, 1),
        ("babbling.walk_size", e.babbling.walk_size, 1),
        ("representation.num_targets", e.representation.num_targets, 50),
        ("representation.max_kernel_size", e.representation.max_kernel_size, 2),
        ("execution.max_tries", e.execution.max_tries, 1),
        ("evaluation.num_pairs", e.evaluation.num_pairs, 0),
    ):
        require(value >= least, name, value, f"give at least {least}")
    for name, value, most in (
        ("babbling.num_samples", e.babbling.num_samples, 1_000_000_000),
        ("babbling.walk_size", e.babbling.walk_size, 100_000),
    ):
        require(value <= most, name, value, f"give at most {most}")
    require(
        e.representation.num_targets <= e.babbling.num_samples,
        "representation.num_targets",
        e.representation.num_targets,
        f"give at most babbling.num_samples, {e.babbling.num_samples}",
    )
    one_of("representation.metric", e.representation.metric, METRICS)
    for number, metric in enumerate(e.evaluation.shape_metrics or []):
        one_of(f"evaluation.shape_metrics[{number}]", metric, METRICS)


def _check_imperfections(experiment: Experiment, require: typing.Callable) -> None:
    skin, flaws, joints = experiment.skin, experiment.skin.imperfections, experiment.joints
    for name, value, least, most in (
        ("skin.unevenness", skin.unevenness, 0, 0.9),
        ("skin.field_width", skin.field_width, 1, 3),
        ("skin.imperfections.cross_talk", flaws.cross_talk, 0, 0.9),
        ("skin.imperfections.multiplicative_noise", flaws.multiplicative_noise, 0, 1),
        ("skin.imperfections.additive_noise", flaws.additive_noise, 0, 10),
        ("skin.imperfections.saturation", flaws.saturation, 0.001, 1000),
        ("skin.imperfections.quantisation", flaws.quantisation, 0, 10),
        ("skin.imperfections.dead", flaws.dead, 0, 0.9),
        ("skin.imperfections.threshold", flaws.threshold, 0, 100),
        ("skin.imperfections.delay", flaws.delay, 0, 1),
        ("joints.noise", joints.noise, 0, 1),
        ("joints.offset", joints.offset, 0, 1),
    ):
        if value is not None:
            require(least <= value <= most, name, value, f"give {least} to {most}")


def _check_body(body: Body, require: typing.Callable, one_of: typing.Callable) -> None:
    one_of("body.shape", body.shape, SHAPES)
    require(
        0.002 <= body.resolution <= 0.1,
        "body.resolution",
        body.resolution,
        "give 0.002 to 0.1 metres",
    )
    needed = SHAPES[body.shape]
    for name in sorted({dimension for shape in SHAPES.values() for dimension in shape}):
        value = getattr(body, name)
        if name not in needed:
            remedy = f"shape {body.shape} takes {', '.join(needed)}; leave it out, or make it null"
            require(value is None, f"body.{name}", value, remedy)
            continue
        require(value is not None, f"body.{name}", value, f"shape {body.shape} needs it")
        if name == "semi_axes":
            require(len(value) == 3, "body.semi_axes", value, "give three lengths in metres")
        if name == "mesh":
            valid = value != "" and value.isprintable()
            require(valid, "body.mesh", value, "give the path of a mesh file")
        for length in value if isinstance(value, list) else [value]:
            if isinstance(length, float):
                require(length > 0, f"body.{name}", value, "give metres above 0")
