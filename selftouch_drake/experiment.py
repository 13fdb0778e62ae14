"""The experiment: everything that decides what a run does, as one dataclass tree.

Every field except the robot's has a valid default. `load_experiment` fills a tree from a shipped
experiment or a YAML file and checks it; an error says in one line which field is wrong and what to
do.
"""

import contextlib
import dataclasses
import difflib
import math
import reprlib
import sys
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from selftouch_drake.resources import EXPERIMENTS

# Dimensions that each shape needs, in metres. `collision` and `visual` stand for the geometry of
# the link in the robot's model.
SHAPES = {
    "sphere": ("radius",),
    "cube": ("side",),
    "torus": ("major_radius", "minor_radius"),
    "ellipsoid": ("semi_axes",),
    "cylinder": ("radius", "height"),
    "capsule": ("radius", "length"),
    "mesh": ("mesh",),
    "collision": (),
    "visual": (),
}
BABBLING_MODES = ("kinematic", "dynamic")
STRATEGIES = ("random", "active")
SHAPE_METRICS = ("learned", "sensorimotor", "motor", "literal")
# Fields without a meaning if experience is imported, and if it is not.
_WITHOUT_ROBOT = ("robot", "skins", "touching", "joints", "execution", "evaluation", "changes")
_WITHOUT_DATA = ("imported",)
# Purposes of randomness; add a new one at the end, so that the streams of the others do not change.
STREAMS = ("walk", "pairs", "start", "skin", "joints", "explorer", "changes")


class ExperimentError(ValueError):
    """A user's mistake in an experiment: its text names the field, the value and the remedy."""


@dataclass(kw_only=True, slots=True)
class RobotSettings:
    """The robot, as Drake loads it."""

    # Drake model directives; the models inside are URDF, SDFormat or MJCF. A package:// URI or a
    # path, relative to the experiment's file.
    directives: str = ""
    # Folders of package:// URIs, by name. `{prefix}` stands for Python's prefix (sys.prefix), where
    # wheels put shared data.
    packages: dict[str, str] = field(default_factory=dict)
    # Names of the joints that move; null for all. Other joints stay at their default position.
    joints: list[str] | None = None
    # Metres by which rigid parts may overlap before a posture counts as impossible.
    collision_depth: float = 0.005


@dataclass(kw_only=True, slots=True)
class SurfaceSettings:
    """A closed surface in the frame of the link that wears it."""

    # One of SHAPES. Only the dimensions of that shape are given, in metres.
    shape: str = ""
    radius: float | None = None
    side: float | None = None
    major_radius: float | None = None
    minor_radius: float | None = None
    height: float | None = None
    # Of a capsule: between the centres of its two caps.
    length: float | None = None
    semi_axes: list[float] | None = None
    # A closed surface (.obj, .stl, .ply); a path relative to the experiment's file.
    mesh: str | None = None
    # Metres per unit of the mesh file.
    scale: float = 1.0
    # Pose in the link's frame: metres, and degrees of roll, pitch and yaw.
    translation: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Metres, edge length of the skin's triangles: finer is rounder, and contact takes longer.
    resolution: float = 0.03


@dataclass(kw_only=True, slots=True)
class Imperfections:
    """Imperfections of a real skin, applied in this order; by default none.

    Noise depends on the seed and on the motor configuration: the same configuration always has the
    same noise.
    """

    # Share of each reading that leaks to the receptors whose fields overlap with its own.
    cross_talk: float = 0.0
    # Standard deviation of a reading's error, as a share of the reading.
    multiplicative_noise: float = 0.0
    # N, standard deviation of the error of every reading, touched or not. A firm reading is 1 to
    # 3 N.
    additive_noise: float = 0.0
    # N, the largest reading of a receptor; null for no limit.
    saturation: float | None = None
    # N, step of the readings, as from an analogue-to-digital converter; 0 for none.
    quantisation: float = 0.0
    # Share of receptors that never read anything; the seed decides which.
    dead: float = 0.0
    # N, the agent ignores smaller readings. Null is six standard deviations of the additive noise,
    # with one false touch in 500,000 configurations; with five, it is one in 1,700.
    threshold: float | None = None
    # Seconds from touch to reading; has an effect under dynamics only.
    delay: float = 0.0


