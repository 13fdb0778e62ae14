import numpy as np
import pytest

from selftouch_drake.agent.network import Network, toward, train
from selftouch_drake.agent.shape import quotient_map
from selftouch_drake.agent.shape.cells import Cells
from selftouch_drake.agent.shape.quotient_map import (
    discriminants,
    quotient_coordinates,
    scatter_loss,
)
from selftouch_drake.quotient.kernels import KernelSets


def central_difference(function, array, step):
    slope = np.zeros_like(array)
    for index in np.ndindex(array.shape):
        kept = array[index]
        array[index] = kept + step
        above = function()
        array[index] = kept - step
        slope[index] = (above - function()) / (2 * step)
        array[index] = kept
    return slope


def test_slopes_of_the_network_are_those_of_finite_differences():
    rng = np.random.default_rng(0)
    network = Network.random([3, 5, 5, 2], rng)
    network = Network(
        weights=[w.astype(float) for w in network.weights],
        biases=[b.astype(float) for b in network.biases],
    )
    x, pull = rng.standard_normal((7, 3)), rng.standard_normal((7, 2))
    _, inputs, slopes = network.forward(x)
    found = network.gradients(pull, inputs, slopes)
    for parameter, slope in zip([*network.weights, *network.biases], found, strict=True):
        expected = central_difference(lambda: np.sum(pull * network(x)), parameter, 1e-6)
        np.testing.assert_allclose(slope, expected, atol=1e-7)


def test_slope_of_the_loss_is_that_of_finite_differences():
    rng = np.random.default_rng(1)
    middle = rng.standard_normal((20, 3))
    y = np.concatenate([middle, middle + 0.3 * rng.standard_normal((20, 3))])
    # The gradient holds the floor fixed, which changes it by 1e-4 at most.
    expected = central_difference(lambda: scatter_loss(y)[0], y, 1e-6)
    np.testing.assert_allclose(scatter_loss(y)[1], expected, atol=1e-3)


def test_the_loss_sees_no_linear_change_of_the_outputs():
    rng = np.random.default_rng(2)
    middle = rng.standard_normal((500, 3))
    y = np.concatenate([middle, middle + 0.3 * rng.standard_normal((500, 3))])
    turned = y @ rng.standard_normal((3, 3)) + 5.0
    assert scatter_loss(turned)[0] == pytest.approx(scatter_loss(y)[0], abs=0.01)


def test_training_fits_a_smooth_function():
    rng = np.random.default_rng(3)
    network = Network.random([1, 16, 16, 1], rng)
    x = rng.uniform(-2, 2, (256, 1)).astype(np.float32)
    wanted = np.sin(2 * x) + 0.5 * x
    rows = np.arange(len(x))
    train(network, x, lambda: rows, toward(wanted, rows), 400)
    assert np.sqrt(np.mean((network(x) - wanted) ** 2)) < 0.05


@pytest.mark.parametrize("num_cores", [1, 3])
def test_any_number_of_cores_gives_the_same_network(num_cores, monkeypatch):
    def weights() -> bytes:
        rng = np.random.default_rng(0)
        network = Network.random([3, 8, 8, 2], rng)
        x = rng.standard_normal((64, 3)).astype(np.float32)
        train(network, x, lambda: np.arange(len(x)), lambda outputs, _: outputs, 20)
        return b"".join(weight.tobytes() for weight in network.weights)

    monkeypatch.setattr("selftouch_drake.quotient.threads.num_cores", lambda: num_cores)
    here = weights()
    monkeypatch.undo()
    assert here == weights()


def test_discriminants_separate_kernels():
    rng = np.random.default_rng(4)
    sizes = rng.integers(5, 40, 60)
    kernel = np.repeat(np.arange(60), sizes)
    signal = rng.standard_normal((60, 3))[kernel] + 0.05 * rng.standard_normal((len(kernel), 3))
    mixed = np.hstack([signal, rng.standard_normal((len(kernel), 2))]) @ rng.standard_normal((5, 5))
    found = discriminants(KernelSets(mixed, np.concatenate([[0], np.cumsum(sizes)]))).x
    assert found.shape == (len(kernel), 3)
    fit = np.linalg.lstsq(np.c_[signal, np.ones(len(kernel))], found, rcond=None)[0]
    assert np.abs(np.c_[signal, np.ones(len(kernel))] @ fit - found).max() < 0.2


def test_coordinates_are_constant_on_kernels_and_differ_between_them(monkeypatch):
    monkeypatch.setattr(quotient_map, "_NUM_STEPS", 100)
    rng = np.random.default_rng(5)
    # A ring: only the sum of the first two joints matters.
    angle = np.repeat(np.linspace(-np.pi, np.pi, 40, endpoint=False), 60)
    share = rng.uniform(-2, 2, len(angle))
    q = np.stack([angle - share, share, rng.uniform(-2, 2, len(angle))], axis=1)
    found = quotient_coordinates(KernelSets(q, np.arange(41) * 60), seed=0).x
    groups = found.reshape(40, 60, -1)
    assert groups.std(axis=1).mean() < 0.2 * groups.mean(axis=1).std(axis=0).mean()
    middle = groups.mean(axis=1)
    nearest = np.argsort(np.linalg.norm(middle[:, None] - middle, axis=2), axis=1)[:, 1]
    assert (np.isin((nearest - np.arange(40)) % 40, (1, 39))).mean() > 0.95


def test_cells_measure_a_bent_sheet_in_their_own_widths():
    rng = np.random.default_rng(6)
    # Cells of width 0.03, 0.1 apart, on a cylinder of radius 1; the third axis is doubled.
    turn, height = (a.ravel() for a in np.meshgrid(np.arange(10) / 10, np.arange(8) / 10))
    around = np.repeat(turn, 200) + 0.03 * rng.standard_normal(80 * 200)
    up = np.repeat(height, 200) + 0.03 * rng.standard_normal(80 * 200)
    points = np.stack([np.cos(around), np.sin(around), 2.0 * up], axis=1)
    cells = Cells.of(KernelSets(points, np.arange(81) * 200))
    edges = np.array([[33, 34], [33, 43], [33, 35], [33, 36]])
    lengths = cells.lengths(edges)
    np.testing.assert_allclose(lengths / lengths[0], [1.0, 1.0, 2.0, 3.0], rtol=0.12)
    distance = cells.distances()
    np.testing.assert_array_equal(distance, distance.T)
    thick = cells.covariance + 0.1 * cells.least[:, None, None] * np.eye(3)
    step = cells.mean[40] - cells.mean[33]
    squared = [step @ np.linalg.solve(thick[k], step) for k in (33, 40)]
    assert distance[33, 40] == pytest.approx(np.sqrt(np.mean(squared)))
    assert set(np.argsort(distance[33])[1:5]) == {32, 34, 23, 43}


def test_a_cell_of_one_configuration_is_as_wide_as_the_mean():
    rng = np.random.default_rng(7)
    points = np.concatenate([rng.standard_normal((50, 3)), [[9.0, 0, 0]]])
    cells = Cells.of(KernelSets(points, np.array([0, 25, 50, 51])))
    assert np.isfinite(cells.lengths(np.array([[0, 2], [1, 2]]))).all()
    np.testing.assert_array_equal(cells.mean[2], [9.0, 0, 0])
