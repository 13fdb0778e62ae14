"""What skins report: forces, bits, counts, centres; in every world alike."""

import sys

import numpy as np
import pytest
import yaml
from commands import selftouch

from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import ReadingSettings
from selftouch_drake.geometry.receptors import group_centres, placed_fields
from selftouch_drake.geometry.surfaces import sphere
from selftouch_drake.robot import World
from selftouch_drake.robot.readings import read_forces
from selftouch_drake.systems.station import MakeDynamicStation

FORCE = np.array([[0.0, 0.04, 0.1, 0.3, 5.0]])
BINARY = {"mode": "binary", "threshold": 0.1}
COUNTS = {"mode": "counts", "bits": 4, "full_scale": 1.5}


def test_bits_and_counts():
    on = read_forces(FORCE, ReadingSettings(**BINARY))
    np.testing.assert_array_equal(on, [[0, 0, 1, 1, 1]])
    counts = read_forces(FORCE, ReadingSettings(**COUNTS))
    np.testing.assert_array_equal(counts, [[0, 0, 1, 3, 15]])
    assert read_forces(FORCE, ReadingSettings()) is FORCE


def test_a_receptor_switches_off_later_than_on():
    reading = ReadingSettings(mode="binary", threshold=1.0, hysteresis=0.4)
    felt, seen = None, []
    for force in (0.7, 1.1, 0.7, 0.5, 0.7):
        felt = read_forces(np.array([[force]]), reading, felt)
        seen.append(felt.item())
    assert seen == [0, 1, 1, 0, 0]


def test_centres_of_groups_keep_the_force_and_its_centre():
    rng = np.random.default_rng(0)
    # Two patches of a sphere, nearly flat.
    patch = np.stack([*rng.uniform(-0.05, 0.05, (2, 8)), np.full(8, 0.25)], axis=1)
    p = np.concatenate([patch, patch[:, [2, 0, 1]]])
    fields, _ = placed_fields(sphere(0.25, resolution=0.06), p, radius=np.full(16, 0.05))
    group = np.repeat([0, 1], 8)
    centres = group_centres(fields, group)
    touched = patch[:3]
    whole, three = fields.weights_at(touched).toarray(), centres.weights_at(touched).toarray()
    assert centres.num_receptors == three.shape[1] == 6
    assert (three >= -1e-12).all()
    np.testing.assert_allclose(three[:, :3].sum(axis=1), whole[:, :8].sum(axis=1))
    assert (three[:, 3:] == 0).all()
    # Three readings of three touches differ as the whole sensations do: the map is one to one.
    assert np.linalg.matrix_rank(three[:, :3], tol=1e-3 * three.max()) == 3


SKIN = {
    "num_receptors": 30,
    "surface": {"shape": "sphere", "radius": 0.25, "resolution": 0.05},
}


def felt_under_dynamics(world, at):
    """`(S,)` what the world's own station reads at a posture."""
    station = MakeDynamicStation(world.experiment, world.skins)
    context = station.diagram.CreateDefaultContext()
    plant = station.robot.plant
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), at)
    station.diagram.get_input_port().FixValue(context, np.append(at, np.zeros(6)))
    return station.diagram.GetOutputPort("sensation").Eval(context)


@pytest.fixture(scope="module")
def forces():
    """A world that reads forces, postures, and what is felt there."""
    world = World(load_experiment("sphere", {"skins": {"body": SKIN}}))
    q = np.random.default_rng(0).uniform(*world.robot.babbled_range, (3000, 6))
    rows, touches = world.probe.felt_rows(q)
    at = q[rows[touches.sensation.sum(axis=1).argmax()]]
    return world, q, rows, touches.sensation, at, felt_under_dynamics(world, at)


@pytest.mark.parametrize("reading", [BINARY, COUNTS])
def test_worlds_read_alike(reading, forces):
    plain, q, rows, sensation, at, pressed = forces
    world = World(load_experiment("sphere", {"skins": {"body": SKIN | {"reading": reading}}}))
    world.skins = plain.skins
    read = read_forces(sensation, ReadingSettings(**reading))
    kept = read.any(axis=1)
    assert 0 < kept.sum() < len(kept)  # the lightest touches are not felt
    found, felt = world.probe.felt_rows(q)
    np.testing.assert_array_equal(found, rows[kept])
    np.testing.assert_array_equal(felt.sensation, read[kept])
    np.testing.assert_array_equal(world.probe.sensations(q[rows]), read)
    # Under dynamics, the world reads the forces that it computes itself.
    read_there = felt_under_dynamics(world, at)
    assert read_there.any()
    np.testing.assert_array_equal(
        read_there, read_forces(pressed[None], ReadingSettings(**reading))[0]
    )


@pytest.mark.parametrize(
    ("reading", "says"),
    [
        ("binary", "threshold is None; mode binary needs it"),
        ("{mode: counts, bits: 8}", "full_scale is None; mode counts needs it"),
        ("{threshold: 1}", "threshold is 1.0; only mode binary takes it"),
        (
            "{mode: binary, threshold: 1, hysteresis: 1}",
            "hysteresis is 1.0; give less than threshold, of mode binary",
        ),
    ],
)
def test_a_reading_needs_what_its_mode_needs(reading, says):
    done = selftouch("robot", "sphere", "--set", f"{{skins: {{body: {{reading: {reading}}}}}}}")
    assert (done.status, done.stderr) == (2, f"selftouch: skins.body.reading.{says}\n")


def test_centres_need_a_file_with_groups(tmp_path):
    done = selftouch("robot", "sphere", "--set", "{skins: {body: {reading: centre}}}")
    says = "skins.body.reading.mode is 'centre'; give receptors a file with groups"
    assert (done.status, done.stderr) == (2, f"selftouch: {says}\n")


def test_a_threshold_that_nothing_passes_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["selftouch_drake.experience.collect"], "PATIENCE", 20_000)
    reading = {"mode": "binary", "threshold": 1000.0}
    text = yaml.safe_dump({"skins": {"body": {"reading": reading, "num_receptors": 20}}})
    done = selftouch("babble", "sphere", "--out", tmp_path / "run", "--workers", 1, "--set", text)
    assert done.status == 2
    assert "or lower skins.body.reading.threshold, which is 1000 N" in done.stderr