@dataclass(kw_only=True, slots=True)
class Skin:
    """A soft tactile skin on one link, moving or not."""

    # The link that wears it: Drake's scoped name, or the bare name if it is unique.
    link: str = ""
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    # Metres, from the outer face inwards.
    thickness: float = 0.03
    # Number of receptors; the paper uses 20 to 200 on one body.
    num_receptors: int = 100
    # Pa. Soft skin keeps contact forces at a few newtons; 1e6 gives hundreds.
    hydroelastic_modulus: float = 3.0e4
    # 0 for an even layout. At u, receptors on one side of the skin are 1 / (1 - u) times as far
    # apart as on the other. The seed decides which side.
    unevenness: float = 0.0
    # Radius of the receptive fields, as a multiple of the smallest at which three fields overlap
    # everywhere.
    field_width: float = 1.0
    imperfections: Imperfections = field(default_factory=Imperfections)


@dataclass(kw_only=True, slots=True)
class ToucherSettings:
    """Something that presses skins: a ball at a frame, or a link's own geometry."""

    # Frame whose origin is the centre of a rigid ball, and the radius of that ball in metres.
    frame: str | None = None
    radius: float | None = None
    # A link: its skin if it wears one; otherwise its own collision geometry, as a rigid body.
    link: str | None = None


@dataclass(kw_only=True, slots=True)
class JointSettings:
    """How well the agent knows its motor configuration; by default exactly."""

    # Rad or m, standard deviation of the error in each remembered joint position.
    noise: float = 0.0
    # Rad or m, standard deviation of a constant offset of each joint that appears before plans are
    # executed, as when an encoder slips. An offset from the beginning would change nothing, because
    # the agent never knows true angles.
    offset: float = 0.0


@dataclass(kw_only=True, slots=True)
class Babbling:
    """How the robot moves through motor space, and how many touches are kept."""

    # `random`: a random walk. `active`: the agent learns while it moves, and goes where it knows
    # least; see docs/exploration.md.
    strategy: str = "random"
    # `kinematic`: positions are set and contact is evaluated. `dynamic`: joint controllers follow
    # the walk under gravity, torque limits and contact forces; slower and more realistic.
    mode: str = "kinematic"
    # Number of touches to keep; the paper's limit is one million.
    num_samples: int = 100_000
    # Rad per step, standard deviation of the velocity of a revolute joint. A sliding joint moves
    # the same share of its range as a revolute joint moves of a full turn.
    step_size: float = 0.15
    # Share of the velocity kept from step to step: 0 is Brownian, near 1 is ballistic.
    persistence: float = 0.9
    # Seconds per step, in dynamic mode.
    step_duration: float = 0.1
    # Number of touches of one walk, which is one shard of the store; with `active`, the most.
    walk_size: int = 10_000


@dataclass(kw_only=True, slots=True)
class Representation:
    """The quotient representation that is learned from the experience."""

    # Target sensations K, up to 1000 as in the paper.
    num_targets: int = 300
    # Most motor configurations kept in one motor kernel set.
    max_kernel_size: int = 1000
    # The shape metric from which the body is recovered; one of SHAPE_METRICS.
    metric: str = "learned"


@dataclass(kw_only=True, slots=True)
class Planning:
    """From a route on the quotient graph to a smooth path in motor space."""

    # Path length between knots of the smoothing spline, in rad; larger is smoother.
    knot_spacing: float = 0.135


