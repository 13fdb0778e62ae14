"""Bodies of others in runs: calibrated at birth, led without jumps, stopped and resumed."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import selftouch
from lives import Travels, Walled

from selftouch_drake.agent.body import BodyError
from selftouch_drake.bodies.checked import CheckedBody
from selftouch_drake.bodies.user_body import UserBody
from selftouch_drake.experience.collect import collect_walk, require_complete
from selftouch_drake.experience.exploration import Exploration
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import experiment_from_fields
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory

LIVES = Path(__file__).with_name("lives.py")
SMALL = {
    "babbling": {"num_samples": 1500, "walk_size": 500},
    "representation": {"num_targets": 50, "body_model": "off"},
    "evaluation": {"num_pairs": 1},
}


def python(kind, **fields):
    return {"python": {"file": str(LIVES), "class": kind, **fields}}


def written(folder, kind="Travels", babbling=None, **fields):
    """An experiment's file; `fields` are of `python`."""
    file = folder / "mine.yaml"
    settings = SMALL | {"babbling": SMALL["babbling"] | (babbling or {})}
    file.write_text(yaml.safe_dump(python(kind, **fields) | settings))
    return file


def babble(file, run):
    return selftouch("babble", file, "--out", run, "--workers", 1)


def shards(run):
    return {file.name: file.read_bytes() for file in sorted((run / "experience").iterdir())}


@pytest.fixture
def toy():
    return Travels()


def born(toy, **babbling):
    experiment = experiment_from_fields(python("Travels") | {"babbling": babbling})
    living = UserBody(CheckedBody(toy))
    return experiment, living, living.find_baseline(experiment)


def test_at_birth_it_calibrates_its_receptors(toy):
    _, living, baseline = born(toy)
    assert toy.robot_s < 120
    still = toy.lower.copy()
    assert not living.babbling.feel(still[None]).sensation.any()
    pressed = living.babbling.feel(np.array([[0.5, 0.5, 0.4]])).sensation
    assert pressed.any()
    assert set(baseline.to_arrays()) >= {"threshold", "level", "row"}


def test_to_the_start_of_a_motion_it_goes_round_what_is_in_the_way():
    toy = Walled()
    living = born(toy)[1]
    for start in np.array([[0.1, 0.5, 0.3], [0.9, 0.5, 0.4], [0.2, 0.1, 0.4], [0.8, 0.3, 0.2]]):
        living.follow(np.array([0.0, 1.0]), np.array([start, start - [0, 0.1, 0]]))
        assert np.allclose(toy.asked[-1][3], start)


def test_before_birth_nothing_is_felt(toy):
    with pytest.raises(BodyError, match="Travels is not calibrated: babble first"):
        _ = UserBody(CheckedBody(toy)).babbling


def test_the_calibration_is_kept_in_a_file_of_the_run(tmp_path):
    file, run = written(tmp_path, babbling={"num_samples": 500}), tmp_path / "run"
    assert babble(file, run).status == 0
    kept = (run / "calibration.npz").read_bytes()
    (run / "metrics.json").unlink()
    assert babble(file, run).status == 0
    assert (run / "calibration.npz").read_bytes() == kept


@pytest.mark.parametrize("strategy", ["random", "active"])
def test_a_body_that_travels_is_led_without_jumps(toy, strategy):
    experiment, living, _ = born(toy, strategy=strategy)
    began = toy.robot_s
    if strategy == "random":
        shards = [collect_walk(living.babbling, experiment, 0, 600)]
    else:
        exploration = Exploration(experiment, living.babbling)
        shards = []
        for _ in range(4):
            shards.append(exploration.explore(250))
            exploration.remember(shards[-1].q, shards[-1].sensation)
    motions = [asked[1:] for asked in toy.asked if asked[0] == "follow"]
    for path, time_s, at in motions:
        np.testing.assert_allclose(path[0], at)
        assert (np.abs(np.diff(path, axis=0)) <= 1.01 * np.diff(time_s)[:, None]).all()
    # It travels by `feel` where a walk or round begins, and goes on where a motion ended.
    assert sum(asked[0] == "feel" for asked in toy.asked) <= 2 * (len(shards) + 1)
    q = np.concatenate([shard.q for shard in shards])
    assert (np.diff(q, axis=0) == 0).all(axis=1).mean() < 0.05
    assert sum(shard.robot_s for shard in shards) == pytest.approx(toy.robot_s - began, rel=0.1)


