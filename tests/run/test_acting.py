"""Plans, tours, free starts and rehearsals of a small run, from Python and the command line."""

import dataclasses
import itertools
import re
import shutil

import numpy as np
import pytest

from selftouch_drake.agent import pilot as pilot_module
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.agent.tries import best, judged_try
from selftouch_drake.bodies.drake import DrakeBodies, DrakeBody
from selftouch_drake.bodies.embodiment import bodies_of, pilot_in
from selftouch_drake.cli import main
from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.robot import World
from selftouch_drake.run import load_motion as from_python
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import (
    load_agent,
    load_execution,
    load_memory,
    load_motion,
    load_representation,
    save_memory,
    stored_pairs,
    was_executed,
)
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.executors import InTurn, local_executor
from selftouch_drake.run.metrics import METRICS
from selftouch_drake.run.naming import free_start
from selftouch_drake.run.trials import trial_metrics, trial_table, try_pairs
from selftouch_drake.systems.simulation import simulation_of

SMALL = {
    "babbling": {"num_samples": 3000, "walk_size": 1500},
    "representation": {"num_targets": 60, "metric": "motor", "body_model": "off"},
    "execution": {"max_tries": 3},
    "evaluation": {"num_pairs": 2, "shape_metrics": []},
}
LIMITS = "q_start[1] is -1.5: give a position within the limits of the joint, -1 to 2.6"


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    experiment = load_experiment("cube", SMALL)
    run = RunDirectory.create(tmp_path_factory.mktemp("runs") / "cube", experiment)
    world = stages.make_world(run)
    stages.babble(run, InTurn())
    stages.learn(run)
    return run, world


@pytest.fixture
def run(learned, tmp_path):
    shutil.copytree(learned[0].path, tmp_path / "run")
    run = RunDirectory.open(tmp_path / "run")
    stages.keep_bodies(run, DrakeBodies(learned[1]))
    return run


@pytest.fixture(scope="module")
def world(learned):
    return learned[1]


def pilot_of(agent, world):
    return pilot_in(DrakeBodies(world), agent, world.experiment)


def output_of(capsys, *arguments):
    """Exit status, stdout and stderr."""
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    said = capsys.readouterr()
    return end.value.code, said.out, said.err


def representation_of(run):
    return load_representation(run)


def test_a_tour_is_planned_and_executed_as_one_motion(run, world):
    motion = stages.plan(run, 3, 20, 41)
    assert motion.plan.nodes[0] == 3
    assert motion.plan.goal == 41
    assert 20 in motion.plan.nodes
    assert not was_executed(run, 3, 20, 41)
    done = stages.execute(run, 3, 20, 41)
    assert was_executed(run, 3, 20, 41)
    stored = load_execution(run, 3, 20, 41)
    np.testing.assert_array_equal(stored.felt, done.execution.felt)
    np.testing.assert_array_equal(stored.motion.q, motion.q)
    again = stages.plan(run, 3, 20, 41)
    np.testing.assert_array_equal(again.q, motion.q)


