"""Commands that plan and execute, as a user sees them."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
from commands import files_below, refused, selftouch

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.cli.plan import doubts_in_words, route_in_words, tracking_in_words


def test_stages_one_by_one(finished_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    planned = selftouch("plan", run, "--from", 0, "--to", 59)
    assert planned.status == 0, planned.stderr
    assert planned.stdout.startswith("route: 0 ")
    executed = selftouch("execute", run, "--from", 0, "--to", 59)
    assert executed.status == 0, executed.stderr
    assert "in contact: " in executed.stdout
    path = run / "plans" / "0-59.npz"
    rows = len(np.load(path)["q_measured"])
    assert (
        f"stored: what the joints did (q_measured) and what was felt (felt), {rows} rows\n"
        f"plan: {path}\njoint trajectory: {path.with_suffix('.csv')}\n"
    ) in executed.stdout
    header, *lines = path.with_suffix(".csv").read_text().splitlines()
    joints = json.loads((run / "joints.json").read_text())
    assert header.split(",") == ["time_s", *joints, *(f"{name}_velocity" for name in joints)]
    table = np.array([line.split(",") for line in lines], dtype=float)
    np.testing.assert_allclose(table[:, 1 : 1 + len(joints)], np.load(path)["q"], rtol=1e-7)


def test_target_out_of_range_is_refused(finished_run):
    before = files_below(finished_run)
    for verb in ("plan", "execute"):
        line = refused(verb, finished_run, "--from", 0, "--to", 60)
        assert line == "--to is 60; this run has target sensations 0 to 59"
    assert files_below(finished_run) == before


def test_a_receptor_is_a_goal(finished_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    targets = np.load(run / "representation.npz")["target_sensations"]
    receptor = int(targets.sum(axis=0).argmax())
    goal = int(targets[:, receptor].argmax())
    start = (goal + 1) % len(targets)
    for given in (receptor, f"body[{receptor}]"):
        planned = selftouch("plan", run, "--from", start, "--to-receptor", given)
        assert planned.status == 0, planned.stderr
        assert f"receptor body[{receptor}]: target sensation {goal}\n" in planned.stdout
        assert (run / "plans" / f"{start}-{goal}.npz").exists()
    most = targets.shape[1]
    for bad, line in (
        (most, f"--to-receptor: receptor is {most}; give 0 to {most - 1}"),
        (
            "palm",
            f"--to-receptor is palm; give 0 to {most - 1}, or a name from body[0] to "
            f"body[{most - 1}]",
        ),
    ):
        assert refused("plan", run, "--from", 0, "--to-receptor", bad) == line
    line = refused("plan", run, "--from", 0, "--to", 1, "--to-receptor", 1)
    assert line == "--to and --to-receptor are both given; give one of them"


def test_a_pattern_is_a_goal(finished_run, tmp_path):
    run, file = tmp_path / "run", tmp_path / "pattern.csv"
    shutil.copytree(finished_run, run)
    targets = np.load(run / "representation.npz")["target_sensations"]
    np.savetxt(file, 3.0 * targets[[7]], delimiter=",")
    planned = selftouch("plan", run, "--from", 2, "--to-pattern", file)
    assert planned.status == 0, planned.stderr
    assert "most alike: target sensation 7\n" in planned.stdout
    num = targets.shape[1]
    for text, line in (
        (
            "1,2\n",
            f"--to-pattern: {file} has 1 rows of 2 numbers; give one row of {num}, the "
            "reading of each receptor",
        ),
        (
            ",".join(["0"] * num),
            f"--to-pattern: nothing is felt in {file}; give readings of a touch",
        ),
    ):
        file.write_text(text)
        assert refused("plan", run, "--from", 0, "--to-pattern", file) == line
    file.write_text("a,b")
    assert refused("plan", run, "--from", 0, "--to-pattern", file).startswith("--to-pattern: ")


def test_a_place_on_the_body_model_is_a_goal(finished_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    place = np.load(run / "body_model.npz")["kernel_place"][7] + 1e-3
    given = ",".join(map(str, [0, *place.tolist()]))
    planned = selftouch("plan", run, "--from", 2, "--to-place", given)
    assert planned.status == 0, planned.stderr
    assert "nearest place that it knows: target sensation 7\n" in planned.stdout
    for given, line in (
        ("0,1", "--to-place is 0,1; give the number of a part and x, y, z"),
        ("9,0,0,0", "--to-place: part is 9; the model has parts 0 to 0"),
    ):
        assert refused("plan", run, "--from", 0, "--to-place", given) == line


def test_a_plan_through_the_air_is_shown():
    def route(nodes, in_air):
        plan = SimpleNamespace(nodes=np.array(nodes), in_air=np.array(in_air, dtype=bool))
        return route_in_words(SimpleNamespace(plan=plan))

    assert route([3, 17, 120, 131], [False, True, False]) == "3 17 | lifts off | 120 131"
    off = "off 120 7\n       off: nothing is felt there"
    assert route([NO_KERNEL, 120, 7], [True, False]) == off
    again = "10 228 10* 240\n       *: felt again, in another posture"
    assert route([10, 228, 10, 240], [False, False, False]) == again
    assert route([5], []) == "5"


def test_tracking_is_given_in_the_unit_of_each_joint():
    def tracking(world, off):
        planned = np.ones((4, 3))
        execution = SimpleNamespace(q_measured=planned + off, motion=SimpleNamespace(q=planned))
        return tracking_in_words(execution, world)

    def world(turns, slip):
        return SimpleNamespace(
            robot=SimpleNamespace(turns=np.array(turns)),
            slip=np.array(slip),
        )

    turning, sliding, mixed = [True] * 3, [False] * 3, [True, False, True]
    off = np.array([0.003, 0.002, -0.003])
    assert tracking(world(turning, [0, 0, 0]), 0.0125) == "12.5 mrad"
    assert tracking(world(sliding, [0, 0, 0]), 0.0125) == "12.5 mm"
    assert tracking(world(mixed, [0, 0, 0]), off) == "3.0 mrad, 2.0 mm"
    assert tracking(world(mixed, [0.003, 0, -0.003]), off) == "0.0 mrad, 2.0 mm"
    assert tracking(None, 0.0126) == "0.013"  # no unit is known


def test_what_may_go_wrong_is_said():
    motion = SimpleNamespace(plan=SimpleNamespace(doubts=("contact may be lost",)))
    assert doubts_in_words(motion) == [
        "doubt: contact may be lost; nobody has followed this plan",
    ]
