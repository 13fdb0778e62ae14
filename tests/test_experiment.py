import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.experiment import (
    END_EFFECTORS,
    METRICS,
    SHAPES,
    STREAMS,
    Body,
    Experiment,
    ExperimentError,
    Skin,
    dump_experiment,
    experiment_from_fields,
    load_experiment,
    parse_overrides,
    shipped_experiments,
)

TOP_FIELDS = (
    "name, seed, body, skin, end_effector, joints, babbling, "
    "representation, planning, execution, evaluation"
)
BODY_FIELDS = "shape, radius, side, major_radius, minor_radius, height, semi_axes, mesh, resolution"
SHIPPED = ", ".join(shipped_experiments())


@pytest.mark.parametrize("name", shipped_experiments())
def test_shipped_experiments_load(name):
    experiment = load_experiment(name)
    assert experiment.name == name
    assert experiment.num_fingers == (2 if "_two_" in name else 1)


def test_every_body_of_the_plan_is_shipped():
    assert set(shipped_experiments()) >= {
        *(
            f"{shape}{hand}"
            for shape in ("sphere", "cube", "torus")
            for hand in ("", "_two_fingers")
        ),
        "ellipsoid",
        "cylinder",
    }


def test_the_default_experiment_is_valid():
    assert experiment_from_fields({}) == Experiment()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sed: 1", "unknown key sed; did you mean seed?"),
        ("colour: red", f"unknown key colour; known are {TOP_FIELDS}"),
        ("1: 2", f"unknown key 1; known are {TOP_FIELDS}"),
        (
            "skin: {num_receptor: 50}",
            "unknown key skin.num_receptor; did you mean num_receptors?",
        ),
        ("body: {colour: red}", f"unknown key body.colour; known are {BODY_FIELDS}"),
        ("seed: one", "seed is 'one'; give a whole number"),
        ("seed: 1.5", "seed is 1.5; give a whole number"),
        ("seed: true", "seed is True; give a whole number"),
        ("seed: null", "seed is None; give a whole number"),
        ("seed: -1", "seed is -1; give a number from 0 to 2^63 - 1"),
        (
            "seed: 9223372036854775808",
            "seed is 9223372036854775808; give a whole number below 2^63",
        ),
        ("name: 7", "name is 7; give a text"),
        ("name: 2026-01-31", "name is datetime.date(2026, 1, 31); give a text"),
        ('name: ""', "name is ''; give a printable name"),
        ('name: "two\\nlines"', "name is 'two\\nlines'; give a printable name"),
        ("skin: 3", "skin is 3; give a mapping of its fields"),
        ("body: null", "body is None; give a mapping of its fields"),
        ("skin: {thickness: thick}", "skin.thickness is 'thick'; give a finite number"),
        ("skin: {thickness: .nan}", "skin.thickness is nan; give a finite number"),
        ("skin: {thickness: .inf}", "skin.thickness is inf; give a finite number"),
        ("skin: {thickness: true}", "skin.thickness is True; give a finite number"),
        ("skin: {thickness: 0}", "skin.thickness is 0.0; give a number above 0"),
        ("skin: {num_receptors: 19}", "skin.num_receptors is 19; give 20 to 200"),
        ("skin: {num_receptors: 201}", "skin.num_receptors is 201; give 20 to 200"),
        (
            "body: {shape: pyramid}",
            "body.shape is 'pyramid'; choose one of sphere, cube, torus, ellipsoid, cylinder, mesh",
        ),
        ("body: {shape: cube}", "body.side is None; shape cube needs it"),
        (
            "body: {shape: cube, side: 0.4, radius: 0.2}",
            "body.radius is 0.2; shape cube takes side; leave it out, or make it null",
        ),
        (
            "body: {shape: torus, major_radius: 0.2}",
            "body.minor_radius is None; shape torus needs it",
        ),
        ("body: {shape: sphere, radius: -1}", "body.radius is -1.0; give metres above 0"),
        ("body: {shape: ellipsoid, semi_axes: 1}", "body.semi_axes is 1; give a list"),
        (
            "body: {shape: ellipsoid, semi_axes: [1, 2]}",
            "body.semi_axes is [1.0, 2.0]; give three lengths in metres",
        ),
        (
            "body: {shape: ellipsoid, semi_axes: [1, 2, x]}",
            "body.semi_axes[2] is 'x'; give a finite number",
        ),
        (
            "body: {shape: ellipsoid, semi_axes: [1, 0, 2]}",
            "body.semi_axes is [1.0, 0.0, 2.0]; give metres above 0",
        ),
        ("body: {shape: mesh}", "body.mesh is None; shape mesh needs it"),
        ("body: {shape: mesh, mesh: ''}", "body.mesh is ''; give the path of a mesh file"),
        (
            "body: {radius: 0.2, resolution: 0.5}",
            "body.resolution is 0.5; give 0.002 to 0.1 metres",
        ),
        (
            "end_effector: three_fingers",
            "end_effector is 'three_fingers'; choose one of one_finger, two_fingers, "
            "two_wide_fingers",
        ),
        ("skin: {unevenness: 1}", "skin.unevenness is 1.0; give 0 to 0.9"),
        ("skin: {field_width: 0.5}", "skin.field_width is 0.5; give 1 to 3"),
        (
            "skin: {imperfections: {dead: -0.1}}",
            "skin.imperfections.dead is -0.1; give 0 to 0.9",
        ),
        (
            "skin: {imperfections: {saturation: 0}}",
            "skin.imperfections.saturation is 0.0; give 0.001 to 1000",
        ),
        (
            "skin: {imperfections: {additive: 1}}",
            "unknown key skin.imperfections.additive; did you mean additive_noise?",
        ),
        ("joints: {noise: 2}", "joints.noise is 2.0; give 0 to 1"),
        ("babbling: {mode: loud}", "babbling.mode is 'loud'; choose one of kinematic, dynamic"),
        (
            "babbling: {persistence: 1}",
            "babbling.persistence is 1.0; give a share from 0 to below 1",
        ),
        ("babbling: {walk_size: 0}", "babbling.walk_size is 0; give at least 1"),
        ("evaluation: {num_pairs: -1}", "evaluation.num_pairs is -1; give at least 0"),
        (
            "representation: {num_targets: 300}\nbabbling: {num_samples: 299}",
            "representation.num_targets is 300; give at most babbling.num_samples, 299",
        ),
        (
            "representation: {metric: literall}",
            "representation.metric is 'literall'; choose one of learned, sensorimotor, motor, "
            "literal, revolute_reference",
        ),
    ],
)
def test_a_mistake_is_told_with_its_field_its_value_and_a_remedy(text, message):
    with pytest.raises(ExperimentError) as error:
        experiment_from_fields(parse_overrides(text))
    assert str(error.value) == message


