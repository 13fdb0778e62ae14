"""Active babbling: rounds that follow from the rounds before, in both worlds."""

import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.lifelong import life as life_module
from selftouch_drake.agent.lifelong.explorer import PostureHolder
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.bodies.embodiment import body_of, make_bodies
from selftouch_drake.experience.collect import walk_sizes, walker_of
from selftouch_drake.experience.exploration import Exploration, explore, new_life
from selftouch_drake.experience.store import ExperienceReader, shard_name
from selftouch_drake.experience.walk import CHOICE_S
from selftouch_drake.experiment import ExperimentError, load_experiment
from selftouch_drake.experiment.schema import Change
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.fingerprint import experience_fingerprint

SKINS = {
    "body": {
        "surface": {"shape": "sphere", "radius": 0.25, "resolution": 0.04},
        "num_receptors": 30,
    }
}


def active(num_samples, model="off", **babbling):
    given = {"strategy": "active", "num_samples": num_samples} | babbling
    # Most tests do without the search for a chain, which takes seconds.
    learned = {"num_targets": 50, "body_model": model}
    return load_experiment("sphere", {"skins": SKINS, "babbling": given, "representation": learned})


def living(experiment):
    """An agent that explores, at birth."""
    return Exploration(experiment, make_bodies(experiment).babbling)


def explored_by(life, run):
    return explore(life, run.path, fingerprint=run.fingerprint(), body_of=body_of)


def explored(path, experiment):
    run = RunDirectory.create(path, experiment)
    return run, explored_into(run)


def explored_into(run):
    return explored_by(living(run.experiment), run)


def shards(run):
    return {str(p.relative_to(run.path)): p.read_bytes() for p in run.path.rglob("*.parquet")}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    run, counts = explored(tmp_path_factory.mktemp("active") / "run", active(750))
    return run, counts, shards(run)


def test_rounds_grow_with_the_experience():
    sizes = walk_sizes(active(10_000))
    assert sizes[:4] == [50, 50, 50, 50]
    assert sizes[-2] > 500
    assert sum(sizes) == 10_000
    assert max(walk_sizes(active(10_000, walk_size=300))) == 300
    # Under dynamics each one begins at rest.
    assert walk_sizes(active(10_000, mode="dynamic"))[:2] == [250, 250]


def test_what_touches_is_kept_as_it_is_felt(reference):
    run, _, _ = reference
    q = ExperienceReader(run.experience).read("q")
    sensation = ExperienceReader(run.experience).read("sensation")
    assert q.shape == (750, 6)
    assert sensation.any(axis=1).all()
    felt = living(run.experiment).body.feel(q).sensation
    np.testing.assert_array_equal(felt.astype(np.float32), sensation)


def test_a_stopped_run_goes_on_to_the_same_bytes(reference, tmp_path):
    _, counts, wanted = reference
    run = RunDirectory.create(tmp_path / "run", active(750))
    for folder in ("experience", "truth"):
        (run.path / folder).mkdir(exist_ok=True)
        for number in range(2):
            name = f"{folder}/{shard_name(number)}"
            (run.path / name).write_bytes(wanted[name])
    assert explored_into(run) == counts
    assert shards(run) == wanted


def test_a_lost_round_is_lived_again_to_the_same_bytes(reference):
    run, counts, wanted = reference
    (run.experience / shard_name(1)).unlink()
    assert explored_into(run) == counts
    assert shards(run) == wanted


def test_what_it_knows_does_not_depend_on_where_it_was_stopped():
    """The learner measures distances again only where enough is new since it was last asked."""
    whole, rounds = living(active(3000)), []
    for _ in range(5):
        shard = whole.explore(200)
        whole.remember(shard.q, shard.sensation)
        rounds.append((shard.q, shard.sensation))
    again = living(active(3000))
    for q, sensation in rounds:
        again.remember(q, sensation)
    np.testing.assert_array_equal(again.explore(200).q, whole.explore(200).q)


@pytest.fixture
def quick(monkeypatch):
    """Lives that expect sooner, and less exactly."""
    monkeypatch.setattr(life_module, "_FIRST", 1000)
    monkeypatch.setattr(life_module, "_TO_EXPLAIN", 600)
    monkeypatch.setitem(Life.__init__.__kwdefaults__, "num_steps", 600)


def changing(num_samples, **change):
    return dataclasses.replace(active(num_samples), changes=[Change(**change)])