def test_the_touch_servo_holds_a_touch_that_is_lost_without_it(run, world):
    execution = dataclasses.replace(run.experiment.execution, touch_servo=True)
    served = World(dataclasses.replace(run.experiment, execution=execution))
    vars(served).update(skins=world.skins, probe=world.probe)
    pilot = pilot_of(load_agent(run), served)
    motion = pilot.plan(3, 41).motion
    beside = pilot.beside(motion)
    # To the side on which the plan has less room.
    sign = 1.0 if beside.strength[:, -2].sum() < beside.strength[:, 1].sum() else -1.0
    off = sign * 0.055 * beside.across[len(beside.across) // 2] / beside.joint_scale

    def contact(beside):
        body, how = pilot.body, (motion.time_s, motion.q + off)
        followed = body.follow(*how) if beside is None else body.follow_beside(*how, beside)
        return followed.sensation.any(axis=1)[motion.touching].mean()

    assert contact(beside) > contact(None) + 0.05
    assert pilot.execute(motion)[0].contact == 1.0


@pytest.mark.slow
def test_the_experiment_switches_the_touch_servo_on(run, capsys):
    """The joints slip after babbling: what was learned leads beside the skin."""
    output_of(capsys, "plan", run.path, "--from", 39, "--to", 42)
    file = run.path / "experiment.yaml"
    slipped = file.read_text().replace("  offset: 0.0", "  offset: 0.06")
    for how in ((), ("--rehearse", 1)):
        contact = []
        for servo in ("false", "true"):
            file.write_text(slipped.replace("touch_servo: false", f"touch_servo: {servo}"))
            run.rehearsal.unlink(missing_ok=True)
            words = ("execute", run.path, "--from", 39, "--to", 42, *how)
            status, out, err = output_of(capsys, *words)
            assert (status, err) == (0, "")
            contact.append(float(re.search(r"in contact: ([0-9.]+)%", out)[1]))
        assert contact[0] < 70.0
        assert contact[1] > 90.0


def test_plans_keep_the_limits_of_each_joint(run):
    world = World(run.experiment)
    slow = np.array([1.0, 0.2, 1.0, 1.0, 1.0, 1.0])
    vars(world)["limits"] = dataclasses.replace(world.limits, velocity=slow)
    stages.keep_bodies(run, DrakeBodies(world))
    motion = stages.plan(run, 3, 41)
    assert np.abs(motion.v).max(axis=0)[1] <= 0.2
    assert np.abs(motion.v).max() > 0.2


def test_a_robot_in_the_air_goes_to_touch(run, world):
    q_start = np.array([0.1, -0.5, 0.3, 0.0, 0.0, 0.0])
    motion = stages.plan(run, 20, q_start=q_start)
    assert motion.plan.nodes[0] == NO_KERNEL
    assert motion.plan.in_air[0]
    np.testing.assert_allclose(motion.q[0], q_start)
    done = stages.execute(run, free_start(q_start), 20)
    assert not done.execution.felt[0].any()
    assert done.execution.felt.any()
    # The way through the air is no contact that was lost.
    air = ~motion.touching
    assert air[0]
    assert not done.execution.felt[air].any(axis=1).all()
    touched = done.execution.felt[~air].any(axis=1)
    assert done.contact == pytest.approx(touched.mean())


def test_a_robot_that_touches_starts_from_what_it_feels(run, world):
    known = representation_of(run)
    q_start = known.kernel_q[known.members(7)][0].astype(float)
    assert stages.plan(run, 20, q_start=q_start).plan.nodes[0] == 7


def test_a_start_outside_the_limits_is_refused(run, world):
    with pytest.raises(ValueError, match=f"^{re.escape(LIMITS)}$"):
        stages.plan(run, 20, q_start=np.array([0.1, -1.5, 0.3, 0.0, 0.0, 0.0]))


def test_rehearsal_never_makes_a_plan_worse_and_is_remembered(run, world):
    tries = stages.rehearse(run, 3, 20, max_tries=3)
    assert 1 <= len(tries) <= 3
    memory = load_memory(run, representation_of(run))
    assert memory.num_tries == len(tries)
    kept = judged_try(load_execution(run, 3, 20), representation_of(run))
    assert (kept.reached, kept.contact) == (best(tries).reached, best(tries).contact)
    assert (kept.reached, kept.contact) >= (tries[0].reached, tries[0].contact)


def test_tries_end_at_the_first_perfect_one_or_at_the_most(run, world, monkeypatch):
    # Scores are given: what is executed need not be simulated.
    pilot, scripted = Pilot(load_agent(run), DrakeBody(world)), [0.9, 0.95, 1.0, 1.0]

    def judged(execution, representation):
        one = judged_try(execution, representation)
        return dataclasses.replace(one, contact=scripted.pop(0), reached=True)

    monkeypatch.setattr(pilot_module, "judged_try", judged)
    assert [one.contact for one in pilot.rehearse(3, 20, max_tries=6)] == [0.9, 0.95, 1.0]
    assert pilot.agent.memory.num_tries == 3
    scripted[:] = [0.5, 0.5, 0.5]
    assert len(pilot.rehearse(3, 20, max_tries=2)) == 2
    with pytest.raises(ValueError, match=r"^max_tries is 0: give at least 1$"):
        pilot.rehearse(3, 20, max_tries=0)


def test_later_plans_keep_off_what_rehearsals_lost(run, world):
    before = stages.plan(run, 3, 20)
    save_memory(run, RehearsalMemory.blank(representation_of(run)).after(before.plan.links))
    after = stages.plan(run, 3, 20)
    assert not np.array_equal(after.plan.nodes, before.plan.nodes)


def test_learning_again_forgets_rehearsals(run):
    save_memory(run, RehearsalMemory.blank(representation_of(run)))
    stages.learn(run)
    assert not run.rehearsal.exists()


def test_a_memory_that_does_not_belong_is_refused(run):
    save_memory(run, RehearsalMemory.blank(representation_of(run)))
    arrays = load_arrays(run.rehearsal)
    save_arrays(run.rehearsal, arrays | {"belongs_to": np.array("another")})
    with pytest.raises(RunError) as error:
        load_agent(run)
    assert str(error.value) == (
        f"{run.rehearsal} belongs to another representation; delete it and rehearse again"
    )
    save_arrays(run.rehearsal, arrays | {"num_tries": np.array(-1)})
    with pytest.raises(RunError, match="is not a memory of rehearsals: num_tries is -1"):
        load_agent(run)


def test_a_representation_that_does_not_belong_is_refused(run):
    text = (run.path / "experiment.yaml").read_text()
    (run.path / "experiment.yaml").write_text(text.replace("num_targets: 60", "num_targets: 70"))
    with pytest.raises(RunError) as error:
        load_agent(RunDirectory.open(run.path))
    assert str(error.value) == (
        f"{run.representation} has 60 targets over 100 receptors, the experiment 70 over 100; "
        f"run `selftouch learn {run.path}`"
    )


def test_a_representation_without_the_stamp_of_its_experience_is_refused(run):
    arrays = load_arrays(run.representation)
    del arrays["made_for"]
    save_arrays(run.representation, arrays)
    with pytest.raises(RunError) as error:
        load_agent(run)
    assert str(error.value) == (
        f"{run.representation} belongs to another experiment or version; "
        f"run `selftouch learn {run.path}`"
    )


def test_a_plan_to_the_current_sensation_stays_and_is_reached(run, world):
    motion = stages.plan(run, 7, 7)
    assert motion.plan.nodes.tolist() == [7]
    assert np.allclose(motion.q, motion.q[0])
    assert stages.execute(run, 7, 7).perfect


def test_a_robot_that_does_not_follow_is_shown_as_it_is(run):
    limp = {"stiffness": 1.0, "damping": 1.0}
    stages.keep_bodies(
        run, DrakeBodies(World(load_experiment("cube", SMALL | {"execution": limp})))
    )
    stages.plan(run, 3, 20)
    kept = stages.execute(run, 3, 20)
    assert not kept.perfect
    error = kept.execution.q_measured - kept.execution.motion.q
    assert np.sqrt(np.square(error).mean()) > 0.05


def test_stored_pairs_are_those_of_two_targets(run, world):
    stages.plan(run, 12, 3)
    stages.plan(run, 3, 20)
    stages.plan(run, 3, 20, 41)
    assert stored_pairs(run) == [(3, 20), (12, 3)]
    np.testing.assert_array_equal(load_motion(run, 12, 3).plan.nodes[[0, -1]], [12, 3])


@pytest.mark.parametrize("opened", [True, False])
def test_a_stored_plan_is_loaded_from_python_as_it_is(run, world, opened):
    planned = stages.plan(run, 12, 3)
    found = from_python(run if opened else str(run.path), 12, 3)
    for name in ("time_s", "q", "v", "predicted"):
        np.testing.assert_array_equal(getattr(found, name), getattr(planned, name))


def test_a_plan_that_is_not_stored_is_made_and_not_stored(run, world):
    found = from_python(run.path, 12, 3)
    assert found.plan.nodes[[0, -1]].tolist() == [12, 3]
    assert not run.plan(12, 3).exists()
    np.testing.assert_array_equal(found.q, stages.plan(run, 12, 3).q)


def test_motions_that_cannot_be_loaded_say_why(run, tmp_path):
    with pytest.raises(RunError, match="nowhere"):
        from_python(tmp_path / "nowhere", 12, 3)
    with pytest.raises(RunError, match="60"):
        from_python(run, 12, 60)
    run.representation.unlink()
    with pytest.raises(RunError, match="run `selftouch learn"):
        from_python(run, 12, 3)


def with_pairs(run, num_pairs):
    """The run with another number of pairs in its experiment."""
    evaluation = dataclasses.replace(run.experiment.evaluation, num_pairs=num_pairs)
    experiment = dataclasses.replace(run.experiment, evaluation=evaluation)
    return dataclasses.replace(run, experiment=experiment)


def test_pairs_are_drawn_from_all_pairs_of_the_one_part(run):
    """Numbers of the pairs that the seed draws; they must not change."""
    run = with_pairs(run, 30)
    representation = representation_of(run)
    random = np.random.default_rng(run.experiment.random_stream("pairs"))
    codes = random.choice(60 * 59, size=30, replace=False)
    expected = [(int(c // 59), int(c % 59 + (c % 59 >= c // 59))) for c in codes]
    assert random_pairs(run.experiment, representation) == expected
    run = with_pairs(run, 10_000)
    everything = random_pairs(run.experiment, representation)
    assert len(set(everything)) == len(everything) == 60 * 59


@pytest.mark.slow
def test_evaluation_in_another_process_gives_the_same(run, world, tmp_path):
    other = RunDirectory.open(shutil.copytree(run.path, tmp_path / "other"))
    stages.evaluate(run)
    with local_executor(2) as process:
        stages.evaluate(other, executor=process)
    pairs = stored_pairs(run)
    assert len(pairs) == 2
    for file in (run.trials, *(run.plan(*pair) for pair in pairs)):
        there = other.path / file.relative_to(run.path)
        assert file.read_bytes() == there.read_bytes()
    found, expected = (
        {key: value for key, value in one.metrics().items() if "query_ms" not in key}
        for one in (other, run)
    )
    assert found == expected


@pytest.mark.usefixtures("skins_are_made_anew")
def test_a_plan_needs_nothing_that_is_kept(run, world):
    expected = stages.plan(run, 3, 20)
    kept = sorted(run.cache.iterdir())
    assert [file.name.split("-")[0] for file in kept] == ["skins"]
    for spoil in (lambda file: file.write_bytes(b"garbage"), lambda file: file.unlink()):
        for file in kept:
            spoil(file)
        bodies_of.keep(None, run.experiment, "another run")  # as in a new process
        motion = stages.plan(run, 3, 20)
        np.testing.assert_array_equal(motion.q, expected.q)
        np.testing.assert_array_equal(motion.predicted, expected.predicted)
    assert sorted(run.cache.iterdir()) == kept


def test_trials_score_first_tries_and_rehearsals(run, world):
    agent = load_agent(run, predicts=True)
    # What was rehearsed before does not count: the figures are the same every time.
    agent = agent.recalling(agent.memory.after(np.arange(20)))
    trials, _ = try_pairs(run, DrakeBodies(world), agent, stages.silent)
    figures = trial_metrics(trials)
    assert set(figures) <= {metric.key for metric in METRICS}
    assert figures["execution_num_pairs"] == 2
    # Practice repairs what the agent plans.
    assert figures["unpractised_contact_mean"] < figures["planning_contact_mean"]
    assert figures["unpractised_contact_worst"] <= figures["unpractised_contact_mean"]
    assert figures["unpractised_prediction_error_mean"] > figures["planning_prediction_error_mean"]
    assert figures["unpractised_execution_contact_mean"] < figures["execution_contact_mean"]
    assert figures["unpractised_execution_reach_rate"] <= figures["execution_reach_rate"]
    assert figures["rehearsal_contact_mean"] >= figures["execution_contact_mean"]
    assert figures["rehearsal_contact_worst"] >= figures["execution_contact_worst"]
    assert figures["rehearsal_reach_rate"] >= figures["execution_reach_rate"]
    assert 1.0 <= figures["rehearsal_tries_mean"] <= 3.0
    assert figures["execution_time_off_skin_s"] >= figures["rehearsal_time_off_skin_s"] >= 0.0
    assert figures["planning_impossible_postures"] == 0
    assert figures["execution_impossible_postures"] == 0
    assert 0 < figures["execution_tracking_rms_rad"] < 0.01
    assert "execution_tracking_rms_m" not in figures
    for kind in ("position", "velocity", "acceleration", "torque"):
        assert 0.0 < figures[f"execution_{kind}_of_limit"] <= 1.0
    table = trial_table(trials)
    assert table["pairs"].shape == (2, 2)
    assert table["contact_naive"].mean() == pytest.approx(figures["execution_contact_mean"])
    assert table["contact_kept"].mean() == pytest.approx(figures["rehearsal_contact_mean"])
    assert table["contact_remembering"][0] == table["contact_naive"][0]
    # What stays in the run is what the figures are about.
    shares = [load_execution(run, *pair).contact for pair in stored_pairs(run)]
    assert np.mean(shares) == pytest.approx(figures["execution_contact_mean"])
    # The sliding joints of another robot have a figure of their own.
    turns = np.array([True] * 4 + [False] * 2)
    sliding = [
        dataclasses.replace(one, truth=dataclasses.replace(one.truth, turns=turns))
        for one in trials
    ]
    mixed = trial_metrics(sliding)
    parts = (
        4 * mixed["execution_tracking_rms_rad"] ** 2 + 2 * mixed["execution_tracking_rms_m"] ** 2
    )
    assert np.sqrt(parts / 6) == pytest.approx(figures["execution_tracking_rms_rad"])


def test_before_practice_the_agent_has_followed_nothing(run, world, monkeypatch):
    agent = load_agent(run, predicts=True)
    planned = pilot_of(agent, world).plan(3, 41)
    blind = agent.plan(3, 41, q_start=pilot_of(agent, world).start_of(3, 41))
    np.testing.assert_array_equal(planned.unpractised.waypoints_q, blind.waypoints_q)
    # Its prediction asks no world: it is what the agent knows from stored touches.
    monkeypatch.setattr(world.probe, "touches", None)
    motion = pilot_of(agent, world).motion(planned.unpractised)
    expected = agent.predict(blind, motion.s)
    np.testing.assert_array_equal(motion.predicted, expected.sensation)


def test_a_robot_that_does_not_move_costs_its_pair_alone(run, world, monkeypatch):
    """It lies far from its path; the other pair is scored as ever."""
    take_log, number = simulation_of(world).take_log, itertools.count()

    def stuck():
        log = take_log()
        return dataclasses.replace(log, q=log.q[:1] + 0 * log.q) if next(number) < 2 else log

    monkeypatch.setattr(simulation_of(world), "take_log", stuck)
    execution = dataclasses.replace(run.experiment.execution, max_tries=1)
    run = RunDirectory(run.path, dataclasses.replace(run.experiment, execution=execution))
    trials, _ = try_pairs(run, DrakeBodies(world), load_agent(run), stages.silent)
    stayed, moved = (np.sqrt(one.truth.tracking.max()) for one in trials)
    assert stayed > 0.1 > 0.01 > moved
    assert trial_metrics(trials)["execution_tracking_rms_rad"] > 0.1 * stayed


def test_impossible_postures_are_counted_on_plans_and_on_every_step(run, world, monkeypatch):
    steps = []

    def impossible(q, margin=0.0):
        if margin:  # the agent asks before it acts
            return np.zeros(len(q), dtype=bool)
        steps.append(len(q))
        return np.arange(len(q)) < 5

    monkeypatch.setattr(world.probe, "impossible", impossible)
    run = with_pairs(run, 1)
    trials, _ = try_pairs(run, DrakeBodies(world), load_agent(run), stages.silent)
    figures = trial_metrics(trials)
    assert figures["planning_impossible_postures"] == 5
    assert figures["execution_impossible_postures"] == 5
    # Plans are sampled at 100 Hz, the plant steps at 200 Hz.
    planned, executed, unpractised = steps
    assert figures["planning_own_parts_overlap_share"] == pytest.approx(5 / planned)
    assert figures["unpractised_own_parts_overlap_share"] == pytest.approx(5 / unpractised)
    assert figures["unpractised_perfect_rate"] == 0.0
    assert figures["unpractised_lift_off_rate"] in (0.0, 1.0)
    assert executed == pytest.approx(2 * planned, abs=2)


def test_a_plan_on_which_rigid_parts_run_into_each_other_is_refused(run, world, monkeypatch):
    monkeypatch.setattr(
        world.probe, "impossible", lambda q, margin=0.0: np.ones(len(q), dtype=bool)
    )
    with pytest.raises(NoWayError, match=r"^no way to target 20 was found"):
        stages.plan(run, 3, 20)
    assert not list(run.path.glob("plans/*"))
    trials, without_way = try_pairs(run, DrakeBodies(world), load_agent(run), stages.silent)
    assert trials == []
    assert without_way == random_pairs(run.experiment, load_representation(run))


def test_the_command_line_plans_tours_and_free_starts(run, capsys):
    status, out, _ = output_of(capsys, "plan", run.path, "--through", "3,20,41")
    assert status == 0
    path = run.path / "plans" / "3-20-41.npz"
    assert out.splitlines()[-2] == f"plan: {path}"
    assert out.splitlines()[-1] == f"joint trajectory: {path.with_suffix('.csv')}"
    assert path.with_suffix(".csv").is_file()
    free = ("--from-q", "0.1,-0.5,0.3,0,0,0", "--to", 20)
    status, out, _ = output_of(capsys, "plan", run.path, *free)
    assert status == 0
    assert out.startswith("route: off ")
    assert (run.path / "plans" / "q=0.1,-0.5,0.3,0,0,0-20.npz").is_file()
    status, out, _ = output_of(capsys, "execute", run.path, *free)
    assert status == 0
    assert out.startswith("tracking: ")
    assert out.splitlines()[2] in ("sensation 20: reached", "sensation 20: missed")
    output_of(capsys, "execute", run.path, "--through", "3,20,41")
    status, out, _ = output_of(capsys, "record", run.path, "--through", "3,20,41")
    page = run.path / "plans" / "3-20-41.html"
    assert (status, out) == (0, f"recording: {page}\n")
    assert f"{run.experiment.name}: sensation 3 to 20 to 41" in page.read_text(encoding="utf-8")
    status, out, _ = output_of(
        capsys, "execute", run.path, "--from", 3, "--to", 20, "--rehearse", 2
    )
    assert status == 0
    assert out.startswith("tries: ")


ENDS = (
    "start or goal is missing, or given twice; give --from and --to, or --from-q and --to, "
    "or --through alone"
)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("plan --from 3", ENDS),
        ("plan --to 3", ENDS),
        ("plan --from 3 --to 4 --through 1,2", ENDS),
        ("plan --from 3 --to 4 --from-q 0,0,0,0,0,0", ENDS),
        ("execute --from-q 0,0", ENDS),
        ("plan --through 3", "--through is 3; give at least two target sensations"),
        (
            "plan --through 3,x",
            "Invalid value for '--through': '3,x' is not a list of numbers; "
            "give one such as 3,50,120",
        ),
        ("plan --through 3,60,1", "--through is 60; this run has target sensations 0 to 59"),
        ("plan --from-q 0,0,0,0,0,0 --to 60", "--to is 60; this run has target sensations 0 to 59"),
        (
            "plan --from-q 0,0 --to 1",
            "q_start is [0.0, 0.0]: give 6 finite numbers, one per joint",
        ),
        ("plan --from-q 0,-1.5,0,0,0,0 --to 1", LIMITS),
        (
            "plan --from-q 0,nan,0,0,0,0 --to 1",
            "q_start is [0.0, nan, 0.0, 0.0, 0.0, 0.0]: give 6 finite numbers, one per joint",
        ),
        (
            "execute --from 1 --to 2",
            "RUN has no plan from 1 to 2; make one with `selftouch plan RUN --from 1 --to 2`",
        ),
        (
            "execute --through 1,2,3",
            "RUN has no plan through 1,2,3; make one with `selftouch plan RUN --through 1,2,3`",
        ),
        (
            "execute --from-q=-0.5,0 --to 2",
            "RUN has no plan from q=-0.5,0 to 2; make one with "
            "`selftouch plan RUN --from-q Q --to 2`",
        ),
        (
            "record --from 1 --to 2",
            "RUN has no plan from 1 to 2; make one with `selftouch plan RUN --from 1 --to 2`",
        ),
        (
            "execute --through 1,2 --rehearse 2",
            "--rehearse is given with --through; use --from and --to instead",
        ),
        (
            "execute --from 1 --to 2 --rehearse 0",
            "Invalid value for '--rehearse': 0 is not in the range x>=1.",
        ),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line(run, capsys, arguments, message):
    verb, *options = arguments.split()
    status, out, err = output_of(capsys, verb, run.path, *options)
    assert (status, out) == (2, "")
    assert err == f"selftouch: {message}\n".replace("RUN", str(run.path))
