import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.experiment import (
    Experiment,
    ExperimentError,
    Skin,
    dump_experiment,
    experiment_from_fields,
    load_experiment,
)
from selftouch_drake.experiment.loading import merged, parse_fields
from selftouch_drake.experiment.schema import SHAPE_METRICS, SHAPES, SurfaceSettings
from selftouch_drake.randomness import STREAMS
from selftouch_drake.resources import EXPERIMENTS, shipped

TOP_FIELDS = (
    "name, seed, robot, skins, touching, joints, babbling, "
    "representation, planning, execution, evaluation, changes, python, gymnasium, imported"
)
SURFACE_FIELDS = (
    "shape, radius, side, major_radius, minor_radius, height, length, semi_axes, mesh, scale, "
    "translation, rpy_deg, resolution"
)
SHIPPED = ", ".join(shipped(EXPERIMENTS))
BALL = {"shape": "sphere", "radius": 0.25}
# The least that an experiment has to say.
LEAST = {
    "name": "least",
    "robot": {"directives": "package://selftouch_drake/one_finger.dmd.yaml"},
    "skins": {"body": {"link": "body", "surface": BALL}},
    "touching": {"tip": {"frame": "fingertip_0", "radius": 0.01}},
}


@pytest.mark.parametrize("name", shipped(EXPERIMENTS))
def test_shipped_experiments_load(name):
    experiment = load_experiment(name)
    assert experiment.name == name
    assert experiment.num_receptors == sum(s.num_receptors for s in experiment.skins.values())


def test_every_robot_of_the_plan_is_shipped():
    hands = ("", "_two_fingers")
    assert set(shipped(EXPERIMENTS)) >= {
        *(f"{shape}{hand}" for shape in ("sphere", "cube", "torus") for hand in hands),
        *("ellipsoid", "cylinder", "double_torus", "sphere_two_wide_fingers"),
        *("turning_body", "gantry", "two_arms"),
    }


def test_a_robot_has_no_default():
    with pytest.raises(ExperimentError) as error:
        experiment_from_fields({"name": "nothing"})
    assert str(error.value) == (
        "robot.directives is ''; give the path of Drake model directives (.dmd.yaml), or say what "
        "the body is by python or gymnasium"
    )