@dataclass(kw_only=True, slots=True)
class ExecutionSettings:
    """The dynamic world in which plans are executed."""

    # Seconds, discrete time step of the plant.
    time_step: float = 0.005
    # Gains of the joint controllers: N·m/rad and N·m·s/rad, or N/m and N·s/m.
    stiffness: float = 2000.0
    damping: float = 100.0
    # Limits of timed plans, for joints that the model does not limit further: rad/s and rad/s², or
    # m/s and m/s².
    max_velocity: float = 1.0
    max_acceleration: float = 5.0
    # Most tries of a rehearsal: pairs that still lose contact after six rarely improve.
    max_tries: int = 6
    # Whether the robot corrects its motion by what it feels. It first explores the plan slowly.
    touch_servo: bool = False


@dataclass(kw_only=True, slots=True)
class Evaluation:
    """How the agent is scored."""

    # Number of random pairs of start and goal sensation that are planned and executed.
    num_pairs: int = 20
    # Further shape metrics whose error is reported; null for all. The learned one takes
    # about ten seconds.
    shape_metrics: list[str] | None = None


@dataclass(kw_only=True, slots=True)
class Imported:
    """Experience that another robot recorded, instead of a robot that Drake loads.

    Nothing is known about the robot except its touches, so nothing can be simulated.
    `selftouch import` fills these fields.
    """

    # The file or folder from which the data was read.
    source: str = ""
    # SHA-256 of the rows that were kept.
    content: str = ""
    # Names of the joints, in the order of a motor configuration.
    joints: list[str] = field(default_factory=list)
    num_receptors: int = 0
    # Limits of the timed plans, one per joint: rad/s and rad/s², or m/s and m/s².
    max_velocity: list[float] = field(default_factory=list)
    max_acceleration: list[float] = field(default_factory=list)


class ScopedName(str):
    """Drake's name of a link or joint: `model::name` if several models have one of that name."""


@dataclass(kw_only=True, slots=True)
class SkinChange:
    """A change of one skin. Receptors are numbered from 0 on each skin."""

    # Receptors that die: their numbers, or a share of all, drawn from the seed.
    dead: list[int] = field(default_factory=list)
    dead_share: float = 0.0
    # Receptors that were dead so far and begin to feel.
    new: list[int] = field(default_factory=list)
    # Pairs of receptors that swap places in a sensation: their numbers, or a share of all.
    swapped: list[list[int]] = field(default_factory=list)
    swapped_share: float = 0.0
    # The skin slips on its link: metres, and degrees of roll, pitch and yaw about the link's
    # origin.
    translation: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Factor by which the skin stretches about the link's origin.
    stretch: float = 1.0


@dataclass(kw_only=True, slots=True)
class Change:
    """A change of the body at one moment of the agent's life; the agent is not informed."""

    # Number of kept touches after which it happens; 0 for a body that is so from birth.
    after: int = 0
    skins: dict[str, SkinChange] = field(default_factory=dict)
    # Shares by which links grow: all that is attached to a link moves away from its joint.
    links: dict[ScopedName, float] = field(default_factory=dict)
    # Rad or m by which the zeros of joints shift: the true position is the reading plus this.
    joints: dict[ScopedName, float] = field(default_factory=dict)


