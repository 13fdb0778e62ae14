"""A recording, and the body that made it: plans are practised in it, and life goes on there."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import refused, selftouch
from lives import Bumpy

from selftouch_drake.agent.lifelong import life as life_module
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.files import load_arrays
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.page import motion_figures
from selftouch_drake.show.run_data import RunData

LIVES = Path(__file__).with_name("lives.py")
BODY = ("--body", f"{LIVES}:Bumpy")
PLAN = ("--from", 3, "--to", 40)


def done(*words):
    found = selftouch(*words)
    assert found.status == 0, found.stderr
    return found


def metrics(run):
    return json.loads((run / "metrics.json").read_text())


def imported(folder, num_rows):
    """A run with touches in a fifteenth of the postures that were recorded."""
    body = Bumpy()
    q = np.random.default_rng(0).uniform(body.lower, body.upper, (num_rows, 3))
    felt = body.feel(q)
    np.savez(
        folder / "toy.npz",
        q=q[felt.reached],
        touch=felt.sensation[felt.reached],
        joint_names=np.array(body.joint_names),
    )
    settings = "{representation: {num_targets: 50, metric: sensorimotor, body_model: off}}"
    done("import", folder / "toy.npz", "--out", folder / "run", "--set", settings)
    return folder / "run"


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    run = imported(tmp_path_factory.mktemp("recorded"), 4000)
    done("learn", run)
    return run


@pytest.fixture
def run(learned, tmp_path):
    shutil.copytree(learned, tmp_path / "run")
    return tmp_path / "run"


def test_plans_are_practised_executed_and_rehearsed_in_it(run):
    done("plan", run, *PLAN, *BODY)
    assert run.joinpath("plans", "3-40.csv").exists()
    practised = load_arrays(run / "plans" / "3-40.npz")
    felt = Bumpy().feel(practised["q"])
    assert felt.reached.all()
    found = done("execute", run, *PLAN, "--rehearse", 2, *BODY)
    assert "in contact: 100.0% of the time" in found.stdout
    assert "sensation 40: reached" in found.stdout
    assert "felt" in load_arrays(run / "plans" / "3-40.npz")


@pytest.mark.slow
def test_what_practice_met_makes_the_next_plans_better(run):
    done("evaluate", run, *BODY)
    before = metrics(run)
    added = done("learn", run, "--add").stdout
    num = ExperienceReader(run / "added").num_rows
    assert f"added so far: {num:,} touches" in added
    assert num > 2 * ExperienceReader(run / "experience").num_rows
    assert not list((run / "met").iterdir())
    done("evaluate", run, *BODY)
    after = metrics(run)
    lost, still_lost = (1 - some["unpractised_contact_mean"] for some in (before, after))
    assert still_lost < 0.5 * lost


def test_its_life_goes_on_in_the_body_and_notices_what_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(life_module, "_FIRST", 500)
    monkeypatch.setitem(Life.__init__.__kwdefaults__, "num_steps", 200)
    run = imported(tmp_path, 15_000)
    recorded = ExperienceReader(run / "experience").num_rows
    done("live", run, "--no-page")
    alone = load_arrays(run / "life.npz")
    assert recorded - 500 < alone["block_touches"][-1] <= recorded
    found = done("live", run, "--body", f"{LIVES}:Wounded", "--touches", 2000)
    assert "no page: it needs a robot that Drake simulates" in found.stderr
    life = load_arrays(run / "life.npz")
    assert life["block_touches"][-1] > recorded + 1500
    assert (life["noticed"] > recorded).all()
    assert len(life["noticed"]) == 1
    assert np.isnan(life["error"]).all()
    assert ExperienceReader(run / "met").num_rows >= 2000
    assert len(motion_figures.life(RunData(RunDirectory.open(run))).axes) == 2


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("evaluate", "RUN", "--body", f"{LIVES}:OtherJoints"), "--body has the joints x, y, "
         "thumb, and the run x, y, press; give the body that was recorded, with the names of its "
         "columns"),
        (("live", "RUN", "--body", f"{LIVES}:FewerReceptors"), "--body has 15 receptors, and the "
         "run 16; give the body that was recorded"),
        (("live", "RUN", "--set", "{seed: 3}"), "RUN is a run: leave --out and --set out"),
    ],
)  # fmt: skip
def test_another_body_is_refused(learned, words, line):
    words = [str(word).replace("RUN", str(learned)) for word in words]
    assert refused(*words) == line.replace("RUN", str(learned))


def test_a_body_that_feels_nothing_where_the_run_did_is_said(run):
    done = selftouch("plan", run, *PLAN, "--body", f"{LIVES}:Numb")
    assert "selftouch: warning: --body feels something at 0 of " in done.stderr


def test_a_robot_of_drakes_has_its_body(tmp_path):
    done = selftouch("live", "sphere", "--out", tmp_path / "run", *BODY)
    assert done.status == 2
    assert f"selftouch: --body is {BODY[1]}, but {tmp_path / 'run'} has a robot that" in done.stderr
