"""Plans, tours, free starts and rehearsals of a small run, from Python and the command line."""

import dataclasses
import re
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from selftouch_drake.agent.rehearsal import RehearsalMemory
from selftouch_drake.cli import main
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.motions import PLAN_ARRAYS, load_memory
from selftouch_drake.run.trials import score_motions

SMALL = {
    "babbling": {"num_samples": 3000, "walk_size": 1500},
    "representation": {"num_targets": 60, "metric": "motor"},
    "execution": {"max_tries": 3},
    "evaluation": {"num_pairs": 2},
}
LIMITS = "q_start[1] is -1.5 rad: give one within the joint's limits, -1 to 2.6 rad"


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    experiment = load_experiment("cube", SMALL)
    run = RunDirectory.create(tmp_path_factory.mktemp("runs") / "cube", experiment)
    world = stages.World(experiment)
    with ThreadPoolExecutor(1) as executor:
        stages.babble(run, world, executor)
    stages.learn(run)
    return run, world


@pytest.fixture
def run(learned, tmp_path):
    shutil.copytree(learned[0].path, tmp_path / "run")
    return RunDirectory.open(tmp_path / "run")


@pytest.fixture(scope="module")
def world(learned):
    return learned[1]


def told(capsys, *arguments):
    """Exit status, and what was said on stdout and stderr."""
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    said = capsys.readouterr()
    return end.value.code, said.out, said.err


def test_a_tour_is_planned_and_executed_as_one_motion(run, world):
    plan = stages.Pilot(run).plan(3, 20, 41)
    assert plan["nodes"][0] == 3
    assert plan["nodes"][-1] == 41
    assert 20 in plan["nodes"]
    motion = stages.execute(run, world, 3, 20, 41)
    assert set(PLAN_ARRAYS) | {"felt", "q_measured"} <= motion.keys()
    assert np.array_equal(load_arrays(run.path / "plans" / "3-20-41.npz")["felt"], motion["felt"])
    assert np.array_equal(stages.Pilot(run).plan(3, 20, 41)["q"], plan["q"])


def test_an_arm_in_the_air_goes_to_touch(run, world):
    q_start = np.array([0.1, -0.5, 0.3, 0.0, 0.0, 0.0])
    plan = stages.Pilot(run).plan_from(world, q_start, 20)
    assert plan["nodes"][0] == -1
    assert np.allclose(plan["q"][0], q_start)
    felt = stages.execute(run, world, "free", 20)["felt"]
    assert not felt[0].any()
    assert felt.any()


def test_an_arm_that_touches_starts_from_what_it_feels(run, world):
    pilot = stages.Pilot(run)
    known = pilot.representation
    q_start = known.kernel_q[known.members(7)][0].astype(float)
    assert pilot.plan_from(world, q_start, 20)["nodes"][0] == 7


def test_a_start_outside_the_limits_is_refused_before_it_is_felt(run, world):
    with pytest.raises(ValueError, match=f"^{re.escape(LIMITS)}$"):
        stages.Pilot(run).plan_from(world, np.array([0.1, -1.5, 0.3, 0.0, 0.0, 0.0]), 20)


def test_rehearsal_never_makes_a_plan_worse_and_is_remembered(run, world):
    tries = stages.rehearse(run, world, 3, 20, max_tries=3)
    assert 1 <= len(tries) <= 3
    representation = stages.load_representation(run)
    memory = load_memory(run, representation)
    assert memory.num_tries == len(tries)
    for one in tries:
        assert np.all(memory.link_penalty[one.lost_links] > 1.0)
    kept = stages.judged(load_arrays(run.plan(3, 20)), 20, representation)
    assert (kept.reached, kept.contact) >= (tries[0].reached, tries[0].contact)


def test_later_plans_keep_off_what_rehearsals_lost(run):
    representation = stages.load_representation(run)
    before = stages.Pilot(run).plan(3, 20)
    RehearsalMemory.blank(representation).after(before["links"]).save(run.rehearsal)
    after = stages.Pilot(run).plan(3, 20)
    assert not np.array_equal(after["nodes"], before["nodes"])


def test_to_learn_again_is_to_forget_rehearsals(run):
    RehearsalMemory.blank(stages.load_representation(run)).save(run.rehearsal)
    stages.learn(run)
    assert not run.rehearsal.exists()


def test_a_memory_that_does_not_belong_is_refused(run):
    RehearsalMemory.blank(stages.load_representation(run)).save(run.rehearsal)
    arrays = load_arrays(run.rehearsal)
    save_arrays(run.rehearsal, arrays | {"belongs_to": np.array("another")})
    with pytest.raises(ValueError, match="remembers rehearsals of another representation"):
        stages.Pilot(run)


def test_a_representation_that_does_not_belong_is_refused(run):
    text = (run.path / "experiment.yaml").read_text()
    (run.path / "experiment.yaml").write_text(text.replace("num_targets: 60", "num_targets: 70"))
    with pytest.raises(RunError) as error:
        stages.Pilot(RunDirectory.open(run.path))
    assert str(error.value) == (
        f"{run.representation} has 60 targets over 100 receptors, the experiment 70 over 100; "
        f"run `selftouch learn {run.path}`"
    )


def test_a_representation_of_another_experience_is_refused(run):
    known = stages.load_representation(run)
    dataclasses.replace(known, kernel_q=known.kernel_q + np.float32(0.01)).save(run.representation)
    with pytest.raises(RunError) as error:
        stages.Pilot(run)
    assert str(error.value) == (
        f"{run.representation} is of another experiment or version; "
        f"run `selftouch learn {run.path}`"
    )


