"""The experiment: everything that decides what a run does, as one tree of settings.

A field's type says what it may be; pydantic checks it whenever settings are made. Every field has a
default except what only a user can know: the robot, its skins and what touches them.
"""

import dataclasses
import typing
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator
from pydantic.dataclasses import dataclass

from selftouch_drake.experiment.errors import Mistake, closest, require, shown
from selftouch_drake.experiment.receptor_files import ReceptorTable, read_receptors
from selftouch_drake.randomness import random_stream

# Dimensions that each shape needs, in metres. `collision` and `visual` stand for the geometry of
# the link in the robot's model, `receptors` for the convex hull of receptors from a file.
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
    "receptors": (),
}
ShapeMetric = Literal["learned", "sensorimotor", "motor", "literal"]
SHAPE_METRICS = typing.get_args(ShapeMetric)
# Fields without a meaning, by the field that says what the body is.
_OF_ROBOT = ("robot", "skins", "touching", "joints", "changes")
WITHOUT = {
    "robot": ("python", "gymnasium", "imported"),
    "python": (*_OF_ROBOT, "gymnasium", "imported"),
    "gymnasium": (*_OF_ROBOT, "python", "imported"),
    "imported": (*_OF_ROBOT, "execution", "evaluation", "python", "gymnasium"),
}
# The field that may stand for all settings of its kind, as in `surface: collision`.
_ALONE = {"SurfaceSettings": "shape", "ReadingSettings": "mode", "ReceptorFile": "file"}


