import dataclasses
import sys
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from selftouch_drake.agent.body import Felt
from selftouch_drake.bodies.drake import DrakeBodies, DrakeBody
from selftouch_drake.bodies.embodiment import body_of
from selftouch_drake.experience.collect import (
    NeverTouchesError,
    collect,
    collect_walk,
    random_walk,
    walk_sizes,
    walker_of,
)
from selftouch_drake.experience.store import ExperienceReader, StoreError, shard_name
from selftouch_drake.experiment import (
    dump_experiment,
    experiment_from_fields,
    load_experiment,
)
from selftouch_drake.robot import World
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn

collect_module = sys.modules[collect.__module__]


class Backwards(Executor):
    """Collects jobs, then runs them in the opposite order."""

    def __init__(self, num_jobs):
        self._num_jobs, self._jobs = num_jobs, []

    def submit(self, function, /, *args):
        future = Future()
        self._jobs.append((future, function, args))
        if len(self._jobs) == self._num_jobs:
            for job, do, arguments in reversed(self._jobs):
                job.set_result(do(*arguments))
        return future


@pytest.fixture(scope="module")
def experiment():
    """Three walks on a coarse sphere."""
    return load_experiment(
        "sphere",
        {
            "skins": {
                "body": {
                    "surface": {"shape": "sphere", "radius": 0.25, "resolution": 0.04},
                    "num_receptors": 30,
                }
            },
            "babbling": {"num_samples": 500, "walk_size": 200},
        },
    )


@pytest.fixture(scope="module")
def world(experiment):
    return World(experiment)


@pytest.fixture(scope="module")
def probe(world):
    return world.probe


@pytest.fixture(scope="module")
def source(world):
    return DrakeBody(world)


def _collected(path, experiment, executor):
    run = RunDirectory.create(path, experiment)
    with executor:
        num_steps = collect_into(run, executor)
    return run, num_steps


def collect_into(run, executor, **options):
    """Number of steps so far."""
    counts = collect(
        run.experiment,
        run.path,
        fingerprint=run.fingerprint(),
        executor=executor,
        body_of=body_of,
        **options,
    )
    return counts.num_steps


def _shards(run):
    return {str(p.relative_to(run.path)): p.read_bytes() for p in run.path.rglob("*.parquet")}


@pytest.fixture(scope="module")
def reference(experiment, tmp_path_factory):
    """One worker, walk after walk."""
    path = tmp_path_factory.mktemp("reference") / "run"
    run, num_steps = _collected(path, experiment, InTurn())
    return run, num_steps, _shards(run)


def test_walks_share_out_the_samples(experiment):
    assert walk_sizes(experiment) == [200, 200, 100]
    whole = load_experiment("sphere", {"babbling": {"num_samples": 600, "walk_size": 200}})
    assert walk_sizes(whole) == [200, 200, 200]


def test_what_is_stored_is_what_is_felt(reference, probe, experiment):
    run, num_steps, shards = reference
    assert sorted(shards) == [
        f"{folder}/{shard_name(walk)}" for folder in ("experience", "truth") for walk in range(3)
    ]
    q = ExperienceReader(run.experience).read("q")
    sensation = ExperienceReader(run.experience).read("sensation")
    (*shards_of_truth,) = ExperienceReader(run.truth).contacts()
    assert q.shape == (500, 6)
    assert sensation.shape == (500, 30)
    assert [len(contacts) for contacts in shards_of_truth] == [200, 200, 100]
    assert sensation.any(axis=1).all()
    assert (q >= probe.robot.lower - 1e-6).all()
    assert (q <= probe.robot.upper + 1e-6).all()
    np.testing.assert_array_equal(probe.sensations(q.astype(float)).astype(np.float32), sensation)
    for contacts in shards_of_truth:
        assert (np.diff(contacts.offsets) == 1).all()
        assert not contacts.skin.any()
        assert not contacts.toucher.any()
        # The centre of pressure is in the wall.
        radius = np.linalg.norm(contacts.p_LC, axis=1)
        assert ((radius > 0.21) & (radius < 0.251)).all()
    shards_read = [pq.read_table(run.experience / shard_name(walk)) for walk in range(3)]
    last_steps = [table["step"].to_numpy() for table in shards_read]
    assert all((np.diff(step) > 0).all() for step in last_steps)
    assert num_steps == sum(step[-1] + 1 for step in last_steps)


