"""`selftouch skin`: which receptors of a run are faulty, and what changed between two runs."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from commands import refused, selftouch
from made_up import sphere_points
from scipy.spatial.distance import cdist

from selftouch_drake.agent.readings.receptor_faults import Fault
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import save_arrays
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.skin import (
    _require_same_places,
    check_skins,
    compare_runs,
    drift_lines,
    skins_of,
)

NUMBER = 40
PLACE, _ = sphere_points(NUMBER)


def recording(seed, change=lambda force: force):
    """Joints and readings: a ball of skin that a finger touches in one row of two."""
    rng = np.random.default_rng(seed)
    at = rng.normal(size=(1600, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    force = np.maximum(0.0, 1 - cdist(at, PLACE) / 0.8) * rng.uniform(0.3, 2.0, (len(at), 1))
    force[::2] = 0.0
    return {"q": np.c_[at, rng.normal(size=len(at))], "sensation": change(force)}


def imported(folder, name, arrays):
    np.savez(folder / f"{name}.npz", **arrays)
    small = ("--set", "{representation: {num_targets: 50}}", "--out", folder / name)
    done = selftouch("import", folder / f"{name}.npz", "--offset", 0, "--threshold", 0.01, *small)
    assert done.status == 0, done.stderr
    return folder / name


def faulty(force):
    force = force.copy()
    force[:, 7] = 0.0
    force[:, [3, 30]] = force[:, [30, 3]]
    return force


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("skin")
    taxels = folder / "taxels.csv"
    np.savetxt(taxels, PLACE, delimiter=",", header="x,y,z", comments="")
    return SimpleNamespace(
        well=imported(folder, "well", recording(0)),
        bad=imported(folder, "bad", recording(1, faulty)),
        taxels=taxels,
    )


def table(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_faults_are_printed_drawn_and_kept_in_a_table(runs, tmp_path):
    done = selftouch("skin", runs.bad, "--taxels", runs.taxels, "--out", tmp_path)
    assert done.status == 0, done.stderr
    assert "skin: 37 of 40 receptors are well, 3 are not" in done.stdout
    assert "felt none of" in done.stdout
    rows = table(tmp_path / "skin_faults.csv")
    verdicts = {n: row["verdict"] for n, row in enumerate(rows) if row["verdict"] != "well"}
    assert verdicts == {3: "exchanged", 7: "dead", 30: "exchanged"}
    assert (rows[3]["read_as"], rows[7]["read_as"]) == (rows[30]["receptor"], "")
    assert (tmp_path / "skin_faults.png").stat().st_size > 10_000


def test_without_a_file_it_says_what_it_cannot_tell(runs):
    done = selftouch("skin", runs.bad)
    assert done.status == 0, done.stderr
    assert "skin: 39 of 40 receptors are well, 0 are not, 1 were never met" in done.stdout
    assert "no file says where receptors are" in done.stdout
    assert (runs.bad / "skin_faults.csv").is_file()


def test_two_runs_show_what_changed(runs, tmp_path):
    done = selftouch("skin", runs.well, runs.bad, "--out", tmp_path)
    assert done.status == 0, done.stderr
    assert "skin: 3 of 40 receptors changed" in done.stdout
    assert "moved, only an accepted body model of the first run" in done.stdout
    changes = {n: r["change"] for n, r in enumerate(table(tmp_path / "skin_drift.csv"))}
    assert {n: what for n, what in changes.items() if what} == {
        3: "well -> exchanged",
        7: "well -> dead",
        30: "well -> exchanged",
    }
    assert (tmp_path / "skin_drift.png").stat().st_size > 5_000


def test_a_loose_contact_that_the_import_set_aside_is_reported(tmp_path):
    def loose(force):
        force = force.copy()
        on = np.random.default_rng(5).random(len(force)) < 0.3
        force[on, 9] = 1.0
        return force

    run = RunDirectory.open(imported(tmp_path, "loose", recording(2, loose)))
    (checked,) = check_skins(run, 1000)
    assert checked.faults.faulty.tolist() == [9]
    assert checked.faults.fault[9] == Fault.FLICKERS


def test_raw_readings_that_stand_still_are_dead_or_stuck_by_where_they_rest(tmp_path):
    arrays = recording(6)
    noise = np.random.default_rng(6).normal(size=arrays["sensation"].shape)
    raw = 20 + 100 * arrays["sensation"] + noise
    raw[:, 5], raw[:, 11] = 20.0, 250.0
    np.savez(tmp_path / "raw.npz", q=arrays["q"], sensation=raw)
    small = ("--set", "{representation: {num_targets: 50}}", "--out", tmp_path / "raw")
    assert selftouch("import", tmp_path / "raw.npz", *small).status == 0
    (checked,) = check_skins(RunDirectory.open(tmp_path / "raw"), 1000)
    faults = checked.faults
    assert {n: str(faults.fault[n]) for n in faults.faulty.tolist()} == {5: "dead", 11: "stuck"}
    assert faults.evidence[11] == "its raw reading stands still at 250"


def test_runs_of_other_robots_are_doubted(runs, tmp_path):
    def shuffled(force):
        return force[:, np.random.default_rng(0).permutation(NUMBER)]

    other = imported(tmp_path, "other", recording(4, shuffled))
    done = selftouch("skin", runs.well, other)
    assert "are these two runs of one robot, with receptors in one order?" in done.stdout


def test_mistakes_are_refused_in_one_line(runs, tmp_path):
    assert "is not a run: it has no experiment.yaml" in refused("skin", tmp_path)
    assert refused("skin", runs.bad, "--receptors", "0,3") == (
        "--receptors is given without --taxels; name the file"
    )
    with_file = ("skin", runs.bad, "--taxels", runs.taxels, "--receptors")
    assert refused(*with_file, "0,1,2") == (
        "--receptors has 3 numbers; give the first and the last, as in 0,99"
    )
    assert refused(*with_file, "0,40") == ("--receptors is 0,40; give two numbers from 0 to 39")
    assert "has 40 receptors, the skin 20; give a row for each" in refused(*with_file, "0,19")
    arrays = recording(3)
    arrays["sensation"] = arrays["sensation"][:, :-1]
    other = imported(tmp_path, "other", arrays)
    assert "other 39 and 4; give two runs of one robot" in refused("skin", runs.bad, other)


def test_experiments_of_two_seeds_are_two_robots(tmp_path):
    """Their receptors lie elsewhere; no robot is built for this."""
    found = []
    for seed in range(2):
        run = RunDirectory.create(tmp_path / str(seed), load_experiment("sphere", {"seed": seed}))
        place = sphere_points(50, radius=1 + 0.1 * seed)[0]
        save_arrays(run.skin, {"receptor_skin": np.zeros(50, int), "body_p_LS": place})
        found.append((run, skins_of(run, [str(n) for n in range(50)])))
    (first, skins), (second, others) = found
    _require_same_places(first, skins, first, skins)
    with pytest.raises(RunError, match="have receptors at other places, as experiments of two"):
        _require_same_places(first, skins, second, others)


def test_a_simulated_run_knows_its_places_and_whether_its_skin_moved(small_run):
    """The cube of the tests, whose receptors are all well."""
    (skin,) = skins_of(small_run, [str(n) for n in range(100)])
    assert skin.place.shape == (100, 3)
    (checked,) = check_skins(small_run, 2000)
    assert len(checked.faults.faulty) == 0
    (found,) = compare_runs(small_run, small_run, 2000)
    assert found.drift.changes == ()
    if found.move is not None:
        assert not found.move.surely
        assert "did not surely move as a whole" in drift_lines([found])[2]
        assert drift_lines([found])[1] == "joints: nothing moved, as touches say"