BALL_OR_LINK = "give frame and radius for a ball, or link for a link's own geometry"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sed: 1", "unknown key sed; did you mean seed?"),
        ("colour: red", f"unknown key colour; known are {TOP_FIELDS}"),
        ("1: 2", f"unknown key 1; known are {TOP_FIELDS}"),
        ("end_effector: two_fingers", f"unknown key end_effector; known are {TOP_FIELDS}"),
        (
            "skins: {body: {num_receptor: 50}}",
            "unknown key skins.body.num_receptor; did you mean num_receptors?",
        ),
        (
            "skins: {body: {surface: {shape: cube, colour: red}}}",
            f"unknown key skins.body.surface.colour; known are {SURFACE_FIELDS}",
        ),
        ("seed: one", "seed is 'one'; give a whole number"),
        ("seed: 1.5", "seed is 1.5; give a whole number"),
        ("seed: true", "seed is True; give a whole number"),
        ("seed: null", "seed is None; give a whole number"),
        ("seed: -1", "seed is -1; give at least 0"),
        (
            "seed: 9223372036854775808",
            "seed is 9223372036854775808; give a number below 9.22337e+18",
        ),
        ("name: 7", "name is 7; give a text"),
        ("name: 2026-01-31", "name is datetime.date(2026, 1, 31); give a text"),
        ('name: ""', "name is ''; give a printable name"),
        ('name: "two\\nlines"', "name is 'two\\nlines'; give a printable name"),
        ("skins: 3", "skins is 3; give a mapping by name"),
        ("skins: {body: 3}", "skins.body is 3; give a mapping of its fields"),
        ("skins: {2: {}}", "a name in skins is 2; give a text"),
        (
            "skins: {a b: {}}",
            "a name in skins is 'a b'; use letters, digits and underscores",
        ),
        (
            "skins: {extra: {surface: collision}}",
            "skins.extra.link is missing; `selftouch experiments --show cube` is an example",
        ),
        (
            "skins: {body: {thickness: thick}}",
            "skins.body.thickness is 'thick'; give a finite number",
        ),
        ("skins: {body: {thickness: .nan}}", "skins.body.thickness is nan; give a finite number"),
        ("skins: {body: {thickness: .inf}}", "skins.body.thickness is inf; give a finite number"),
        ("execution: {touch_servo: 1}", "execution.touch_servo is 1; give true or false"),
        ("skins: {body: {thickness: true}}", "skins.body.thickness is True; give a finite number"),
        ("skins: {body: {thickness: 0}}", "skins.body.thickness is 0; give a number above 0"),
        ("skins: {body: {num_receptors: 3}}", "skins.body.num_receptors is 3; give at least 4"),
        (
            "skins: {body: {num_receptors: 10001}}",
            "skins.body.num_receptors is 10001; give at most 10000",
        ),
        (
            "skins: {body: {surface: {shape: pyramid}}}",
            "skins.body.surface.shape is 'pyramid'; choose one of sphere, cube, torus, ellipsoid, "
            "cylinder, capsule, mesh, collision, visual, receptors",
        ),
        (
            "skins: {body: {surface: colision}}",
            "skins.body.surface.shape is 'colision'; did you mean collision?",
        ),
        (
            "skins: {body: {surface: {shape: cube}}}",
            "skins.body.surface.side is None; shape cube needs it",
        ),
        (
            "skins: {body: {surface: {shape: cube, side: 0.4, radius: 0.2}}}",
            "skins.body.surface.radius is 0.2; shape cube takes side; leave it out",
        ),
        (
            "skins: {body: {surface: {shape: collision, radius: 0.2}}}",
            "skins.body.surface.radius is 0.2; shape collision takes no dimension; leave it out",
        ),
        (
            "skins: {body: {surface: {shape: torus, major_radius: 0.2}}}",
            "skins.body.surface.minor_radius is None; shape torus needs it",
        ),
        (
            "skins: {body: {surface: {shape: sphere, radius: -1}}}",
            "skins.body.surface.radius is -1.0; give metres above 0",
        ),
        (
            "skins: {body: {surface: {shape: ellipsoid, semi_axes: 1}}}",
            "skins.body.surface.semi_axes is 1; give a list",
        ),
        (
            "skins: {body: {surface: {shape: ellipsoid, semi_axes: [1, 2]}}}",
            "skins.body.surface.semi_axes is [1.0, 2.0]; give three numbers",
        ),
        (
            "skins: {body: {surface: {shape: ellipsoid, semi_axes: [1, 2, x]}}}",
            "skins.body.surface.semi_axes[2] is 'x'; give a finite number",
        ),
        (
            "skins: {body: {surface: {shape: ellipsoid, semi_axes: [1, 0, 2]}}}",
            "skins.body.surface.semi_axes[1] is 0.0; give metres above 0",
        ),
        (
            "skins: {body: {surface: {shape: mesh}}}",
            "skins.body.surface.mesh is None; shape mesh needs it",
        ),
        (
            "skins: {body: {surface: {mesh: ''}}}",
            "skins.body.surface.mesh is ''; give the path of a mesh file",
        ),
        (
            "skins: {body: {surface: {shape: sphere, radius: 0.2, resolution: 0.5}}}",
            "skins.body.surface.resolution is 0.5; give at most 0.1",
        ),
        (
            "skins: {body: {surface: {shape: sphere, radius: 0.2, translation: [1]}}}",
            "skins.body.surface.translation is [1.0]; give three numbers",
        ),
        (
            "touching: {tip: {frame: null, radius: null}}",
            "touching.tip is {'frame': None, 'link': None, 'radius': None}; " + BALL_OR_LINK,
        ),
        ("touching: {tip: {radius: null}}", f"touching.tip.radius is None; {BALL_OR_LINK}"),
        ("touching: {tip: {radius: 0}}", "touching.tip.radius is 0.0; give metres above 0"),
        (
            "touching: {hand: {link: hand, radius: 0.1}}",
            f"touching.hand.radius is 0.1; {BALL_OR_LINK}",
        ),
        ("robot: {joints: []}", "robot.joints is []; name joints, each once, or null"),
        (
            "robot: {joints: [a, b, a]}",
            "robot.joints is ['a', 'b', 'a']; name joints, each once, or null",
        ),
        ("robot: {collision_depth: -1}", "robot.collision_depth is -1; give at least 0"),
        (
            "robot: {directives: ''}",
            "robot.directives is ''; give the path of Drake model directives (.dmd.yaml), or say "
            "what the body is by python or gymnasium",
        ),
        ("skins: {body: {unevenness: 1}}", "skins.body.unevenness is 1; give at most 0.9"),
        ("skins: {body: {field_width: 0.1}}", "skins.body.field_width is 0.1; give at least 0.2"),
        (
            "skins: {body: {imperfections: {dead: -0.1}}}",
            "skins.body.imperfections.dead is -0.1; give at least 0",
        ),
        (
            "skins: {body: {imperfections: {saturation: 0}}}",
            "skins.body.imperfections.saturation is 0; give at least 0.001",
        ),
        (
            "skins: {body: {imperfections: {additive: 1}}}",
            "unknown key skins.body.imperfections.additive; did you mean additive_noise?",
        ),
        ("joints: {noise: 2}", "joints.noise is 2; give at most 1"),
        ("babbling: {mode: loud}", "babbling.mode is 'loud'; choose one of kinematic, dynamic"),
        (
            "babbling: {persistence: 1}",
            "babbling.persistence is 1; give a number below 1",
        ),
        ("babbling: {walk_size: 0}", "babbling.walk_size is 0; give at least 1"),
        ("evaluation: {num_pairs: -1}", "evaluation.num_pairs is -1; give at least 0"),
        (
            "representation: {num_targets: 300}\nbabbling: {num_samples: 299}",
            "representation.num_targets is 300; give at most babbling.num_samples, 299",
        ),
        (
            "representation: {metric: literall}",
            "representation.metric is 'literall'; did you mean literal?",
        ),
        (
            "babbling: {seek: postures}",
            "babbling.seek is 'postures'; only strategy: active seeks anything; set it too",
        ),
    ],
)
def test_a_mistake_is_named_by_field_value_and_remedy(text, message):
    with pytest.raises(ExperimentError) as error:
        experiment_from_fields(merged(LEAST, parse_fields(text)))
    assert str(error.value) == message