@dataclass(kw_only=True, slots=True)
class Experiment:
    """One experiment: a robot, its skins, what touches them, what is learned and how it is scored.

    A robot is data: there is no default one.
    """

    name: str = ""
    # The only source of randomness; the same seed gives the same bytes.
    seed: int = 0
    robot: RobotSettings = field(default_factory=RobotSettings)
    skins: dict[str, Skin] = field(default_factory=dict)
    touching: dict[str, ToucherSettings] = field(default_factory=dict)
    joints: JointSettings = field(default_factory=JointSettings)
    babbling: Babbling = field(default_factory=Babbling)
    representation: Representation = field(default_factory=Representation)
    planning: Planning = field(default_factory=Planning)
    execution: ExecutionSettings = field(default_factory=ExecutionSettings)
    evaluation: Evaluation = field(default_factory=Evaluation)
    # Changes of the body during its life, in order of time.
    changes: list[Change] = field(default_factory=list)
    # Experience of another robot; then there are no robot, no skins and no touchers.
    imported: Imported | None = None

    def after(self, num_touches: int) -> "Experiment":
        """An experiment whose body is from birth as this one's is after `num_touches` touches."""
        past = [
            dataclasses.replace(change, after=0)
            for change in self.changes
            if change.after <= num_touches
        ]
        return dataclasses.replace(self, changes=past)

    @property
    def body_changes(self) -> list[Change]:
        """Changes before birth, in order; the world is built with them."""
        return self.after(0).changes

    @property
    def num_receptors(self) -> int:
        """S, number of receptors of all skins together."""
        if self.imported is not None:
            return self.imported.num_receptors
        return sum(skin.num_receptors for skin in self.skins.values())

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
        overrides: a nested mapping of fields to change, as in `{"seed": 1}`; a `surface` is
            replaced as a whole. Relative paths in it start at the working directory.

    Raises:
        ExperimentError: a field is wrong; the text names the field, its value and the remedy.
    """
    path = _find(source)
    fields = parse_fields(path.read_bytes(), what=f"experiment {path}")
    try:
        fields = merged(
            _absolute_paths(path.parent, fields), _absolute_paths(Path.cwd(), dict(overrides or {}))
        )
    except RecursionError:
        raise ExperimentError(f"experiment {path} contains itself; leave out the alias") from None
    return experiment_from_fields({"name": path.stem, **fields})


def parse_overrides(text: str) -> dict[str, Any]:
    """Reads the YAML mapping of a `--set` option."""
    return parse_fields(text, what="--set")


def experiment_from_fields(fields: Mapping[str, Any]) -> Experiment:
    """Makes a checked experiment from a nested mapping; missing fields keep their defaults."""
    experiment = _made(fields, Experiment, prefix="")
    _check_values(experiment)
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
    if isinstance(fields, Mapping):
        fields = {
            name: dataclasses.asdict(skin) if isinstance(skin, Skin) else skin
            for name, skin in fields.items()
        }
    skins = _checked_value(fields, dict[str, Skin], name="skins")
    _require(bool(skins), "skins", skins, "give at least one skin")
    for name, skin in skins.items():
        _check_skin(f"skins.{name}", skin)
    return skins


def dump_experiment(experiment: Experiment) -> str:
    """The complete experiment as YAML text, with defaults, without fields that have no meaning."""
    fields = dataclasses.asdict(experiment)
    for absent in _WITHOUT_DATA if experiment.imported is None else _WITHOUT_ROBOT:
        del fields[absent]
    return yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=100)


def _find(source: str | Path) -> Path:
    for path in (EXPERIMENTS / f"{source}.yaml", Path(source)):
        # A name that is too long for a file raises an error; here it is just not a file.
        with contextlib.suppress(OSError, ValueError):
            if path.is_file():
                return path
    names = shipped_experiments()
    hint = closest(str(source), names) or f"shipped are {', '.join(names)}"
    raise ExperimentError(f"experiment {shown(str(source))} is neither shipped nor a file; {hint}")


def parse_fields(text: str | bytes, *, what: str) -> dict[str, Any]:
    """Reads a YAML mapping; `what` names it in errors.

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


def _absolute_paths(folder: Path, fields: dict[str, Any]) -> dict[str, Any]:
    """The fields with relative paths made absolute, starting at `folder`."""

    def absolute(path: Any) -> Any:
        if not isinstance(path, str) or not path or not path.isprintable():
            return path
        if "://" in path or path.startswith("{prefix}") or Path(path).is_absolute():
            return path
        return str((folder / path).resolve())

    fields = dict(fields)
    robot = fields.get("robot")
    if isinstance(robot, dict):
        robot = dict(robot)
        if "directives" in robot:
            robot["directives"] = absolute(robot["directives"])
        if isinstance(robot.get("packages"), dict):
            robot["packages"] = {k: absolute(v) for k, v in robot["packages"].items()}
        fields["robot"] = robot
    skins = fields.get("skins")
    if isinstance(skins, dict):
        fields["skins"] = {name: _skin_from(skin, absolute) for name, skin in skins.items()}
    return fields