def test_a_plan_to_where_one_is_stays_and_is_reached(run, world):
    plan = stages.Pilot(run).plan(7, 7)
    assert plan["nodes"].tolist() == [7]
    assert np.allclose(plan["q"], plan["q"][0])
    kept = stages.judged(stages.execute(run, world, 7, 7), 7, stages.load_representation(run))
    assert kept.perfect


def test_an_arm_that_does_not_follow_is_told_honestly(run):
    limp = {"stiffness": 1.0, "damping": 1.0}
    world = stages.World(load_experiment("cube", SMALL | {"execution": limp}))
    stages.Pilot(run).plan(3, 20)
    motion = stages.execute(run, world, 3, 20)
    kept = stages.judged(motion, 20, stages.load_representation(run))
    assert not kept.perfect
    assert stages.tracking_rms(motion) > 0.05


def test_trials_tell_of_first_tries_and_of_rehearsals(run, world):
    # What was rehearsed before does not count: the figures are the same every time.
    blank = RehearsalMemory.blank(stages.load_representation(run))
    blank.after(np.arange(20)).save(run.rehearsal)
    figures = score_motions(run, world, stages.silent)
    assert figures["execution_num_pairs"] == 2
    assert figures["rehearsal_contact_mean"] >= figures["execution_contact_mean"]
    assert figures["rehearsal_contact_worst"] >= figures["execution_contact_worst"]
    assert figures["rehearsal_reach_rate"] >= figures["execution_reach_rate"]
    assert 1.0 <= figures["rehearsal_tries_mean"] <= 3.0
    assert figures["execution_fingertip_jerk_reduction"] > 5.0
    assert figures["execution_time_off_skin_s"] >= figures["rehearsal_time_off_skin_s"] >= 0.0
    for kind in ("position", "velocity", "acceleration", "torque"):
        assert 0.0 < figures[f"execution_{kind}_of_limit"] <= 1.0
    table = load_arrays(run.trials)
    assert table["pairs"].shape == (2, 2)
    assert table["contact_naive"].mean() == pytest.approx(figures["execution_contact_mean"])
    assert table["contact_kept"].mean() == pytest.approx(figures["rehearsal_contact_mean"])
    assert table["contact_remembering"][0] == table["contact_naive"][0]
    # What stays in the run is what the figures are about.
    shares = [
        load_arrays(path)["felt"].any(axis=1).mean() for path in (run.path / "plans").glob("*.npz")
    ]
    assert np.mean(shares) == pytest.approx(figures["execution_contact_mean"])


def test_the_command_line_plans_tours_and_free_starts(run, capsys):
    status, out, _ = told(capsys, "plan", run.path, "--through", "3,20,41")
    assert status == 0
    assert out.splitlines()[-1] == f"plan: {run.path / 'plans' / '3-20-41.npz'}"
    free = ("--from-q", "0.1,-0.5,0.3,0,0,0", "--to", 20)
    status, out, _ = told(capsys, "plan", run.path, *free)
    assert status == 0
    assert out.startswith("route: off ")
    status, out, _ = told(capsys, "execute", run.path, "--free", "--to", 20)
    assert status == 0
    assert out.startswith("tracking: ")
    assert out.splitlines()[2] in ("sensation 20: reached", "sensation 20: missed")
    told(capsys, "execute", run.path, "--through", "3,20,41")
    status, out, _ = told(capsys, "record", run.path, "--through", "3,20,41")
    page = run.path / "plans" / "3-20-41.html"
    assert (status, out) == (0, f"recording: {page}\n")
    assert f"{run.experiment.name}: sensation 3 to 20 to 41" in page.read_text(encoding="utf-8")
    status, out, _ = told(capsys, "execute", run.path, "--from", 3, "--to", 20, "--rehearse", 2)
    assert status == 0
    assert out.startswith("tries: ")


ENDS = (
    "a plan has a start and a goal: give --from and --to, or --through alone, "
    "or a free start and --to"
)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("plan --from 3", ENDS),
        ("plan --to 3", ENDS),
        ("plan --from 3 --to 4 --through 1,2", ENDS),
        ("plan --from 3 --to 4 --from-q 0,0,0,0,0,0", ENDS),
        ("execute --free", ENDS),
        ("plan --through 3", "--through is 3; give two target sensations or more"),
        (
            "plan --through 3,x",
            "Invalid value for '--through': '3,x' is not a list of numbers, as in 3,50,120",
        ),
        ("plan --through 3,60,1", "--through is 60; this run has target sensations 0 to 59"),
        ("plan --from-q 0,0,0,0,0,0 --to 60", "--to is 60; this run has target sensations 0 to 59"),
        (
            "plan --from-q 0,0 --to 1",
            "q_start has shape (2,): this representation needs (6,), one angle a joint",
        ),
        ("plan --from-q 0,-1.5,0,0,0,0 --to 1", LIMITS),
        (
            "plan --from-q 0,nan,0,0,0,0 --to 1",
            "q_start is [0.0, nan, 0.0, 0.0, 0.0, 0.0]: give finite joint angles in rad",
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
            "execute --free --to 2",
            "RUN has no free plan to 2; make one with `selftouch plan RUN --from-q Q --to 2`",
        ),
        ("record --from 1 --to 2", "plan 1-2 is not there; run `selftouch plan`"),
        ("execute --through 1,2 --rehearse 2", "--rehearse takes --from and --to"),
        (
            "execute --from 1 --to 2 --rehearse 0",
            "Invalid value for '--rehearse': 0 is not in the range x>=1.",
        ),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line(run, capsys, arguments, message):
    verb, *options = arguments.split()
    status, out, err = told(capsys, verb, run.path, *options)
    assert (status, out) == (2, "")
    assert err == f"selftouch: {message}\n".replace("RUN", str(run.path))