def _number(value: Any) -> Any:
    """A number that YAML 1.1 reads as text, such as 3e4."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _or_off(value: Any) -> Any:
    """The word `off`, which YAML 1.1 reads as false."""
    return "off" if value is False else value


def that(valid: Callable[[Any], bool], remedy: str) -> AfterValidator:
    """A check of one field; the remedy says what to give instead."""

    def check(value: Any) -> Any:
        require(valid(value), "", value, remedy)
        return value

    return AfterValidator(check)


def _is_name(text: str) -> bool:
    return len(text) < 100 and text.replace("-", "_").isidentifier()


def is_printable(text: str) -> bool:
    """Whether a text is one line that can be shown."""
    return text != "" and text.isprintable()


def _are_different(entries: list) -> bool:
    return len({*entries}) == len(entries)


Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Whole = Annotated[int, Field(strict=True, lt=2**63)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False), BeforeValidator(_number)]
Positive = Annotated[Number, Field(gt=0)]
Length = Annotated[Number, that(lambda value: value > 0, "give metres above 0")]
Share = Annotated[Number, Field(ge=0, le=0.9)]
_PAIRS = that(lambda pairs: all(len(pair) == 2 for pair in pairs), "give pairs, as [[3, 7]]")
_THREE = that(lambda value: len(value) == 3, "give three numbers")
_JOINTS = that(lambda joints: joints and _are_different(joints), "name joints, each once, or null")
Triple = Annotated[list[Number], _THREE]
# A name becomes a key of files and a word of commands.
Name = Annotated[Text, that(_is_name, "use letters, digits and underscores")]
Printable = Annotated[Text, that(is_printable, "give a printable name")]


@dataclass(
    # A field that Python cannot name, such as `class`, has an alias.
    config=ConfigDict(extra="forbid", populate_by_name=True),
    kw_only=True,
    slots=True,
    frozen=True,
)
class Settings:
    """What all settings share: short forms are spelled out, and unknown keys are refused."""

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, fields: Any) -> Any:
        if isinstance(fields, str) and (alone := _ALONE.get(cls.__name__)):
            return {alone: fields}
        known = [entry.name.rstrip("_") for entry in dataclasses.fields(cls)]
        for key in fields if isinstance(fields, Mapping) else ():
            if key not in known:
                text = shown(key).strip("'")
                hint = closest(text, known) or f"known are {', '.join(known)}"
                raise Mistake(text, f"unknown key {{path}}; {hint}")
        return fields


@dataclass(kw_only=True, slots=True, frozen=True)
class RobotSettings(Settings):
    """The robot, as Drake loads it."""

    # Drake model directives; the models inside are URDF, SDFormat or MJCF. A package:// URI or a
    # path, relative to the experiment's file.
    directives: Text = ""
    # Folders of package:// URIs, by name. `{prefix}` stands for Python's prefix (sys.prefix), where
    # wheels put shared data.
    packages: dict[Name, Text] = field(default_factory=dict)
    # Names of the joints that move; null for all. Other joints stay at their default position.
    joints: Annotated[list[Text], _JOINTS] | None = None
    # Metres by which rigid parts may overlap before a posture counts as impossible.
    collision_depth: Annotated[Number, Field(ge=0, le=1)] = 0.005


@dataclass(kw_only=True, slots=True, frozen=True)
class SurfaceSettings(Settings):
    """A closed surface in the frame of the link that wears it."""

    # One of SHAPES. Only the dimensions of that shape are given, in metres.
    shape: Text
    radius: Length | None = None
    side: Length | None = None
    major_radius: Length | None = None
    minor_radius: Length | None = None
    height: Length | None = None
    # Of a capsule: between the centres of its two caps.
    length: Length | None = None
    semi_axes: Annotated[list[Length], _THREE] | None = None
    # A closed surface (.obj, .stl, .ply); a path relative to the experiment's file.
    mesh: Annotated[Text, that(is_printable, "give the path of a mesh file")] | None = None
    # Metres per unit of the mesh file.
    scale: Positive = 1.0
    # Pose in the link's frame: metres, and degrees of roll, pitch and yaw.
    translation: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy_deg: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Metres, edge length of the skin's triangles: finer is rounder, and contact takes longer.
    resolution: Annotated[Number, Field(ge=0.002, le=0.1)] = 0.03

    @model_validator(mode="before")
    @classmethod
    def _spelled_out(cls, surface: Any) -> Any:
        """Expands the short form `{mesh: file}` to a mapping with a shape."""
        if isinstance(surface, Mapping) and "shape" not in surface and "mesh" in surface:
            return {"shape": "mesh", **surface}
        return surface

    @model_validator(mode="after")
    def _has_the_dimensions_of_its_shape(self) -> Self:
        remedy = closest(self.shape, SHAPES) or f"choose one of {', '.join(SHAPES)}"
        require(self.shape in SHAPES, "shape", self.shape, remedy)
        needed = SHAPES[self.shape]
        takes = f"takes {', '.join(needed)}" if needed else "takes no dimension"
        for name in sorted({name for names in SHAPES.values() for name in names}):
            value = getattr(self, name)
            if name in needed:
                require(value is not None, name, value, f"shape {self.shape} needs it")
            else:
                require(value is None, name, value, f"shape {self.shape} {takes}; leave it out")
        return self


@dataclass(kw_only=True, slots=True, frozen=True)
class Imperfections(Settings):
    """Imperfections of a real skin, applied in this order; by default none.

    Noise depends on the seed and on the motor configuration: the same configuration always has the
    same noise.
    """

    # Share of each reading that leaks to the receptors whose fields overlap with its own.
    cross_talk: Share = 0.0
    # Standard deviation of a reading's error, as a share of the reading.
    multiplicative_noise: Annotated[Number, Field(ge=0, le=1)] = 0.0
    # N, standard deviation of the error of every reading, touched or not. A firm reading is 1 to
    # 3 N.
    additive_noise: Annotated[Number, Field(ge=0, le=10)] = 0.0
    # N, the largest reading of a receptor; null for no limit.
    saturation: Annotated[Number, Field(ge=0.001, le=1000)] | None = None
    # N, step of the readings, as from an analogue-to-digital converter; 0 for none.
    quantisation: Annotated[Number, Field(ge=0, le=10)] = 0.0
    # Share of receptors that never read anything; the seed decides which.
    dead: Share = 0.0
    # N, the agent ignores smaller readings. Null is six standard deviations of the additive noise,
    # with one false touch in 500,000 configurations; with five, it is one in 1,700.
    threshold: Annotated[Number, Field(ge=0, le=100)] | None = None
    # Seconds from touch to reading; has an effect under dynamics only.
    delay: Annotated[Number, Field(ge=0, le=1)] = 0.0


@dataclass(kw_only=True, slots=True, frozen=True)
class ReadingSettings(Settings):
    """What a skin reports of the force on each receptor."""

    # `pressure`: the force. `binary`: whether it reaches a threshold. `counts`: whole numbers, as
    # of an analogue-to-digital converter. `centre`: force and centre of pressure of each group of
    # receptors, in three readings.
    mode: Literal["pressure", "binary", "counts", "centre"] = "pressure"
    # N, with `binary`: the force that switches a receptor on.
    threshold: Positive | None = None
    # N, with `binary`: how far the force falls below the threshold before a receptor that is on
    # switches off. Under dynamics only: kinematic postures are approached from no touch.
    hysteresis: Annotated[Number, Field(ge=0)] = 0.0
    # With `counts`: number of bits, and the force in N at which they are exhausted.
    bits: Annotated[Whole, Field(ge=1, le=16)] | None = None
    full_scale: Positive | None = None

    @model_validator(mode="after")
    def _has_what_its_mode_needs(self) -> Self:
        for name, mode in (("threshold", "binary"), ("bits", "counts"), ("full_scale", "counts")):
            value = getattr(self, name)
            remedy = f"mode {mode} needs it" if self.mode == mode else f"only mode {mode} takes it"
            require((value is not None) == (self.mode == mode), name, value, remedy)
        remedy = "give less than threshold, of mode binary"
        valid = self.hysteresis < (self.threshold or 0) or not self.hysteresis
        require(valid, "hysteresis", self.hysteresis, remedy)
        return self

    @property
    def most(self) -> float:
        """The largest reading; infinite for forces."""
        return 1.0 if self.mode == "binary" else 2.0 ** (self.bits or np.inf) - 1


@dataclass(kw_only=True, slots=True, frozen=True)
class ReceptorFile(Settings):
    """Where the receptors of a skin are, from a file: .csv, .txt, .npz or .pcd."""

    # Places in the frame of the link, one row each, in columns x, y, z; normals in nx, ny, nz, the
    # radius of the field in width, group and name may follow. The path is relative to the
    # experiment's file.
    file: Annotated[Text, that(is_printable, "give the path of a file")]
    # Metres per unit of the file; 0.001 for millimetres.
    scale: Positive = 1.0
    # Of a file with a column part, as `selftouch model --urdf` and `selftouch map` write them: the
    # part whose receptors the skin has. May be left out if there is one part only.
    part: Annotated[Whole, Field(ge=0)] | None = None

    def read(self) -> ReceptorTable:
        """The receptors; raises a ValueError that begins with the file if it cannot be read."""
        return read_receptors(self.file, self.scale, self.part)


@dataclass(kw_only=True, slots=True, frozen=True)
class Skin(Settings):
    """A soft tactile skin on one link, moving or not."""

    # The link that wears it: Drake's scoped name, or the bare name if it is unique.
    link: Annotated[Text, that(bool, "give the link that wears the skin")]
    surface: SurfaceSettings
    # Metres, from the outer face inwards.
    thickness: Positive = 0.03
    # Number of receptors; the paper uses 20 to 200 on one body. By default 100, or as many as there
    # are in the file, and so the resolved experiment has it.
    num_receptors: Annotated[Whole, Field(ge=4)] = None  # type: ignore[assignment]
    # Receptors where they are, instead of spread evenly.
    receptors: ReceptorFile | None = None
    # Pa. Soft skin keeps contact forces at a few newtons; 1e6 gives hundreds.
    hydroelastic_modulus: Positive = 3.0e4
    # 0 for an even layout. At u, receptors on one side of the skin are 1 / (1 - u) times as far
    # apart as on the other. The seed decides which side.
    unevenness: Share = 0.0
    # Radius of the receptive fields, as a multiple of the smallest at which three fields overlap
    # everywhere; of a file without widths, at which typical fields reach their third neighbour.
    # Below 1 there are gaps between the fields, where nothing is felt.
    field_width: Annotated[Number, Field(ge=0.2, le=3)] = 1.0
    imperfections: Imperfections = field(default_factory=Imperfections)
    # What is reported of the forces, after imperfections.
    reading: ReadingSettings = field(default_factory=ReadingSettings)

    @model_validator(mode="after")
    def _has_a_number(self) -> Self:
        if self.num_receptors is None:
            number = 100
            if self.receptors is not None:
                try:
                    number = self.receptors.read().num_readings(self.reading.mode == "centre")
                except ValueError as error:
                    raise Mistake("receptors", f"{{path}} {error}") from None
            object.__setattr__(self, "num_receptors", number)
        if self.receptors is None:
            shape, remedy = self.surface.shape, "give receptors a file, or another shape"
            require(shape != "receptors", "surface.shape", shape, remedy)
            number, mode = self.num_receptors, self.reading.mode
            require(number <= 10_000, "num_receptors", number, "give at most 10000")
            require(mode != "centre", "reading.mode", mode, "give receptors a file with groups")
        return self


@dataclass(kw_only=True, slots=True, frozen=True)
class ToucherSettings(Settings):
    """Something that presses skins: a ball at a frame, or a link's own geometry."""

    # Frame whose origin is the centre of a rigid ball, and the radius of that ball in metres.
    frame: Text | None = None
    radius: Length | None = None
    # A link: its skin if it wears one; otherwise its own collision geometry, as a rigid body.
    link: Text | None = None

    @model_validator(mode="after")
    def _is_ball_or_link(self) -> Self:
        remedy = "give frame and radius for a ball, or link for a link's own geometry"
        kinds = (self.frame is not None) + (self.link is not None)
        require(kinds == 1, "", dataclasses.asdict(self), remedy)
        ball = self.frame is not None
        require(ball == (self.radius is not None), "radius", self.radius, remedy)
        return self