@pytest.mark.parametrize("walk", [0, 1])
def test_a_walk_has_a_seed_of_its_own(source, experiment, reference, walk):
    run, *_ = reference
    shard = collect_walk(source, experiment, walk, 50)
    stored = list(ExperienceReader(run.experience).batches("q"))
    np.testing.assert_array_equal(shard.q, stored[walk][:50])
    assert not (stored[0][:100] == stored[1][:100]).any()


def test_any_order_gives_the_same_bytes(experiment, reference, tmp_path):
    _, num_steps, shards = reference
    run, steps = _collected(tmp_path / "run", experiment, Backwards(3))
    assert _shards(run) == shards
    assert steps == num_steps


def test_threads_with_worlds_of_their_own_give_the_same_bytes(experiment, reference, tmp_path):
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        run, _ = _collected(tmp_path / "run", experiment, ThreadPoolExecutor(3))
    finally:
        sys.setswitchinterval(interval)
    assert _shards(run) == reference[-1]


def test_an_interrupted_run_goes_on_where_it_was(experiment, reference, tmp_path):
    _, num_steps, shards = reference
    run, _ = _collected(tmp_path / "run", experiment, InTurn())
    (run.experience / shard_name(1)).unlink()
    kept = (run.experience / shard_name(0)).stat().st_mtime_ns
    progress = []
    steps = collect_into(run, InTurn(), progress=progress.append)
    assert _shards(run) == shards
    assert steps == num_steps
    assert sorted(progress) == [100, 200, 200]
    assert (run.experience / shard_name(0)).stat().st_mtime_ns == kept


def test_shards_of_another_experiment_are_refused_and_kept(experiment, reference, tmp_path):
    other = load_experiment("sphere", {"seed": 1, "babbling": {"num_samples": 400}})
    run = RunDirectory.create(tmp_path / "run", other)
    run.experience.mkdir()
    shard = run.experience / shard_name(0)
    shard.write_bytes((reference[0].experience / shard_name(0)).read_bytes())
    before = shard.read_bytes()
    with pytest.raises(StoreError) as error:
        collect_into(run, InTurn())
    assert str(error.value) == f"{shard} belongs to another experiment; choose another --out"
    assert shard.read_bytes() == before


@pytest.mark.parametrize("size", [0, 3, 1000])
def test_a_truncated_shard_is_refused(experiment, reference, tmp_path, size):
    run = RunDirectory.create(tmp_path / "run", experiment)
    run.experience.mkdir()
    shard = run.experience / shard_name(2)
    shard.write_bytes((reference[0].experience / shard_name(2)).read_bytes()[:size])
    with (
        Backwards(3) as executor,
        pytest.raises(StoreError, match=r"damaged.*babble again") as error,
    ):
        collect_into(run, executor)
    assert str(error.value).startswith(f"{shard} is damaged (")
    assert not run.truth.exists()


def test_a_dynamic_walk_is_sampled_evenly_and_felt_where_it_is(experiment, probe):
    babbling = dataclasses.replace(experiment.babbling, mode="dynamic")
    experiment = dataclasses.replace(experiment, babbling=babbling)
    body = DrakeBodies(World(experiment)).babbling

    def walk(num_batches):
        walker, path = walker_of(experiment, body), random_walk(experiment, body, 3)
        walker.begin_at(path.steps(1)[0])
        felt = [walker.walk(path.steps(walker.batch)) for _ in range(num_batches)]
        return (np.concatenate([getattr(one, name) for one in felt]) for name in ("q", "sensation"))

    q, sensation = walk(3)
    # Ten seconds each, fifty samples a second, and one where it begins.
    assert q.shape == (3 * 500 + 1, 6)
    # The arm never stands still nor jumps, within a batch or between two.
    moved = np.abs(np.diff(q, axis=0)).max(axis=1)
    assert moved.min() > 0
    assert moved.max() < 20.0 * 0.02
    expected = probe.sensations(q.astype(float))
    assert expected.any(axis=1).sum() > 10
    # The configuration is stored in float32, 1e-7 rad from where the sensation was felt.
    np.testing.assert_allclose(sensation, expected, atol=1e-4 * expected.max())
    again, felt_again = walk(2)
    np.testing.assert_array_equal(again, q[: len(again)])
    np.testing.assert_array_equal(felt_again, sensation[: len(again)])