@pytest.mark.parametrize(
    "field",
    [
        "babbling.step_size",
        "babbling.step_duration",
        "planning.knot_spacing",
        "execution.time_step",
        "execution.stiffness",
        "execution.damping",
        "execution.max_velocity",
        "execution.max_acceleration",
    ],
)
def test_what_has_to_be_positive_is_positive(field):
    section, key = field.split(".")
    with pytest.raises(ExperimentError) as error:
        experiment_from_fields(LEAST | {section: {key: -0.5}})
    assert str(error.value) == f"{field} is -0.5; give a number above 0"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2", "--set is not YAML: expected ',' or ']', but got '<stream end>'"),
        ("5", "--set is 5, not a mapping; write for instance {seed: 1}"),
        ("cube", "--set is 'cube', not a mapping; write for instance {seed: 1}"),
        ("&x [*x]", "--set is [[[[...]]]], not a mapping; write for instance {seed: 1}"),
        ("{[1]: 2}", "--set is not YAML: found unhashable key"),
        (
            "name: !!python/name:os.system",
            "--set is not YAML: could not determine a constructor for the tag "
            "'tag:yaml.org,2002:python/name:os.system'",
        ),
        ("seed: !!int x", "--set is not YAML: invalid literal for int() with base 10: 'x'"),
        ("[" * 5000, "--set is nested too deeply; give a mapping of fields"),
    ],
)
def test_overrides_that_are_not_a_mapping_are_refused(text, message):
    with pytest.raises(ExperimentError) as error:
        parse_fields(text)
    assert str(error.value) == message


@pytest.mark.parametrize("text", ["seed: 2026-13-45", "seed: !!bool x", "seed: !!timestamp x"])
def test_what_yaml_itself_stumbles_over_is_not_yaml(text):
    with pytest.raises(ExperimentError, match=r"^--set is not YAML: "):
        parse_fields(text)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("cubee", "did you mean cube?"),
        ("torus_two_finger", "did you mean torus_two_fingers?"),
        ("xyzzy", f"shipped are {SHIPPED}"),
        ("", f"shipped are {SHIPPED}"),
        ("\0", f"shipped are {SHIPPED}"),
    ],
)
def test_a_missing_experiment_is_reported(name, hint):
    with pytest.raises(ExperimentError) as error:
        load_experiment(name)
    assert str(error.value) == f"experiment {name!r} is neither shipped nor a file; {hint}"