@dataclass(kw_only=True, slots=True, frozen=True)
class JointSettings(Settings):
    """How well the agent knows its motor configuration; by default exactly."""

    # Rad or m, standard deviation of the error in each remembered joint position.
    noise: Annotated[Number, Field(ge=0, le=1)] = 0.0
    # Rad or m, standard deviation of a constant offset of each joint that appears before plans are
    # executed, as when an encoder slips. An offset from the beginning would change nothing, because
    # the agent never knows true angles.
    offset: Annotated[Number, Field(ge=0, le=1)] = 0.0


@dataclass(kw_only=True, slots=True, frozen=True)
class Babbling(Settings):
    """How the robot moves through motor space, and how many touches are kept."""

    # `random`: a random walk. `active`: the agent learns while it moves, and goes where it knows
    # least; see docs/exploration.md.
    strategy: Literal["random", "active"] = "random"
    # What the active agent seeks: `receptors` that seldom felt anything, and poor links; or
    # `postures` at the limits of many joints, where parts of a body meet; see docs/babybench.md.
    seek: Literal["receptors", "postures"] = "receptors"
    # `kinematic`: positions are set and contact is evaluated. `dynamic`: joint controllers follow
    # the walk under gravity, torque limits and contact forces; slower and more realistic.
    mode: Literal["kinematic", "dynamic"] = "kinematic"
    # Number of touches to keep; the paper's limit is one million.
    num_samples: Annotated[Whole, Field(ge=1, le=1_000_000_000)] = 100_000
    # Rad per step, standard deviation of the velocity of a revolute joint. A sliding joint moves
    # the same share of its range as a revolute joint moves of a full turn.
    step_size: Positive = 0.15
    # Share of the velocity kept from step to step: 0 is Brownian, near 1 is ballistic.
    persistence: Annotated[Number, Field(ge=0, lt=1)] = 0.9
    # Seconds per step, in dynamic mode.
    step_duration: Positive = 0.1
    # Whether a robot in dynamic mode may be put at rest where a walk or a round begins, as only a
    # simulation can; if not, it travels there.
    jumps: Flag = True
    # Hours of the robot's own time after which babbling ends, with the touches that it has by then;
    # for bodies that have a time of their own. Null for no limit.
    robot_hours: Positive | None = None
    # Number of touches of one walk, which is one shard of the store; with `active`, the most.
    walk_size: Annotated[Whole, Field(ge=1, le=100_000)] = 10_000

    @model_validator(mode="after")
    def _seeks_only_if_active(self) -> Self:
        seeks = self.strategy == "active" or self.seek == "receptors"
        require(seeks, "seek", self.seek, "only strategy: active seeks anything; set it too")
        return self