def test_a_body_that_is_never_touched_is_reported(experiment, source, probe, monkeypatch):
    monkeypatch.setattr(collect_module, "PATIENCE", 10_000)
    still = dataclasses.replace(experiment.babbling, step_size=1e-9)
    experiment = dataclasses.replace(experiment, babbling=still)
    # The walk hardly moves, and this one starts away from the body.
    away = next(w for w in range(20) if not probe.sensations(_first(probe, experiment, w)).any())
    with pytest.raises(NeverTouchesError) as error:
        collect_walk(source, experiment, away, 10)
    assert str(error.value) == (
        "babbling touched nothing in 12288 steps; see what can touch what with `selftouch robot "
        "EXPERIMENT --show`, or make babbling.step_size larger"
    )


class Scripted:
    """A body that feels what the test has set, in any posture."""

    joint_names = tuple("abcdef")
    lower, upper = np.full(6, -1.0), np.full(6, 1.0)
    velocity = acceleration = np.ones(6)
    num_receptors, jumps = 3, True

    def __init__(self, next_batch):
        self._next_batch = next_batch

    def feel(self, q):
        return self._next_batch()

    def follow(self, time_s, q):
        raise NotImplementedError


def test_a_walk_that_stops_touching_is_reported(experiment, monkeypatch):
    force = iter([1.0])

    def batch():
        """Touches at the end of the first batch only."""
        sensation = np.zeros((1000, 3))
        sensation[-1] = next(force, 0.0)
        return Felt(q=np.zeros((1000, 6)), sensation=sensation, reached=np.ones(1000, bool))

    monkeypatch.setattr(collect_module, "PATIENCE", 10_000)
    with pytest.raises(NeverTouchesError, match="touched nothing in 10001 steps"):
        collect_walk(Scripted(batch), experiment, 0, 2)


def test_touches_in_impossible_postures_alone_are_said(experiment, monkeypatch):
    def batch():
        felt = np.zeros((1000, 3))
        felt[::100] = 1.0
        return Felt(q=np.zeros((1000, 6)), sensation=felt, reached=np.zeros(1000, bool))

    monkeypatch.setattr(collect_module, "PATIENCE", 3000)
    with pytest.raises(NeverTouchesError, match="in 3000 steps but in 30 postures that the body"):
        collect_walk(Scripted(batch), experiment, 0, 2)


def every_third_is_impossible():
    """Touches in every step."""
    rows = np.arange(30.0)
    q = np.repeat(rows[:, None], 6, axis=1)
    return Felt(q=q, sensation=np.ones((30, 3)), reached=rows % 3 != 0)


@pytest.mark.parametrize(("num_rows", "num_steps"), [(1, 2), (2, 3), (20, 30), (21, 32), (50, 75)])
def test_postures_that_a_robot_cannot_take_are_counted_and_not_kept(
    experiment, num_rows, num_steps
):
    shard = collect_walk(Scripted(every_third_is_impossible), experiment, 0, num_rows)
    kept = [step for step in range(num_steps) if step % 30 % 3 != 0]
    assert shard.step.tolist() == kept
    assert shard.num_steps == num_steps
    assert shard.num_impossible == num_steps - num_rows
    assert shard.q[:, 0].tolist() == [step % 30 for step in kept]
    assert shard.contacts is None


def _first(probe, experiment, walk):
    """`(1, 6)` the configuration of a walk that hardly moves."""
    seed = experiment.random_stream("walk", walk)
    start = np.random.default_rng(seed).uniform(size=6)
    return (probe.robot.lower + start * (probe.robot.upper - probe.robot.lower))[None]


def test_a_walk_ends_where_the_body_changes(experiment, reference, tmp_path):
    change = {"after": 250, "skins": {"body": {"dead": list(range(15))}}}
    fields = yaml.safe_load(dump_experiment(experiment)) | {"changes": [change]}
    fields["babbling"]["num_samples"] = 300
    changing = experiment_from_fields(fields)
    assert walk_sizes(changing) == [200, 50, 50]
    run, _ = _collected(tmp_path / "run", changing, InTurn())
    assert run.fingerprint() != reference[0].fingerprint()
    felt = ExperienceReader(run.experience).read("sensation")
    as_before = ExperienceReader(reference[0].experience).read("sensation")
    assert np.array_equal(felt[:250], as_before[:250])
    assert not felt[250:, :15].any()
    resumed, _ = _collected(tmp_path / "run", changing, Backwards(0))
    assert _shards(resumed) == _shards(run)