def _skin_from(skin: Any, absolute: Callable[[Any], Any]) -> Any:
    if not isinstance(skin, dict) or not isinstance(skin.get("surface"), dict):
        return skin
    surface = skin["surface"]
    if "mesh" not in surface:
        return skin
    return {**skin, "surface": {**surface, "mesh": absolute(surface["mesh"])}}


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """The fields of `base`, changed by those of `over`, mapping by mapping.

    A `surface` is replaced as a whole, so that another shape needs no nulls.
    """
    result = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict) and key != "surface"
        result[key] = merged(result[key], value) if both else value
    return result


def _made(fields: Any, schema: type, *, prefix: str) -> Any:
    """Makes a dataclass of `schema`; errors name unknown keys and wrong types by full path."""
    if schema is SurfaceSettings:
        fields = _spelled_out(fields)
    if not isinstance(fields, Mapping):
        raise ExperimentError(
            f"{prefix[:-1]} is {shown(fields)}, not a mapping; give a mapping of its fields"
        )
    types = typing.get_type_hints(schema)
    values = {}
    for key, value in fields.items():
        if key not in types:
            text = shown(key).strip("'")
            hint = (
                _first_version(prefix + text)
                or closest(text, types)
                or f"known are {', '.join(types)}"
            )
            raise ExperimentError(f"unknown key {prefix}{text}; {hint}")
        values[key] = _checked_value(value, types[key], name=f"{prefix}{key}")
    return schema(**values)


def _spelled_out(surface: Any) -> Any:
    """Expands the short forms `collision` and `{mesh: file}` to a mapping with a shape."""
    if isinstance(surface, str):
        return {"shape": surface}
    if isinstance(surface, Mapping) and "shape" not in surface and "mesh" in surface:
        return {"shape": "mesh", **surface}
    return surface


def _first_version(key: str) -> str:
    """The remedy for a key of the first version's experiments."""
    if key in ("body", "skin", "end_effector"):
        return (
            "experiments of the first version have it; describe robot, skins and touching instead, "
            "as `selftouch experiments --show cube` does"
        )
    return ""


def closest(text: str, choices: typing.Iterable[str]) -> str:
    """`did you mean ...?` with the choice most similar to a text; empty if none is similar."""
    found = difflib.get_close_matches(text, list(choices), n=1)
    return f"did you mean {found[0]}?" if found else ""


def _checked_value(value: Any, kind: Any, *, name: str) -> Any:
    if type(None) in typing.get_args(kind):
        if value is None:
            return None
        kind = next(arg for arg in typing.get_args(kind) if arg is not type(None))
    if dataclasses.is_dataclass(kind):
        return _made(value, typing.cast(type, kind), prefix=f"{name}.")
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
    if kind in (str, bool) and isinstance(value, kind):
        return value
    if typing.get_origin(kind) is list and isinstance(value, list):
        (item,) = typing.get_args(kind)
        return [_checked_value(entry, item, name=f"{name}[{i}]") for i, entry in enumerate(value)]
    if typing.get_origin(kind) is dict and isinstance(value, Mapping):
        key_kind, item = typing.get_args(kind)
        return {
            _checked_name(key, name, scoped=key_kind is ScopedName): _checked_value(
                entry, item, name=f"{name}.{key}"
            )
            for key, entry in value.items()
        }
    wanted = {
        float: "a finite number",
        int: "a whole number",
        str: "a text",
        bool: "true or false",
    }.get(kind)
    wanted = wanted or ("a mapping by name" if typing.get_origin(kind) is dict else "a list")
    raise ExperimentError(f"{name} is {shown(value)}; give {wanted}")