@dataclass(kw_only=True, slots=True, frozen=True)
class Representation(Settings):
    """The quotient representation that is learned from the experience."""

    # Target sensations K, up to 1000 as in the paper.
    num_targets: Annotated[Whole, Field(ge=50)] = 300
    # Most motor configurations kept in one motor kernel set.
    max_kernel_size: Annotated[Whole, Field(ge=2)] = 1000
    # The shape metric from which the body is recovered; one of SHAPE_METRICS.
    metric: ShapeMetric = "learned"
    # Whether the agent asks if each of its joints turns or slides something rigid: `auto` asks,
    # `off` does not. The answer stands beside the representation, which is the same either way.
    body_model: Annotated[Literal["auto", "off"], BeforeValidator(_or_off)] = "auto"


@dataclass(kw_only=True, slots=True, frozen=True)
class Planning(Settings):
    """From a route on the quotient graph to a smooth path in motor space."""

    # Path length between knots of the smoothing spline, in mu; larger is smoother.
    knot_spacing: Positive = 0.135
    # What a route keeps short: the path on the `body`, or the motion of the `joints`.
    prefer: Literal["body", "joints"] = "body"


@dataclass(kw_only=True, slots=True, frozen=True)
class ExecutionSettings(Settings):
    """The dynamic world in which plans are executed."""

    # Seconds, discrete time step of the plant.
    time_step: Positive = 0.005
    # Gains of the joint controllers: N·m/rad and N·m·s/rad, or N/m and N·s/m.
    stiffness: Positive = 2000.0
    damping: Positive = 100.0
    # Limits of timed plans, for joints that the model does not limit further: rad/s and rad/s², or
    # m/s and m/s².
    max_velocity: Positive = 1.0
    max_acceleration: Positive = 5.0
    # Most tries of a rehearsal: pairs that still lose contact after six rarely improve.
    max_tries: Annotated[Whole, Field(ge=1)] = 6
    # Whether the robot corrects its motion by what it feels. It first explores the plan slowly.
    touch_servo: Flag = False


