import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.experiment import ExperimentError, load_experiment
from selftouch_drake.resources import EXPERIMENTS, SWEEPS, shipped
from selftouch_drake.run.naming import leaves
from selftouch_drake.sweep.design import load_sweep, nested


@pytest.fixture
def sweep(tmp_path):
    """Loads a sweep of the given text."""

    def load(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return load_sweep(path)

    return load


@pytest.mark.parametrize("name", shipped(SWEEPS))
def test_shipped_sweeps_load(name):
    sweep = load_sweep(name)
    assert sweep.name == name
    assert sweep.fields
    assert len({e.seed for e in sweep.experiments}) > 1


def test_a_grid_is_every_combination(sweep):
    found = sweep(
        "experiments: [cube, torus]\nseeds: [3, 4]\n"
        "grid: {skins.body.num_receptors: [50, 100], joints.noise: [0, 0.1, 0.2]}"
    )
    assert found.name == "mine"
    assert found.fields == ("skins.body.num_receptors", "joints.noise")
    assert len(found.experiments) == 2 * 2 * 2 * 3
    points = {
        (e.name, e.seed, e.skins["body"].num_receptors, e.joints.noise) for e in found.experiments
    }
    assert len(points) == len(found.experiments)


def test_fields_that_vary_each_alone_meet_in_the_middle(sweep):
    found = sweep("each: {skins.body.num_receptors: [50, 100], joints.noise: [0, 0.1]}")
    points = [(e.skins["body"].num_receptors, e.joints.noise) for e in found.experiments]
    assert points == [(50, 0.0), (100, 0.0), (100, 0.1)]


def test_cases_override_the_set_fields(sweep):
    found = sweep(
        "set: {babbling: {num_samples: 999}, skins: {body: {num_receptors: 30}}}\n"
        "cases: [{}, {skins: {body: {num_receptors: 40, unevenness: 0.5}}}]"
    )
    assert [e.babbling.num_samples for e in found.experiments] == [999, 999]
    assert [e.skins["body"].num_receptors for e in found.experiments] == [30, 40]
    assert found.fields == ("skins.body.num_receptors", "skins.body.unevenness")


def test_a_sweep_of_nothing_is_one_run(sweep):
    assert sweep("").experiments == (load_experiment("sphere"),)


def test_an_experiment_beside_the_sweep_is_found(sweep, tmp_path, monkeypatch):
    text = (EXPERIMENTS / "cube.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine_too.yaml").write_text(text)
    monkeypatch.chdir("/")
    (experiment,) = sweep("experiments: [mine_too.yaml]").experiments
    assert experiment.name == "mine_too"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seed: [1]", "unknown key seed; did you mean seeds?"),
        (
            "colour: red",
            "unknown key colour; known are name, experiments, set, seeds, grid, each, cases",
        ),
        ("name: 3", "name is 3; give a text"),
        ("seeds: 3", "seeds is 3; give a list"),
        ("seeds: []", "seeds is []; give one value or more"),
        ("seeds: [true]", "seeds[0] is True; give a whole number"),
        ("experiments: cube", "experiments is 'cube'; give a list"),
        ("set: 1", "set is 1; give a mapping by name"),
        ("grid: [1]", "grid is [1]; give a mapping by name"),
        ("grid: {1: [1]}", "a name in grid is 1; give a text"),
        (
            "each: {a..b: [1]}",
            "a name in each is 'a..b'; use dots, as in skins.body.num_receptors",
        ),
        ("each: {seed: 1}", "each.seed is 1; give a list"),
        ("cases: {}", "cases is {}; give a list"),
        ("cases: [1]", "cases[0] is 1; give a mapping by name"),
    ],
)
def test_a_mistake_is_reported(sweep, text, message, tmp_path):
    with pytest.raises(ExperimentError) as error:
        sweep(text)
    assert str(error.value) == f"sweep {tmp_path / 'mine.yaml'}: {message}"


def test_too_many_runs_are_refused(sweep, tmp_path):
    many = list(range(50))
    text = yaml.safe_dump({"grid": {f"a.f{i}": many for i in range(9)}})
    with pytest.raises(ExperimentError, match=f"has {50**9} runs; give at most 2000"):
        sweep(text)


def test_a_wrong_experiment_is_reported_before_anything_runs(sweep):
    with pytest.raises(
        ExperimentError, match=r"^skins\.body\.num_receptors is 3; give at least 4$"
    ):
        sweep("each: {skins.body.num_receptors: [50, 3]}")
    with pytest.raises(ExperimentError, match=r"^experiment 'cubes' is neither shipped nor a"):
        sweep("experiments: [cubes]")
    with pytest.raises(
        ExperimentError, match=r"^sweep 'trusd' is neither shipped .* mean trust\?$"
    ):
        load_sweep("trusd")


fields = st.recursive(
    st.integers() | st.text(max_size=3),
    lambda inner: st.dictionaries(
        st.text("abc", min_size=1, max_size=3), inner, min_size=1, max_size=3
    ),
    max_leaves=8,
).filter(lambda value: isinstance(value, dict))


@settings(max_examples=50, deadline=None)
@given(fields=fields)
def test_leaves_and_nested_undo_each_other(fields):
    assert nested(leaves(fields)) == fields