def _checked_name(key: Any, name: str, *, scoped: bool = False) -> str:
    """Checks a name: it becomes a key of files and a word of commands, unless it is scoped."""
    short = isinstance(key, str) and 0 < len(key) < 100
    if short and (scoped or key.replace("-", "_").isidentifier()):
        return key
    raise ExperimentError(f"{name} has the name {shown(key)}; use letters, digits and underscores")


def shown(value: object) -> str:
    """A value as quoted in errors: on one line, and always short."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 100
    short.maxlevel = 3
    try:
        text = " ".join(short.repr(value).split())
        return text if len(text) <= 150 else f"{text[:150]}..."
    except ValueError:  # Python does not print numbers with many thousand digits
        return "a number of thousands of digits"


def expanded(path: str) -> Path:
    """A path with `{prefix}` replaced by Python's own prefix."""
    return Path(path.replace("{prefix}", sys.prefix))


def _require(valid: bool, name: str, value: object, remedy: str) -> None:
    if not valid:
        raise ExperimentError(f"{name} is {shown(value)}; {remedy}")


def _one_of(name: str, value: str, choices: typing.Iterable[str]) -> None:
    remedy = closest(str(value), choices) or f"choose one of {', '.join(choices)}"
    _require(value in choices, name, value, remedy)


def _check_values(e: Experiment) -> None:
    _require(e.name != "" and e.name.isprintable(), "name", e.name, "give a printable name")
    _require(0 <= e.seed < 2**63, "seed", e.seed, "give a number from 0 to 2^63 - 1")
    if e.imported is None:
        _check_robot(e)
    else:
        _check_imported(e, e.imported)
    for name, value, least, most, words in _ranges(e):
        if value is not None:
            _require(least <= value <= most, name, value, f"give {words}")
    _one_of("babbling.mode", e.babbling.mode, BABBLING_MODES)
    _one_of("babbling.strategy", e.babbling.strategy, STRATEGIES)
    _require(
        e.representation.num_targets <= e.babbling.num_samples,
        "representation.num_targets",
        e.representation.num_targets,
        f"give at most {_samples_of(e)}, {e.babbling.num_samples}",
    )
    _one_of("representation.metric", e.representation.metric, SHAPE_METRICS)
    for number, metric in enumerate(e.evaluation.shape_metrics or []):
        _one_of(f"evaluation.shape_metrics[{number}]", metric, SHAPE_METRICS)


def _samples_of(e: Experiment) -> str:
    return "babbling.num_samples" if e.imported is None else "the number of touches"


def _check_imported(e: Experiment, imported: Imported) -> None:
    """Checks an experiment with imported experience: joints and receptors, but no robot."""
    for name in _WITHOUT_ROBOT:
        value = getattr(e, name)
        remedy = "imported experience has no robot: leave it out"
        _require(value == getattr(Experiment(), name), name, value, remedy)
    names = imported.joints
    _require(bool(names), "imported.joints", names, "name the joints")
    _require(
        imported.num_receptors >= 4,
        "imported.num_receptors",
        imported.num_receptors,
        "give at least 4",
    )
    for name in ("max_velocity", "max_acceleration"):
        limits = getattr(imported, name)
        valid = len(limits) == len(names) and all(limit > 0 for limit in limits)
        _require(valid, f"imported.{name}", limits, "give a number above 0 for each joint")


def _check_robot(e: Experiment) -> None:
    robot = e.robot
    _require(
        robot.directives != "" and robot.directives.isprintable(),
        "robot.directives",
        robot.directives,
        "give the path of Drake model directives (.dmd.yaml)",
    )
    twice = [name for name in robot.joints or [] if (robot.joints or []).count(name) > 1]
    _require(not twice, "robot.joints", robot.joints, f"name {twice[:1]} once")
    _require(robot.joints != [], "robot.joints", [], "name a joint that moves, or give null")
    _require(bool(e.skins), "skins", {}, "give at least one skin")
    _require(bool(e.touching), "touching", {}, "give at least one ball or link that touches")
    for name, skin in e.skins.items():
        _check_skin(f"skins.{name}", skin)
    for name, toucher in e.touching.items():
        _check_toucher(f"touching.{name}", toucher)
    for number, change in enumerate(e.changes):
        before = e.changes[number - 1].after if number else 0
        _check_change(f"changes[{number}]", change, before, e.skins)