def test_a_value_of_any_size_is_reported_in_a_short_line():
    huge = "9" * 100_000
    loads = [
        lambda: experiment_from_fields({"seed": 16**5000}),
        lambda: experiment_from_fields({"seed": huge}),
        lambda: experiment_from_fields({"name": ["x" * 9999] * 9999}),
        lambda: experiment_from_fields({huge: 1}),
        lambda: experiment_from_fields({16**5000: 1}),
        lambda: load_experiment(huge),
    ]
    for load in loads:
        with pytest.raises(ExperimentError) as error:
            load()
        assert len(str(error.value)) < 400


def test_a_file_is_named_by_its_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("seed: [1")
    with pytest.raises(ExperimentError, match=f"^experiment {path} is not YAML: "):
        load_experiment(path)
    path.write_bytes(b"name: \xff\xff")
    with pytest.raises(ExperimentError, match=f"^experiment {path} is not YAML: .*invalid start"):
        load_experiment(path)
    path.write_text("- 1\n")
    with pytest.raises(ExperimentError) as error:
        load_experiment(path)
    assert str(error.value) == (
        f"experiment {path} is [1], not a mapping; write for instance {{seed: 1}}"
    )


def test_a_file_that_contains_itself_is_reported(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("&a {joints: *a}")
    with pytest.raises(ExperimentError) as error:
        load_experiment(path, parse_fields("&b {joints: *b}"))
    assert str(error.value) == f"experiment {path} contains itself; leave out the alias"


def test_a_file_without_a_name_is_called_as_the_file(tmp_path):
    path = tmp_path / "my_robot.yaml"
    fields = {key: value for key, value in LEAST.items() if key != "name"}
    path.write_text(yaml.safe_dump(fields))
    assert load_experiment(path).name == "my_robot"
    path.write_text(yaml.safe_dump(fields | {"name": "another"}))
    assert load_experiment(path).name == "another"


def test_overrides_are_laid_over_the_file_field_by_field():
    changed = load_experiment("cube", parse_fields("{skins: {body: {num_receptors: 50}}}"))
    cube = load_experiment("cube")
    body = dataclasses.replace(cube.skins["body"], num_receptors=50)
    assert changed == dataclasses.replace(cube, skins={"body": body})
    assert changed.skins["body"].surface == SurfaceSettings(shape="cube", side=0.44)


@pytest.mark.parametrize(
    ("text", "surface"),
    [
        ("{shape: sphere, radius: 0.2}", SurfaceSettings(shape="sphere", radius=0.2)),
        ("collision", SurfaceSettings(shape="collision")),
        ("{mesh: /a.obj, scale: 0.001}", SurfaceSettings(shape="mesh", mesh="/a.obj", scale=0.001)),
    ],
)
def test_a_surface_is_replaced_whole(text, surface):
    overrides = parse_fields(f"skins: {{body: {{surface: {text}}}}}")
    assert load_experiment("cube", overrides).skins["body"].surface == surface


def test_paths_start_at_the_experiment_file(tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / "mine.yaml"

    def loaded(directives, packages, mesh):
        robot = {"directives": directives, "packages": packages}
        skins = {"body": {"link": "body", "surface": {"mesh": mesh}}}
        path.write_text(yaml.safe_dump(LEAST | {"robot": robot, "skins": skins}))
        e = load_experiment(path)
        return e.robot.directives, e.robot.packages["mine"], e.skins["body"].surface.mesh

    assert loaded("me.dmd.yaml", {"mine": ".."}, "../duck.obj") == (
        str(tmp_path / "sub" / "me.dmd.yaml"),
        str(tmp_path),
        str(tmp_path / "duck.obj"),
    )
    there = ("package://mine/me.dmd.yaml", "{prefix}/share", "/elsewhere/duck.obj")
    assert loaded(there[0], {"mine": there[1]}, there[2]) == there


def test_paths_of_the_command_line_start_where_one_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    overrides = parse_fields(
        "{robot: {directives: me.dmd.yaml}, skins: {body: {surface: {mesh: duck.obj}}}}"
    )
    experiment = load_experiment("double_torus", overrides)
    assert experiment.skins["body"].surface.mesh == str(tmp_path / "duck.obj")
    assert experiment.robot.directives == str(tmp_path / "me.dmd.yaml")


def test_numbers_may_be_written_as_people_do():
    fields = parse_fields(
        "skins: {body: {hydroelastic_modulus: 3e4, thickness: 0.02, num_receptors: 0x20}}"
    )
    assert experiment_from_fields(merged(LEAST, fields)).skins["body"] == Skin(
        link="body",
        surface=SurfaceSettings(**BALL),
        hydroelastic_modulus=30_000.0,
        thickness=0.02,
        num_receptors=32,
    )


def test_streams_of_randomness_are_apart():
    cube = load_experiment("cube")

    def draw(*which, seed=0):
        experiment = dataclasses.replace(cube, seed=seed)
        return np.random.default_rng(experiment.random_stream(*which)).integers(2**62)

    draws = [draw(purpose, *index) for purpose in STREAMS for index in ((), (0,), (1,), (0, 1))]
    assert len({*draws, draw("walk", seed=1)}) == len(draws) + 1
    assert draw("walk", 1) == draw("walk", 1)


lengths = st.floats(1e-6, 1e6)
dimensions = {
    "semi_axes": st.lists(lengths, min_size=3, max_size=3),
    "mesh": st.just("/some where/ключ.obj"),
}
# Without the shape that needs a file of receptors.
surfaces = st.sampled_from(sorted(set(SHAPES) - {"receptors"})).flatmap(
    lambda shape: st.fixed_dictionaries(
        {"shape": st.just(shape)} | {d: dimensions.get(d, lengths) for d in SHAPES[shape]},
        optional={"resolution": st.floats(0.002, 0.1)},
    )
)
names = st.from_regex(r"[a-z][a-z0-9_-]{0,8}", fullmatch=True)
link_names = st.text("abc:_/ é", min_size=1, max_size=8)
skins = st.fixed_dictionaries(
    {"link": link_names, "surface": surfaces},
    optional={"num_receptors": st.integers(4, 1000), "thickness": lengths},
)
touchers = st.fixed_dictionaries({"frame": link_names, "radius": lengths}) | st.fixed_dictionaries(
    {"link": link_names}
)
valid_fields = st.fixed_dictionaries(
    {
        "name": st.text(min_size=1).filter(str.isprintable),
        "robot": st.fixed_dictionaries(
            {"directives": st.just("package://selftouch_drake/one_finger.dmd.yaml")},
            optional={"joints": st.lists(link_names, min_size=1, max_size=3, unique=True)},
        ),
        "skins": st.dictionaries(names, skins, min_size=1, max_size=3),
        "touching": st.dictionaries(names, touchers, min_size=1, max_size=3),
    },
    optional={
        "seed": st.integers(0, 2**63 - 1),
        "representation": st.fixed_dictionaries(
            {}, optional={"metric": st.sampled_from(SHAPE_METRICS)}
        ),
        "execution": st.fixed_dictionaries({}, optional={"stiffness": lengths}),
    },
)


def holds(there, fields):
    """Whether everything given is present."""
    if not isinstance(fields, dict):
        return there == fields
    return all(holds(there[name], value) for name, value in fields.items())


@settings(max_examples=20, deadline=None)
@given(fields=valid_fields)
def test_what_is_dumped_loads_as_the_same_experiment(fields, tmp_path_factory):
    experiment = experiment_from_fields(fields)
    text = dump_experiment(experiment)
    path = tmp_path_factory.getbasetemp() / "dumped.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_experiment(path) == experiment
    assert dump_experiment(load_experiment(path)) == text
    assert holds(dataclasses.asdict(experiment), fields)


scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from([2**63, -(2**70), 10**400]),
    st.floats(),
    st.text(max_size=8),
    st.binary(max_size=4),
    st.dates(),
    st.datetimes(),
)
known_keys = st.sampled_from(
    sorted(
        {f.name for f in dataclasses.fields(Experiment)}
        | {f.name for f in dataclasses.fields(SurfaceSettings)}
        | {f.name for f in dataclasses.fields(Skin)}
    )
)
junk = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(known_keys | scalars, inner, max_size=4)
    ),
    max_leaves=12,
)