@dataclass(kw_only=True, slots=True, frozen=True)
class Evaluation(Settings):
    """How the agent is scored."""

    # Number of random pairs of start and goal sensation that are planned and executed.
    num_pairs: Annotated[Whole, Field(ge=0)] = 20
    # Further shape metrics whose error is reported; null for all. The learned one takes
    # about ten seconds.
    shape_metrics: list[ShapeMetric] | None = None


@dataclass(kw_only=True, slots=True, frozen=True)
class Imported(Settings):
    """Experience that another robot recorded, instead of a robot that Drake loads.

    Nothing is known about the robot except its touches, so nothing can be simulated.
    `selftouch import` fills these fields.
    """

    # The file or folder from which the data was read.
    source: Text = ""
    # SHA-256 of the rows that were kept.
    content: Text = ""
    # Names of the joints, in the order of a motor configuration.
    joints: Annotated[list[Text], that(bool, "name the joints")]
    num_receptors: Annotated[Whole, Field(ge=4)]
    # Limits of the timed plans, one per joint: rad/s and rad/s², or m/s and m/s².
    max_velocity: list[Positive]
    max_acceleration: list[Positive]

    @model_validator(mode="after")
    def _has_limits_of_each_joint(self) -> Self:
        for name in ("max_velocity", "max_acceleration"):
            limits = getattr(self, name)
            valid = len(limits) == len(self.joints)
            require(valid, name, limits, "give a number above 0 for each joint")
        return self