@pytest.mark.parametrize(
    "field",
    [
        "skin.thickness",
        "skin.hydroelastic_modulus",
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
        experiment_from_fields({section: {key: -0.5}})
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
def test_overrides_that_are_no_mapping_are_told(text, message):
    with pytest.raises(ExperimentError) as error:
        parse_overrides(text)
    assert str(error.value) == message


@pytest.mark.parametrize("text", ["seed: 2026-13-45", "seed: !!bool x", "seed: !!timestamp x"])
def test_what_yaml_itself_stumbles_over_is_not_yaml(text):
    with pytest.raises(ExperimentError, match=r"^--set is not YAML: "):
        parse_overrides(text)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("cub", "did you mean cube?"),
        ("torus_two_finger", "did you mean torus_two_fingers?"),
        ("xyzzy", f"shipped are {SHIPPED}"),
        ("", f"shipped are {SHIPPED}"),
        ("\0", f"shipped are {SHIPPED}"),
    ],
)
def test_an_experiment_that_is_not_there_is_told(name, hint):
    with pytest.raises(ExperimentError) as error:
        load_experiment(name)
    assert str(error.value) == f"experiment {name!r} is neither shipped nor a file; {hint}"


def test_a_value_of_any_size_is_told_in_a_short_line():
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


def test_a_file_is_told_by_its_path(tmp_path):
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