def _loads_or_is_refused(load) -> None:
    try:
        experiment = load()
    except ExperimentError as error:
        message = str(error)
        assert message
        assert "\n" not in message
        message.encode()
    else:
        assert experiment_from_fields(yaml.safe_load(dump_experiment(experiment))) == experiment


@settings(max_examples=20, deadline=None)
@given(fields=junk | st.dictionaries(known_keys, junk))
def test_any_data_loads_or_is_refused(fields):
    _loads_or_is_refused(lambda: experiment_from_fields(fields))


@settings(max_examples=20, deadline=None)
@given(fields=valid_fields, section=known_keys, key=known_keys, value=junk)
def test_one_wrong_value_loads_or_is_refused(fields, section, key, value):
    _loads_or_is_refused(lambda: experiment_from_fields(fields | {section: {key: value}}))
    _loads_or_is_refused(lambda: experiment_from_fields(fields | {key: value}))


tokens = st.sampled_from(
    [
        *("skins", "body", "surface", "shape", "mesh", "robot", "directives", "packages", "joints"),
        *("touching", "frame", "link", "thickness", "seed", "name", "sphere", "semi_axes"),
        *(": ", ", ", "{", "}", "[", "]", "\n", "\n  ", "- ", "? ", "&a ", "*a", "<<", "# ", "| "),
        *("!!int ", "!!float ", "!!binary ", "!!set ", "!!omap ", "!!timestamp ", "!!bool ", "! "),
        *("'", '"', "\\x00", "\\ud800", "\0", "\ufeff", "\x85", "\t", "---", "...", "%YAML 1.1"),
        *("0x", "0b_", "1e999", ".nan", "-.inf", "1:61:1", "2026-02-30", "~", "=", "yes", "é"),
    ]
)