@pytest.mark.slow
def test_in_a_changed_body_it_explores_by_what_it_adapted(tmp_path, quick):
    experiment = changing(3250, after=2000, joints={"elbow_pitch": 0.6})
    run, life = RunDirectory.create(tmp_path / "whole", experiment), living(experiment)
    counts = explored_by(life, run)
    (noticed,) = life.mind.noticed
    assert 2000 <= noticed.row < 2500 < noticed.explained_at
    assert noticed.change.offset.any()
    known = life._agent.representation
    assert known is life.mind.learner.representation
    assert life.body.world.experiment.changes
    # What it remembers from before the change touches again.
    before = ExperienceReader(run.experience).read("q")[:2000]
    unadapted, adapted = (
        life.body.feel(q).sensation.any(axis=1).mean() for q in (before, known.kernel_q)
    )
    assert unadapted < 0.6
    assert adapted > 0.8
    # Stopped while it only collects touches of the changed body, it goes on to the same bytes.
    wanted = shards(run)
    again = RunDirectory.create(tmp_path / "again", experiment)
    stopped = np.flatnonzero(np.cumsum(walk_sizes(experiment)) <= 2500)
    for folder in ("experience", "truth"):
        (again.path / folder).mkdir(exist_ok=True)
        for number in stopped:
            name = f"{folder}/{shard_name(number)}"
            (again.path / name).write_bytes(wanted[name])
    assert explored_into(again) == counts
    assert shards(again) == wanted


def test_the_agent_is_naive(reference):
    """Without the truth of the rounds before it does the same."""
    life = living(active(750))
    rounds = list(ExperienceReader(reference[0].experience).touches())
    for sensation, q in rounds[:-1]:
        life.remember(q, sensation)
    _, last = rounds[-1]
    np.testing.assert_array_equal(life.explore(len(last)).q, last)


def test_by_the_chain_of_its_body_it_touches_more_often(tmp_path):
    run, _ = explored(tmp_path / "run", active(200, model="auto"))
    wanted = shards(run)
    share = [50 / (steps[-1] + 1) for steps in ExperienceReader(run.experience).steps()]
    assert min(share[2:]) > 2 * max(share[:2])
    # Stopped, it goes on to the same bytes.
    (run.experience / shard_name(3)).unlink()
    explored_into(run)
    assert shards(run) == wanted


def test_it_explores_under_dynamics(tmp_path):
    run, counts = explored(tmp_path / "run", active(100, mode="dynamic"))
    assert ExperienceReader(run.experience).num_rows == 100
    assert counts.num_steps > 100


def test_under_dynamics_it_feels_at_every_step():
    experiment = active(100, mode="dynamic")
    walker = walker_of(experiment, make_bodies(experiment).babbling)
    walker.begin_at(np.zeros(6))
    # The first motion has a sample of its start.
    for step in range(1, 60):
        assert walker.walk(np.full((1, 6), 0.01 * step), CHOICE_S).q.shape == (1 + (step == 1), 6)


def test_a_strategy_has_a_name():
    with pytest.raises(ExperimentError, match=r"babbling.strategy is 'busy'"):
        load_experiment("sphere", {"babbling": {"strategy": "busy"}})


def test_random_babbling_keeps_its_fingerprint():

    random = load_experiment("sphere")
    assert experience_fingerprint(random, {}) != experience_fingerprint(active(100_000), {})


def test_it_seeks_postures_and_goes_on_from_stored_rounds_to_the_same_bytes(tmp_path):
    run, counts = explored(tmp_path / "run", active(120, walk_size=40, seek="postures"))
    wanted, life = shards(run), living(run.experiment)
    (run.experience / shard_name(2)).unlink()
    assert explored_by(life, run) == counts
    assert shards(run) == wanted
    # In most postures most joints are at a limit.
    q = ExperienceReader(run.experience).read("q")
    ends = np.isclose(q, life.body.lower, atol=1e-5) | np.isclose(q, life.body.upper, atol=1e-5)
    assert ends.mean() > 0.5


def test_a_posture_is_held_where_it_takes_time_to_press():
    holder = PostureHolder(
        agent=None,
        q=np.zeros(2),
        felt=np.zeros(4),
        rng=np.random.default_rng(0),
        lower=-np.ones(2),
        upper=np.ones(2),
        stride=np.ones(2),
    )
    moves = holder.moves()
    there = next(moves)
    pressed = moves.send((there, np.zeros((1, 4))))
    assert there.shape == (1, 2)
    assert len(pressed) > 4
    assert (pressed == there).all()
    assert (np.abs(pressed) <= 1.0).all()


def test_what_is_sought_has_a_name():
    with pytest.raises(ExperimentError, match=r"babbling.seek is 'fun'"):
        load_experiment("sphere", {"babbling": {"seek": "fun"}})


def test_a_life_under_dynamics_takes_a_touch_for_each_step_and_one_without_takes_all():
    for mode, every in (("kinematic", 1), ("dynamic", 5)):
        experiment = load_experiment("sphere", {"babbling": {"mode": mode}})
        assert new_life(experiment).every == every