def _check_change(name: str, change: Change, before: int, skins: Mapping[str, Skin]) -> None:
    remedy = f"give a number of touches, at least {before}: changes are listed in order of time"
    _require(change.after >= before, f"{name}.after", change.after, remedy)
    for link, share in change.links.items():
        _require(-0.5 <= share <= 1, f"{name}.links.{link}", share, "give a share from -0.5 to 1")
    for skin, what in change.skins.items():
        field_name = f"{name}.skins.{skin}"
        hint = closest(skin, skins) or f"known are {', '.join(skins)}"
        _require(skin in skins, field_name, skin, hint)
        _check_skin_change(field_name, what, skins[skin].num_receptors)


def _check_skin_change(name: str, change: SkinChange, num_receptors: int) -> None:
    pairs = [receptor for pair in change.swapped for receptor in pair]
    for field_name, receptors in (("dead", change.dead), ("new", change.new), ("swapped", pairs)):
        valid = len({*receptors}) == len(receptors) and all(
            0 <= receptor < num_receptors for receptor in receptors
        )
        remedy = f"give different receptors from 0 to {num_receptors - 1}"
        _require(valid, f"{name}.{field_name}", getattr(change, field_name), remedy)
    valid = all(len(pair) == 2 for pair in change.swapped)
    _require(valid, f"{name}.swapped", change.swapped, "give pairs, as [[3, 7], [12, 40]]")
    for field_name, least, most in (
        ("dead_share", 0, 0.9),
        ("swapped_share", 0, 1),
        ("stretch", 0.5, 2),
    ):
        value = getattr(change, field_name)
        _require(least <= value <= most, f"{name}.{field_name}", value, f"give {least} to {most}")
    _check_triples(name, change)


_TINY = sys.float_info.min


def _ranges(e: Experiment) -> Iterator[tuple[str, float | None, float, float, str]]:
    """Name, value, minimum and maximum of every number with a range, and the range in words."""

    def above_zero(name: str, value: float) -> tuple[str, float, float, float, str]:
        return name, value, _TINY, math.inf, "a number above 0"

    yield above_zero("babbling.step_size", e.babbling.step_size)
    yield above_zero("babbling.step_duration", e.babbling.step_duration)
    yield above_zero("planning.knot_spacing", e.planning.knot_spacing)
    yield above_zero("execution.time_step", e.execution.time_step)
    yield above_zero("execution.stiffness", e.execution.stiffness)
    yield above_zero("execution.damping", e.execution.damping)
    yield above_zero("execution.max_velocity", e.execution.max_velocity)
    yield above_zero("execution.max_acceleration", e.execution.max_acceleration)
    for name, value, least, most in (
        ("robot.collision_depth", e.robot.collision_depth, 0.0, 1.0),
        ("joints.noise", e.joints.noise, 0.0, 1.0),
        ("joints.offset", e.joints.offset, 0.0, 1.0),
    ):
        yield name, value, least, most, f"{least:g} to {most:g}"
    below_one = math.nextafter(1.0, 0.0)
    persistence = e.babbling.persistence
    yield "babbling.persistence", persistence, 0.0, below_one, "a share from 0 to below 1"
    for name, count, least, most in (
        ("babbling.num_samples", e.babbling.num_samples, 1, 1_000_000_000),
        ("babbling.walk_size", e.babbling.walk_size, 1, 100_000),
        ("representation.num_targets", e.representation.num_targets, 50, math.inf),
        ("representation.max_kernel_size", e.representation.max_kernel_size, 2, math.inf),
        ("execution.max_tries", e.execution.max_tries, 1, math.inf),
        ("evaluation.num_pairs", e.evaluation.num_pairs, 0, math.inf),
    ):
        words = f"at least {least}" if count < least else f"at most {most}"
        yield name, count, least, most, words