@dataclass(kw_only=True, slots=True, frozen=True)
class PythonSettings(Settings):
    """A body that is a class of your own: a real robot, or another simulator.

    See `selftouch_drake.agent.body.Body` for what it has to offer.
    """

    # The file of the class, relative to the experiment's file.
    file: Annotated[Text, that(is_printable, "give the path of a Python file")]
    # The class in that file.
    class_: Annotated[
        Text, that(str.isidentifier, "give the name of a class"), Field(alias="class")
    ]
    # What the class is made with.
    arguments: dict[Text, Any] = field(default_factory=dict)
    # Seconds after which a call of the body counts as hanging.
    timeout_s: Positive = 60.0


@dataclass(kw_only=True, slots=True, frozen=True)
class GymnasiumSettings(Settings):
    """A body that is a Gymnasium environment; it observes joint positions and touch."""

    # A registered name, as in `my_package:MyEnv-v0`, or a class in a file: `my_env.py:MyEnv`.
    env: Annotated[Text, that(is_printable, "give the name of an environment")]
    # What the environment is made with.
    arguments: dict[Text, Any] = field(default_factory=dict)
    # Where the observation holds joint positions: the key of an entry (`qpos`), numbers of it
    # (`qpos[7:19]`, or `7:19` of an observation that is one array), or a list of numbers.
    joints: Text | list[Whole]
    # Where it holds the readings of the skin, likewise.
    touch: Text | list[Whole]
    # Names of the joints; null for joint_0, joint_1, ...
    joint_names: Annotated[list[Text], _JOINTS] | None = None
    # Limits of the joints, in the units of the observation; null for those of its space.
    lower: list[Number] | None = None
    upper: list[Number] | None = None
    # Limits of motions, per second and per second squared; null for a quarter of each joint's range
    # per second, and four times that per second squared.
    velocity: list[Positive] | None = None
    acceleration: list[Positive] | None = None
    # What an action sets; null to find out. With `none` the body is moved by `set_posture` alone.
    action: Literal["position", "velocity", "torque", "none"] | None = None
    # Seconds per step; null for the environment's own `dt`.
    step_s: Positive | None = None
    # A method of the environment that puts it into a posture `(J,)` and returns the observation, or
    # the name of an option of `reset` that does. With either, the body jumps.
    set_posture: Text | None = None
    reset_option: Text | None = None


@dataclass(kw_only=True, slots=True, frozen=True)
class SkinChange(Settings):
    """A change of one skin. Receptors are numbered from 0 on each skin."""

    # Receptors that die: their numbers, or a share of all, drawn from the seed.
    dead: list[Whole] = field(default_factory=list)
    dead_share: Share = 0.0
    # Receptors that were dead so far and begin to feel.
    new: list[Whole] = field(default_factory=list)
    # Pairs of receptors that swap places in a sensation: their numbers, or a share of all.
    swapped: Annotated[list[list[Whole]], _PAIRS] = field(default_factory=list)
    swapped_share: Annotated[Number, Field(ge=0, le=1)] = 0.0
    # The skin slips on its link: metres, and degrees of roll, pitch and yaw about the link's
    # origin.
    translation: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy_deg: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Factor by which the skin stretches about the link's origin.
    stretch: Annotated[Number, Field(ge=0.5, le=2)] = 1.0

    def require_receptors(self, name: str, num_receptors: int) -> None:
        """Checks that all receptors are among those of the skin; `name` is the path in errors."""
        swapped = [receptor for pair in self.swapped for receptor in pair]
        remedy = f"give different receptors from 0 to {num_receptors - 1}"
        for field_name, those in (("dead", self.dead), ("new", self.new), ("swapped", swapped)):
            valid = _are_different(those) and all(0 <= one < num_receptors for one in those)
            require(valid, f"{name}.{field_name}", getattr(self, field_name), remedy)


@dataclass(kw_only=True, slots=True, frozen=True)
class Change(Settings):
    """A change of the body at one moment of the agent's life; the agent is not informed."""

    # Number of kept touches after which it happens; 0 for a body that is so from birth.
    after: Annotated[Whole, Field(ge=0)] = 0
    skins: dict[Name, SkinChange] = field(default_factory=dict)
    # Shares by which links grow: all that is attached to a link moves away from its joint.
    links: dict[Text, Annotated[Number, Field(ge=-0.5, le=1)]] = field(default_factory=dict)
    # Rad or m by which the zeros of joints shift: the true position is the reading plus this.
    joints: dict[Text, Number] = field(default_factory=dict)
    # Tools that touchers at a frame take in hand: m, where each touches from now on, in that frame.
    # [0, 0, 0] puts it away.
    tools: dict[Name, Triple] = field(default_factory=dict)


