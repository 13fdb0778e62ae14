import dataclasses

import numpy as np
import pytest
from bodies_by_hand import sphere

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.shape.recovery import LEAST_MARGIN, MOST_ERROR, recover, unevenness

pytestmark = pytest.mark.usefixtures("module_without_networks")


def touched(num_touches, noise):
    """A learned unit sphere, each reading wrong by some share."""
    rng = np.random.default_rng(0)
    place, receptors = sphere(num_touches), sphere(40)
    sensation = np.clip(place @ receptors.T, 0, None) ** 4
    sensation *= np.maximum(1 + noise * rng.standard_normal(sensation.shape), 0)
    q = np.hstack([place, rng.uniform(-0.3, 0.3, (num_touches, 2))])
    return QuotientLearner(200).fit(sensation, q).representation_


@pytest.fixture(scope="module")
def body(module_without_networks):
    return recover(touched(8_000, 0.0), "sensorimotor")


def with_part(body, **changes):
    return dataclasses.replace(body, parts=(dataclasses.replace(body.parts[0], **changes),))


def test_a_good_shape_is_trusted(body):
    assert body.expected_error < MOST_ERROR
    assert body.trusted


def test_noise_raises_the_expected_error(body):
    noisy = recover(touched(3_000, 0.8), "sensorimotor")
    assert noisy.expected_error > 1.3 * body.expected_error


def test_a_shape_with_unsure_holes_is_not_trusted(body):
    (part,) = body.parts
    unsure = dataclasses.replace(part.topology, margin=LEAST_MARGIN / 2)
    assert not with_part(body, topology=unsure).trusted
    assert not with_part(body, topology=None).trusted


def test_stress_raises_the_expected_error_and_size_does_not(body):
    layout = body.parts[0].embedding
    bent = dataclasses.replace(layout, stress=1.0)
    larger = dataclasses.replace(layout, positions=7.0 * layout.positions)
    assert with_part(body, embedding=bent).expected_error > 2 * body.expected_error
    assert not with_part(body, embedding=bent).trusted
    assert with_part(body, embedding=larger).expected_error == pytest.approx(body.expected_error)


def test_a_metric_that_is_not_calibrated_expects_nothing(body):
    other = dataclasses.replace(body, metric="motor")
    assert other.expected_error is None
    assert not other.trusted


def test_an_even_sphere_is_more_even_than_a_random_one():
    rng = np.random.default_rng(0)
    random = rng.normal(size=(300, 3))
    assert unevenness(sphere(300)) < 0.1 < unevenness(random)


def test_few_kernels_have_a_finite_unevenness():
    assert np.isfinite(unevenness(sphere(5)))