@settings(max_examples=20, deadline=None)
@given(text=st.lists(tokens, max_size=12).map("".join) | st.text(max_size=40))
def test_any_text_loads_or_is_refused(text, tmp_path_factory):
    _loads_or_is_refused(lambda: experiment_from_fields(parse_fields(text)))
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    _loads_or_is_refused(lambda: load_experiment(path))


@settings(max_examples=20, deadline=None)
@given(content=st.binary(max_size=40))
def test_any_file_loads_or_is_refused(content, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content)
    _loads_or_is_refused(lambda: load_experiment(path))


@settings(max_examples=20, deadline=None)
@given(name=st.text(max_size=30))
def test_any_name_of_an_experiment_loads_or_is_refused(name):
    _loads_or_is_refused(lambda: load_experiment(name))


def test_a_number_is_never_changed_on_its_way():
    for value in (0.1, 1 / 3, math.pi, 2.3e-308, 1.7976931348623157e308):
        experiment = experiment_from_fields(LEAST | {"execution": {"stiffness": value}})
        assert experiment.execution.stiffness == value
        assert experiment_from_fields(yaml.safe_load(dump_experiment(experiment))) == experiment


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            [{"after": 9}, {"after": 3}],
            "changes[1].after is 3; give a number of touches, at least 9: changes are listed in ",
        ),
        ([{"links": {"forearm": 2.0}}], "changes[0].links.forearm is 2.0; give at most 1"),
        ([{"skins": {"bdy": {}}}], "changes[0].skins.bdy is 'bdy'; did you mean body?"),
        (
            [{"skins": {"body": {"dead": [100]}}}],
            "changes[0].skins.body.dead is [100]; give different receptors from 0 to 99",
        ),
        (
            [{"skins": {"body": {"swapped": [[1, 2, 3]]}}}],
            "changes[0].skins.body.swapped is [[1, 2, 3]]; give pairs",
        ),
        (
            [{"skins": {"body": {"stretch": 3}}}],
            "changes[0].skins.body.stretch is 3; give at most 2",
        ),
        (
            [{"tools": {"fingertip": [0, 0, 0.1]}}],
            "changes[0].tools.fingertip is [0.0, 0.0, 0.1]; did you mean fingertip_0?",
        ),
        ([{"whens": 3}], "unknown key changes[0].whens;"),
    ],
)
def test_impossible_changes_are_refused(changes, text):
    with pytest.raises(ExperimentError) as error:
        load_experiment("torus", {"changes": changes})
    assert str(error.value).startswith(text)


def test_after_its_changes_a_body_is_so_from_birth():
    experiment = load_experiment(
        "torus",
        {
            "changes": [
                {"after": 10, "links": {"forearm": 0.1}},
                {"after": 20, "joints": {"elbow_pitch": 0.1}},
            ]
        },
    )
    assert experiment.body_changes == []
    assert experiment.after(9).changes == []
    assert [c.links for c in experiment.after(10).body_changes] == [{"forearm": 0.1}]
    assert [c.joints for c in experiment.after(20).body_changes] == [{}, {"elbow_pitch": 0.1}]
