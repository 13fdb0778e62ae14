"""`selftouch map`: where the receptors are, from few touches."""

import csv

import numpy as np
import pytest
from commands import refused, selftouch
from scipy.spatial.distance import cdist
from scipy.stats import spearmanr

from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.agent.shape.receptor_map import map_receptors
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.receptor_map import receptor_names

PITCH, FIELD = 1.0, 1.6


def patch(num_touches=200, rows=4, columns=7, seed=0):
    """Touches of a flat patch by two joints that slide over it, and one that does nothing."""
    rng = np.random.default_rng(seed)
    places = PITCH * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    touched = rng.uniform([-0.5, -0.5], [columns - 0.5, rows - 0.5], (num_touches, 2))
    q = np.c_[touched @ [[0.1, 0.02], [-0.03, 0.12]], rng.normal(size=num_touches)]
    return places, q, (cdist(touched, places) < FIELD).astype(float)


def table(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    places, q, sensation = patch()
    sensation[:, 7] = 0.0
    sensation[[3, 150], 7] = 1.0
    np.savez(folder / "touches.npz", q=q, sensation=sensation)
    done = selftouch("map", folder / "touches.npz", "--offset", 0, "--threshold", 0.5)
    assert done.status == 0, done
    return places, done, folder / "touches"


def test_receptors_lie_where_they_are_up_to_turn_and_scale(mapped):
    places, _, folder = mapped
    rows = table(folder / "map.csv")
    kept = np.array([row["x"] != "" for row in rows])
    found = np.array([[row["x"], row["y"]] for row in rows if row["x"]], dtype=float)
    assert kept.sum() == len(places) - 1
    i = np.triu_indices(kept.sum(), 1)
    assert spearmanr(cdist(found, found)[i], cdist(places[kept], places[kept])[i])[0] > 0.95
    error = np.array([row["error"] for row in rows if row["x"]], dtype=float)
    assert np.all(error > 0)
    assert np.median(error) < 1.0


def test_what_is_not_known_is_said(mapped):
    _, done, folder = mapped
    assert "part 0: 27 receptors in a plane" in done.stdout
    assert "doubt: 1 receptors (sensation[7]) felt fewer than 5 touches and were left out" in (
        done.stdout
    )
    assert table(folder / "map.csv")[7]["part"] == ""
    assert (folder / "map.png").stat().st_size > 10_000


def test_a_run_gives_the_same_map_as_its_recording(mapped, tmp_path):
    _, _, folder = mapped
    data, run = folder.with_suffix(".npz"), tmp_path / "run"
    small = ("--set", "{representation: {num_targets: 50}}", "--out", run)
    assert selftouch("import", data, "--offset", 0, "--threshold", 0.5, *small).status == 0
    assert selftouch("map", run).status == 0
    one, other = (table(where / "map.csv") for where in (folder, run))
    # A run keeps joint positions in single precision.
    assert [row["touches"] for row in one] == [row["touches"] for row in other]
    for a, b in zip(one, other, strict=True):
        assert (a["x"] == b["x"] == "") or abs(float(a["x"]) - float(b["x"])) < 0.05
    assert "--q is given, but" in refused("map", run, "--q", "q")


def test_two_skins_are_two_parts(tmp_path):
    _, _, one = patch(200, 4, 5)
    other = np.zeros_like(one)
    sensation = np.r_[np.c_[one, other], np.c_[other, one]]
    rng = np.random.default_rng(1)
    np.savez(tmp_path / "two.npz", q=rng.normal(size=(400, 3)), sensation=sensation)
    done = selftouch("map", tmp_path / "two.npz", "--offset", 0, "--threshold", 0.5)
    parts = [row["part"] for row in table(tmp_path / "two" / "map.csv")]
    assert (len(set(parts[:20])), len(set(parts[20:])), len(set(parts))) == (1, 1, 2), done


def test_a_recording_without_enough_touches_is_refused(tmp_path):
    _, q, sensation = patch(60)
    sensation[:, 6:] = 0.0
    np.savez(tmp_path / "few.npz", q=q, sensation=sensation)
    line = refused("map", tmp_path / "few.npz", "--offset", 0, "--threshold", 0.5)
    assert "receptors felt 5 touches or more; record touches until at least 8 did" in line


def test_errors_hold_what_a_plane_leaves_out():
    # A patch bent to a quarter of a tube, which is laid out in a plane.
    flat, q, sensation = patch(rows=5, columns=9, num_touches=400)
    turn = np.pi / 2 * (flat[:, 0] - 4) / 9
    bent = np.c_[18 / np.pi * np.sin(turn), flat[:, 1], 18 / np.pi * np.cos(turn)]
    found = map_receptors(q, sensation, [str(n) for n in range(len(flat))])
    assert found.parts[0].flat
    off = np.linalg.norm(align(found.positions, bent) - bent, axis=1)
    assert np.mean(off < 2 * found.error) > 0.9


def test_an_imported_run_keeps_the_names_of_its_taxels(tmp_path):
    _, q, sensation = patch()
    names = [f"palm{row}_t{column}" for row in range(4) for column in range(7)]
    with (tmp_path / "touches.csv").open("w", newline="") as file:
        csv.writer(file).writerow(["yaw", "pitch", "roll", *names])
        for at, felt in zip(q, sensation, strict=True):
            # A row at rest behind each touch.
            csv.writer(file).writerows([[*at, *felt], [*at, *np.zeros(len(names))]])
    path = tmp_path / "run"
    done = selftouch(
        "import", tmp_path / "touches.csv", "--q", "yaw..roll", "--sensation", "palm*",
        "--out", path, "--set", "{representation: {num_targets: 50}}",
    )  # fmt: skip
    assert done.status == 0, done.stderr
    run = RunDirectory.open(path)
    assert run.receptor_names() == names
    assert receptor_names(run, len(names)) == names
    # Of an older run, or another number of readings.
    assert receptor_names(run, 3) == ["0", "1", "2"]
    run.receptors.write_text("{}")
    with pytest.raises(RunError, match=r"receptors\.json is damaged; delete it, and the receptors"):
        run.receptor_names()
    run.receptors.unlink()
    assert receptor_names(run, len(names))[:2] == ["0", "1"]