def test_a_file_that_contains_itself_is_told(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("&a {body: *a}")
    with pytest.raises(ExperimentError) as error:
        load_experiment(path, parse_overrides("&b {body: *b}"))
    assert str(error.value) == f"experiment {path} contains itself; leave out the alias"
    with pytest.raises(ExperimentError, match=r"^unknown key body\.body; "):
        load_experiment(path)


def test_an_empty_file_is_the_default_experiment(tmp_path):
    path = tmp_path / "empty.yaml"
    path.write_text("# nothing\n")
    assert load_experiment(path) == Experiment()


def test_overrides_are_laid_over_the_file_field_by_field():
    overrides = parse_overrides("{skin: {num_receptors: 50}, body: {resolution: 0.03}}")
    changed = load_experiment("cube", overrides)
    expected = load_experiment("cube")
    expected.skin.num_receptors = 50
    expected.body.resolution = 0.03
    assert changed == expected
    assert changed.body == Body(shape="cube", side=0.44, resolution=0.03)


def test_overrides_change_the_shape_if_the_old_dimension_is_taken_away():
    overrides = parse_overrides("body: {shape: sphere, radius: 0.2, side: null}")
    assert load_experiment("cube", overrides).body == Body(shape="sphere", radius=0.2)


def test_a_mesh_path_starts_at_the_experiment_file(tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    (tmp_path / "sub").mkdir()
    path = tmp_path / "sub" / "mine.yaml"
    path.write_text("body: {shape: mesh, mesh: ../duck.obj}")
    assert load_experiment(path).body.mesh == str(tmp_path / "duck.obj")
    path.write_text("body: {shape: mesh, mesh: /elsewhere/duck.obj}")
    assert load_experiment(path).body.mesh == "/elsewhere/duck.obj"


def test_a_mesh_path_of_the_command_line_starts_where_one_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    overrides = parse_overrides("body: {mesh: duck.obj}")
    assert load_experiment("double_torus", overrides).body.mesh == str(tmp_path / "duck.obj")


def test_numbers_may_be_written_as_people_do():
    fields = parse_overrides(
        "skin: {hydroelastic_modulus: 3e4, thickness: 0.02, num_receptors: 0x20}"
    )
    assert experiment_from_fields(fields).skin == Skin(
        hydroelastic_modulus=30_000.0, thickness=0.02, num_receptors=32
    )


def test_streams_of_randomness_are_apart():
    experiment = Experiment()

    def draw(*which, seed=0):
        experiment.seed = seed
        return np.random.default_rng(experiment.random_stream(*which)).integers(2**62)

    draws = [draw(purpose, *index) for purpose in STREAMS for index in ((), (0,), (1,), (0, 1))]
    assert len({*draws, draw("walk", seed=1)}) == len(draws) + 1
    assert draw("walk", 1) == draw("walk", 1)


lengths = st.floats(1e-6, 1e6)
dimensions = {
    "semi_axes": st.lists(lengths, min_size=3, max_size=3),
    "mesh": st.just("/some where/ключ.obj"),
}
bodies = st.sampled_from(sorted(SHAPES)).flatmap(
    lambda shape: st.fixed_dictionaries(
        {"shape": st.just(shape)} | {d: dimensions.get(d, lengths) for d in SHAPES[shape]},
        optional={"resolution": st.floats(0.002, 0.1)},
    )
)
valid_fields = st.fixed_dictionaries(
    {},
    optional={
        "name": st.text(min_size=1).filter(str.isprintable),
        "seed": st.integers(0, 2**63 - 1),
        "body": bodies,
        "end_effector": st.sampled_from(sorted(END_EFFECTORS)),
        "skin": st.fixed_dictionaries(
            {}, optional={"num_receptors": st.integers(20, 200), "thickness": lengths}
        ),
        "representation": st.fixed_dictionaries({}, optional={"metric": st.sampled_from(METRICS)}),
        "execution": st.fixed_dictionaries({}, optional={"stiffness": lengths}),
    },
)


@settings(max_examples=100, deadline=None)
@given(fields=valid_fields)
def test_what_is_dumped_loads_as_the_same_experiment(fields, tmp_path_factory):
    experiment = experiment_from_fields(fields)
    text = dump_experiment(experiment)
    path = tmp_path_factory.getbasetemp() / "dumped.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_experiment(path) == experiment
    assert dump_experiment(load_experiment(path)) == text
    given_again = dataclasses.asdict(experiment)
    for key, value in fields.items():
        there = given_again[key]
        assert there == value or all(there[name] == value[name] for name in value)


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
        | {f.name for f in dataclasses.fields(Body)}
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


def _loads_or_is_told(load) -> None:
    try:
        experiment = load()
    except ExperimentError as error:
        message = str(error)
        assert message
        assert "\n" not in message
        message.encode()
    else:
        assert experiment_from_fields(yaml.safe_load(dump_experiment(experiment))) == experiment


@settings(max_examples=200, deadline=None)
@given(fields=junk | st.dictionaries(known_keys, junk))
def test_any_data_loads_or_is_told(fields):
    _loads_or_is_told(lambda: experiment_from_fields(fields))


@settings(max_examples=100, deadline=None)
@given(fields=valid_fields, section=known_keys, key=known_keys, value=junk)
def test_one_wrong_value_loads_or_is_told(fields, section, key, value):
    _loads_or_is_told(lambda: experiment_from_fields(fields | {section: {key: value}}))
    _loads_or_is_told(lambda: experiment_from_fields(fields | {key: value}))


tokens = st.sampled_from(
    [
        *("body", "shape", "mesh", "skin", "thickness", "seed", "name", "sphere", "semi_axes"),
        *(": ", ", ", "{", "}", "[", "]", "\n", "\n  ", "- ", "? ", "&a ", "*a", "<<", "# ", "| "),
        *("!!int ", "!!float ", "!!binary ", "!!set ", "!!omap ", "!!timestamp ", "!!bool ", "! "),
        *("'", '"', "\\x00", "\\ud800", "\0", "\ufeff", "\x85", "\t", "---", "...", "%YAML 1.1"),
        *("0x", "0b_", "1e999", ".nan", "-.inf", "1:61:1", "2026-02-30", "~", "=", "yes", "é"),
    ]
)


@settings(max_examples=300, deadline=None)
@given(text=st.lists(tokens, max_size=12).map("".join) | st.text(max_size=40))
def test_any_text_loads_or_is_told(text, tmp_path_factory):
    _loads_or_is_told(lambda: experiment_from_fields(parse_overrides(text)))
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    _loads_or_is_told(lambda: load_experiment(path))


@settings(max_examples=100, deadline=None)
@given(content=st.binary(max_size=40))
def test_any_file_loads_or_is_told(content, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content)
    _loads_or_is_told(lambda: load_experiment(path))


@settings(max_examples=100, deadline=None)
@given(name=st.text(max_size=30))
def test_any_name_of_an_experiment_loads_or_is_told(name):
    _loads_or_is_told(lambda: load_experiment(name))


def test_a_number_is_never_changed_on_its_way():
    for value in (0.1, 1 / 3, math.pi, 5e-324, 1.7976931348623157e308):
        experiment = experiment_from_fields({"execution": {"stiffness": value}})
        assert experiment.execution.stiffness == value
        assert experiment_from_fields(yaml.safe_load(dump_experiment(experiment))) == experiment
