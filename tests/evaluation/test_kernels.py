import numpy as np
import pytest
from by_hand import laid_by_hand
from laying import kernels_on, places

from selftouch_drake.evaluation.shape import kernel_truth, parts_on_skins, shape_errors


def representation(sizes):
    """Kernels with the given numbers of configurations."""
    return laid_by_hand([np.zeros((size, 2)) for size in sizes])


def test_a_kernel_is_where_most_of_its_contacts_are(hand):
    a, b, c = [0.0, 0.0, 1.0], [0.0, 0.2, 1.0], [0.0, 0.1, 1.0]
    hand.touch((0, 0, a)).touch((0, 0, b)).touch((0, 0, c))
    # The second kernel is on skin 1, but for one touch; one of its touches is at two places there.
    # It is a double touch: another skin is touched more often than its own.
    x = [1.0, 0.0, 0.0]
    hand.touch((1, 0, x), (1, 1, x)).touch((1, 0, x), (0, 1, a), (0, 2, a)).touch((0, 0, a))
    hand.touch((1, 0, [3.0, 0, 0]), (0, 1, a), (0, 2, a)).touch((1, 1, x), (0, 1, a), (0, 2, a))
    truth = kernel_truth(representation([3, 5]), hand.contacts(), np.array([0, 1]))
    np.testing.assert_array_equal(truth.skin, [0, 1])
    np.testing.assert_allclose(truth.positions, [c, [1.0, 0.0, 0.0]], atol=1e-6)
    spread = [np.std([0.0, 0.2, 0.1]), np.std([1.0, 1.0, 1.0, 3.0, 1.0])]
    np.testing.assert_allclose(truth.spread, spread, atol=1e-6)
    assert truth.share_single == pytest.approx(7 / 8)
    assert not truth.is_surface


def test_nineteen_of_twenty_touches_at_one_place_make_a_surface(hand):
    p = [0.0, 0.0, 1.0]
    hand.touch((0, 0, p), (0, 1, p))
    for _ in range(19):
        hand.touch((0, 0, p))
    assert kernel_truth(representation([20]), hand.contacts(), np.zeros(1, int)).is_surface
    hand.touch((0, 0, p), (0, 1, p))
    assert not kernel_truth(representation([21]), hand.contacts(), np.zeros(1, int)).is_surface


def test_truth_of_other_touches_is_refused(hand):
    hand.touch((0, 0, [0.0, 0.0, 1.0])).touch()
    with pytest.raises(
        ValueError, match=r"^contacts has 2 rows, the kernels 3; give one for each of kernel_row$"
    ):
        kernel_truth(representation([3]), hand.contacts(), np.zeros(1, int))
    with pytest.raises(
        ValueError, match=r"^kernel 1 has no contact; the truth belongs to another experience$"
    ):
        kernel_truth(representation([1, 1]), hand.contacts(), np.zeros(2, int))


@pytest.fixture
def two_skins(sphere, tube):
    """Kernels on two skins: 60 on each."""
    return kernels_on([places(sphere, 500), places(tube, 500)])


def test_a_skin_is_shown_by_the_part_with_most_of_its_kernels(two_skins):
    part = np.zeros(120, dtype=int)
    part[60:] = 2
    part[[3, 4, 5]] = 1
    part[[61, 62]] = 0
    shown = parts_on_skins(part, two_skins)
    assert list(shown) == [0, 1]
    np.testing.assert_array_equal(shown[0], np.setdiff1d(np.arange(60), [3, 4, 5]))
    np.testing.assert_array_equal(shown[1], np.setdiff1d(np.arange(60, 120), [61, 62]))


def test_one_part_may_show_two_skins(two_skins):
    shown = parts_on_skins(np.zeros(120, dtype=int), two_skins)
    assert {skin: len(kernels) for skin, kernels in shown.items()} == {0: 60, 1: 60}


def test_a_skin_in_fragments_is_not_shown(two_skins):
    part = np.zeros(120, dtype=int)
    part[60:] = 1 + np.arange(60) // 11
    assert list(parts_on_skins(part, two_skins)) == [0]


def test_shapes_are_compared_skin_by_skin(two_skins):
    part = np.repeat([0, 1], 60)
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    # Each part in a pose, a size and a handedness of its own.
    laid_out = two_skins.positions.copy()
    laid_out[:60] = 7.0 * laid_out[:60] @ turn + 3.0
    laid_out[60:] = -0.1 * laid_out[60:] - 1.0
    errors = shape_errors(laid_out, part, two_skins)
    assert errors == pytest.approx({0: 0.0, 1: 0.0}, abs=1e-9)
    # Noise of 1 cm on a ball of 40 cm is 2.5 % along each axis.
    laid_out[:60] = two_skins.positions[:60] + 0.01 * rng.normal(size=(60, 3))
    errors = shape_errors(laid_out, part, two_skins)
    assert errors[0] == pytest.approx(0.025 * np.sqrt(3), rel=0.15)
    assert errors[1] == pytest.approx(0.0, abs=1e-9)


def test_a_part_that_was_not_recovered_has_no_error(two_skins):
    laid_out = two_skins.positions.copy()
    laid_out[60:] = np.nan
    assert list(shape_errors(laid_out, np.repeat([0, 1], 60), two_skins)) == [0]
