"""Maps that rivals make, on sensations whose places are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import spearmanr

from benchmarks.others.rival_maps import _slopes, along_map, calibrated_places, diffusion
from selftouch_drake.files import load_arrays
from selftouch_drake.resources import RECORDINGS


@pytest.fixture(scope="module")
def ring():
    """Sensations of 200 receptors' fields on a ring, and the angles."""
    angle = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    felt = np.exp(3.0 * np.cos(angle[:, None] - angle[::20]))
    return felt / np.linalg.norm(felt, axis=1, keepdims=True), angle


def test_diffusion_maps_unroll_a_ring(ring):
    felt, angle = ring
    places = diffusion(felt, 0)
    radius = np.linalg.norm(places[:, :2], axis=1)
    assert np.ptp(radius) < 0.05 * radius.mean()
    turned = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    assert abs(spearmanr(turned, angle)[0]) > 0.99


def test_slopes_of_the_autoencoder_are_those_of_its_bound():
    rng = np.random.default_rng(0)
    sizes = {"in": (5, 4), "mean": (4, 3), "log": (4, 3), "up": (3, 4), "out": (4, 5)}
    weights = {f"{name}_w": 0.5 * rng.normal(size=size) for name, size in sizes.items()}
    weights |= {f"{name}_b": 0.5 * rng.normal(size=size[1]) for name, size in sizes.items()}
    felt, noise = rng.random((6, 5)), rng.normal(size=(6, 3))

    def bound(changed):
        hidden = np.tanh(felt @ changed["in_w"] + changed["in_b"])
        mean = hidden @ changed["mean_w"] + changed["mean_b"]
        log = hidden @ changed["log_w"] + changed["log_b"]
        upper = np.tanh((mean + np.exp(0.5 * log) * noise) @ changed["up_w"] + changed["up_b"])
        off = np.square(upper @ changed["out_w"] + changed["out_b"] - felt).sum()
        return (0.5 * off + 0.5 * 0.03 * (np.exp(log) - 1 - log + mean**2).sum()) / len(felt)

    slopes = _slopes(weights, felt, noise)
    assert slopes.keys() == weights.keys()
    for name, slope in slopes.items():
        step = np.zeros_like(weights[name])
        step.flat[0] = 1e-6
        ends = [bound(weights | {name: weights[name] + sign * step}) for sign in (1, -1)]
        assert slope.flat[0] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-8)


def test_a_plan_over_a_map_goes_from_neighbour_to_neighbour():
    places = np.stack([np.arange(30.0), np.zeros(30), np.zeros(30)], axis=1)
    # Each target was felt in two postures; one of them is near to those of its neighbours.
    stored = np.stack([np.arange(30.0), np.zeros(30)], axis=1)
    representation = SimpleNamespace(
        kernel_offsets=np.arange(0, 61, 2),
        kernel_q=np.stack([stored, stored + np.array([0.0, 50.0])], axis=1).reshape(-1, 2),
    )
    way = along_map(representation, places, stored[2], np.array([2, 25]))
    assert (way[:, 1] == 0.0).all()
    assert way[-1, 0] == 25.0
    assert np.diff(way[:, 0]).max() <= 8.0


def test_a_map_in_two_pieces_has_no_way():
    places = np.concatenate([np.eye(20, 3), 1e3 + np.eye(20, 3)])
    representation = SimpleNamespace(
        kernel_offsets=np.arange(41), kernel_q=np.random.default_rng(0).normal(size=(40, 2))
    )
    way = along_map(representation, places, np.zeros(2), np.array([0, 39]))
    assert way.tolist() == [[0.0, 0.0], representation.kernel_q[39].tolist()]


def test_calibrated_places_are_within_the_wall_under_the_contacts():
    given = load_arrays(RECORDINGS / "two_arms_1.npz")
    truth = load_arrays(RECORDINGS / "two_arms_1.truth.npz")
    rows = np.arange(0, len(given["q"]), 50)
    found = calibrated_places(truth, given["q"][rows], rows)
    off = found["touch_places"] - truth["touch_places"][found["rows"]]
    # m: a fingertip's centre passes through a wall of 3 cm, to 1 cm on either side.
    assert np.linalg.norm(off, axis=1).max() < 0.04
    assert (found["parts"] == truth["cell_part"][truth["cell"][found["rows"]]]).all()