@pytest.mark.parametrize("strategy", ["random", "active"])
def test_babbling_ends_with_what_it_has_when_its_hours_are_over(tmp_path, strategy):
    hours = {"robot_hours": 0.01, "num_samples": 100_000, "strategy": strategy}
    file, path = written(tmp_path, babbling=hours), tmp_path / "run"
    done = babble(file, path)
    assert done.status == 0, done.stderr
    metrics = json.loads((path / "metrics.json").read_text())
    assert 36 <= metrics["babbling_robot_s"] < 60
    assert 0 < metrics["babbling_num_samples"] < 100_000
    run = RunDirectory.open(path)
    assert stages.has_babbled(run)
    require_complete(run.experiment, path, fingerprint=run.fingerprint())
    before = shards(path)
    assert babble(file, path).status == 0
    assert shards(path) == before


def test_hours_are_refused_for_a_body_that_keeps_no_time(tmp_path):
    overrides = "{babbling: {robot_hours: 1, num_samples: 1000}}"
    done = selftouch("babble", "sphere", "--out", tmp_path / "run", "--set", overrides)
    assert done.status == 2
    assert done.stderr.splitlines()[-1].startswith(
        "selftouch: babbling.robot_hours is 1, but the body is set to its postures"
    )


def test_hours_are_refused_for_a_body_of_ones_own_that_keeps_no_time(tmp_path):
    done = babble(written(tmp_path, "Jumps", babbling={"robot_hours": 1}), tmp_path / "run")
    assert done.status == 2
    assert "babbling.robot_hours is 1, but the body is set to its postures" in done.stderr


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("feel = None", "Mine has no method feel; write one, as "),
        ("lower = np.full(3, 2.0)", "Mine: lower of x is 2, and upper 1; give the smaller one as"),
        ("touch = lambda self, q: np.zeros((len(q), 3))", "Mine: feel returned sensation of shape "
         "(256, 3); return (256, 16), each time"),
        ("touch = lambda self, q: np.full((len(q), 16), np.nan)", "Mine: feel returned sensation "
         "with nan at [0, 0]; return the last good reading, or reached False"),
        ("feel = lambda self, q: Felt(q=q, sensation=self.touch(q)[:, self.calls.pop():], "
         "reached=q[:, 0] > -1)\n    calls = [2] + 20 * [0]\n    __init__ = lambda self: None",
         "Mine: feel returned sensation of shape (256, 14); return (256, 16), each time"),
        ("touch = lambda self, q: np.full((len(q), 16), 10.0)", "babbling touched nothing in "),
    ],
)  # fmt: skip
def test_mistakes_of_a_body_are_one_line(tmp_path, monkeypatch, text, line):
    monkeypatch.setattr(sys.modules[collect_walk.__module__], "PATIENCE", 20_000)
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom toys import Flat, Felt\n\nclass Mine(Flat):\n    " + text
    )
    settings = SMALL | {"python": {"file": "mine.py", "class": "Mine"}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(settings))
    done = babble(tmp_path / "mine.yaml", tmp_path / "run")
    assert done.status == 2
    (said,) = [one for one in done.stderr.splitlines() if one.startswith("selftouch: ")]
    assert said.startswith(f"selftouch: {line}")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("how", "status", "line"),
    [
        ("raises", 2, "Travels.follow raised OSError: cable is loose (line "),
        ("hangs", 2, "Travels.follow did not return in "),
        ("ctrl-c", 130, "stopped; give the same command again to resume"),
    ],
)
def test_a_body_that_breaks_stops_the_run_which_resumes(tmp_path, monkeypatch, how, status, line):
    breaks = tmp_path / "breaks.json"
    monkeypatch.setenv("TOY_BREAKS", str(breaks))
    # A hanging motion is waited for three times its duration.
    slow = {"step_duration": 0.02} if how == "hangs" else {}
    file = written(
        tmp_path, timeout_s=0.5, babbling={"walk_size": 100, "strategy": "active"} | slow
    )
    run = tmp_path / "run"
    breaks.write_text(json.dumps({"motion": 400, "how": how}))
    done = babble(file, run)
    assert done.status == status
    assert line in done.stderr.splitlines()[-1]
    assert not breaks.exists()
    kept = shards(run)
    assert kept
    again = babble(file, run)
    assert again.status == 0, again.stderr
    assert kept.items() <= shards(run).items()
    assert ExperienceReader(run / "experience").num_rows == 1500