def _check_skin(name: str, skin: Skin) -> None:
    _require(skin.link != "", f"{name}.link", skin.link, "give the link that wears the skin")
    _check_surface(f"{name}.surface", skin.surface)
    flaws = skin.imperfections
    for field_name, value, least, most in (
        ("thickness", skin.thickness, _TINY, math.inf),
        ("hydroelastic_modulus", skin.hydroelastic_modulus, _TINY, math.inf),
        ("num_receptors", skin.num_receptors, 4, 1000),
        ("unevenness", skin.unevenness, 0, 0.9),
        ("field_width", skin.field_width, 1, 3),
        ("imperfections.cross_talk", flaws.cross_talk, 0, 0.9),
        ("imperfections.multiplicative_noise", flaws.multiplicative_noise, 0, 1),
        ("imperfections.additive_noise", flaws.additive_noise, 0, 10),
        ("imperfections.saturation", flaws.saturation, 0.001, 1000),
        ("imperfections.quantisation", flaws.quantisation, 0, 10),
        ("imperfections.dead", flaws.dead, 0, 0.9),
        ("imperfections.threshold", flaws.threshold, 0, 100),
        ("imperfections.delay", flaws.delay, 0, 1),
    ):
        if value is not None:
            words = "a number above 0" if least == _TINY else f"{least} to {most}"
            _require(least <= value <= most, f"{name}.{field_name}", value, f"give {words}")


def _check_surface(name: str, surface: SurfaceSettings) -> None:
    _one_of(f"{name}.shape", surface.shape, SHAPES)
    needed = SHAPES[surface.shape]
    for dimension in sorted({entry for shape in SHAPES.values() for entry in shape}):
        value = getattr(surface, dimension)
        if dimension not in needed:
            takes = f"takes {', '.join(needed)}" if needed else "takes no dimension"
            remedy = f"shape {surface.shape} {takes}; leave it out"
            _require(value is None, f"{name}.{dimension}", value, remedy)
            continue
        _require(value is not None, f"{name}.{dimension}", value, f"shape {surface.shape} needs it")
        if dimension == "mesh":
            valid = value != "" and value.isprintable()
            _require(valid, f"{name}.mesh", value, "give the path of a mesh file")
            continue
        if dimension == "semi_axes":
            _require(len(value) == 3, f"{name}.semi_axes", value, "give three lengths in metres")
        for length in value if isinstance(value, list) else [value]:
            _require(length > 0, f"{name}.{dimension}", value, "give metres above 0")
    remedy = "give 0.002 to 0.1 metres"
    _require(0.002 <= surface.resolution <= 0.1, f"{name}.resolution", surface.resolution, remedy)
    _require(surface.scale > 0, f"{name}.scale", surface.scale, "give metres per unit, above 0")
    _check_triples(name, surface)


def _check_triples(name: str, posed: SurfaceSettings | SkinChange) -> None:
    for part in ("translation", "rpy_deg"):
        value = getattr(posed, part)
        _require(len(value) == 3, f"{name}.{part}", value, "give three numbers")


def _check_toucher(name: str, toucher: ToucherSettings) -> None:
    both = "give frame and radius for a ball, or link for a link's own geometry"
    kinds = (toucher.frame is not None) + (toucher.link is not None)
    _require(kinds == 1, name, dataclasses.asdict(toucher), both)
    ball = toucher.frame is not None
    _require(ball == (toucher.radius is not None), f"{name}.radius", toucher.radius, both)
    if toucher.radius is not None:
        _require(toucher.radius > 0, f"{name}.radius", toucher.radius, "give metres above 0")