@dataclass(kw_only=True, slots=True, frozen=True)
class Experiment(Settings):
    """One experiment: a robot, its skins, what touches them, what is learned and how it is scored.

    A robot is data: there is no default one.
    """

    name: Printable = "unnamed"
    # The only source of randomness; the same seed gives the same bytes.
    seed: Annotated[Whole, Field(ge=0)] = 0
    robot: RobotSettings = field(default_factory=RobotSettings)
    skins: dict[Name, Skin] = field(default_factory=dict)
    touching: dict[Name, ToucherSettings] = field(default_factory=dict)
    joints: JointSettings = field(default_factory=JointSettings)
    babbling: Babbling = field(default_factory=Babbling)
    representation: Representation = field(default_factory=Representation)
    planning: Planning = field(default_factory=Planning)
    execution: ExecutionSettings = field(default_factory=ExecutionSettings)
    evaluation: Evaluation = field(default_factory=Evaluation)
    # Changes of the body during its life, in order of time.
    changes: list[Change] = field(default_factory=list)
    # A body of your own, or a Gymnasium environment, or experience of another robot; with any of
    # these there are no robot, no skins and no touchers.
    python: PythonSettings | None = None
    gymnasium: GymnasiumSettings | None = None
    imported: Imported | None = None

    @property
    def body_from(self) -> str:
        """The field that says what the body is, a key of `WITHOUT`."""
        return next((name for name in WITHOUT["robot"] if getattr(self, name) is not None), "robot")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if (body := self.body_from) != "robot":
            nothing = Experiment()
            for name in WITHOUT[body]:
                value = getattr(self, name)
                remedy = f"the body comes from {body}: leave one of the two out"
                if body == "imported":
                    remedy = "imported experience has no robot: leave it out"
                require(value == getattr(nothing, name), name, value, remedy)
        most, found = self.babbling.num_samples, self.representation.num_targets
        whose = "babbling.num_samples" if self.imported is None else "the number of touches"
        require(found <= most, "representation.num_targets", found, f"give at most {whose}, {most}")
        earliest = 0
        for number, change in enumerate(self.changes):
            name, after = f"changes[{number}]", change.after
            remedy = f"give a number of touches, at least {earliest}: changes are listed in order"
            require(after >= earliest, f"{name}.after", after, remedy)
            earliest = after
            for skin, what in change.skins.items():
                remedy = closest(skin, self.skins) or f"known are {', '.join(self.skins)}"
                require(skin in self.skins, f"{name}.skins.{skin}", skin, remedy)
                what.require_receptors(f"{name}.skins.{skin}", self.skins[skin].num_receptors)
            hands = [toucher for toucher, how in self.touching.items() if how.link is None]
            for toucher, offset in change.tools.items():
                remedy = closest(toucher, hands) or f"those at a frame are {', '.join(hands)}"
                require(toucher in hands, f"{name}.tools.{toucher}", offset, remedy)
        return self

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
    def has_truth(self) -> bool:
        """Whether the experimenter knows what is touched where: Drake does."""
        return self.body_from == "robot"

    @property
    def num_receptors(self) -> int:
        """S, number of receptors of all skins together.

        Raises:
            ValueError: only the body itself knows, because it is no robot that Drake loads.
        """
        if self.imported is not None:
            return self.imported.num_receptors
        if self.body_from != "robot":
            raise ValueError(f"{self.name} is a body from {self.body_from}: ask the body itself")
        return sum(skin.num_receptors for skin in self.skins.values())

    def random_stream(self, purpose: str, *index: int) -> np.random.SeedSequence:
        """As `selftouch_drake.randomness.random_stream`, from the experiment's seed."""
        return random_stream(self.seed, purpose, *index)
