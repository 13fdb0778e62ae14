"""Touches are found in raw readings of a skin; pressures pass unchanged."""

import numpy as np
import pytest

from benchmarks.shared.raw_skin import NOISE, RawSkin, fibonacci, recorded
from selftouch_drake.agent.readings.baseline import Baseline, estimate_baseline
from selftouch_drake.agent.readings.found_touches import RestlessWarning, find_touches

NUM_ROWS, NUM_RECEPTORS = 12_000, 100


@pytest.fixture(scope="module")
def recording():
    return recorded(NUM_ROWS, NUM_RECEPTORS)


@pytest.fixture(scope="module")
def felt(recording):
    return find_touches(recording.q, recording.raw)


def touched(recording):
    return recording.force.any(axis=1)


def cosine_distance(felt, force):
    force = force[felt.rows]
    norms = np.linalg.norm(force, axis=1) * np.linalg.norm(felt.sensation, axis=1)
    return 1 - (force * felt.sensation).sum(axis=1) / norms


def test_pressures_pass_as_they_are(recording):
    order = np.random.default_rng(0).permutation(NUM_ROWS)
    for rows in (order, np.arange(NUM_ROWS)):
        force = recording.force[rows]
        found = find_touches(recording.q[rows], force)
        np.testing.assert_array_equal(found.rows, np.flatnonzero(force.any(axis=1)))
        np.testing.assert_array_equal(found.sensation, force[found.rows])
        np.testing.assert_array_equal(found.q, recording.q[rows][found.rows])
        np.testing.assert_array_equal(found.null, np.flatnonzero(~force.any(axis=1)))
        assert (found.num_lone, found.num_fading) == (0, 0)


def test_touches_of_a_raw_skin_are_found(recording, felt):
    true = touched(recording)
    assert np.mean(~true[felt.rows]) < 0.01
    # Light touches are below the threshold.
    firm = recording.force.max(axis=1) > 0.5
    assert np.mean(np.isin(np.flatnonzero(firm), felt.rows)) > 0.6
    touching = true[felt.rows]
    assert np.median(cosine_distance(felt, recording.force)[touching]) < 0.05


def test_rest_is_found(recording, felt):
    baseline = felt.baseline
    resting = np.where(recording.force == 0, recording.raw, np.nan)
    np.testing.assert_allclose(baseline.offset, np.nanmedian(resting, axis=0), atol=3)
    assert baseline.rising
    assert baseline.smoothed
    # Noise after the median filter, plus half a quantisation step of eight bits.
    assert 0.4 * NOISE < np.median(baseline.noise) < 2 * NOISE
    np.testing.assert_allclose(baseline.threshold, 6 * baseline.noise)
    assert 0 < baseline.drift.max() <= 10


def test_drift_is_followed():
    skin = RawSkin(NUM_RECEPTORS, 1.0, NUM_ROWS, spikes=0.0, seed=3)
    raw = skin.read(np.zeros((NUM_ROWS, NUM_RECEPTORS), dtype=np.float32))
    drifting = raw + np.linspace(0, 60, NUM_ROWS)[:, None]
    q = np.random.default_rng(0).normal(size=(NUM_ROWS, 3))
    with pytest.raises(ValueError, match="nothing is felt in 12000 rows"):
        find_touches(q, drifting, threshold=30.0)
    # With one constant offset, the drift is mistaken for touches.
    with pytest.warns(RestlessWarning, match="half of the receptors feel something"):
        find_touches(q, drifting, threshold=20.0, offset=30.0)


def test_readings_may_fall_with_pressure(recording, felt):
    falling = find_touches(recording.q, 255 - recording.raw)
    assert not falling.baseline.rising
    np.testing.assert_array_equal(falling.rows, felt.rows)
    np.testing.assert_allclose(falling.sensation, felt.sensation)
    wrong = find_touches(recording.q, recording.raw, rising=False)
    assert not wrong.baseline.rising
    # Below rest there are spikes alone, and the median of three leaves hardly any.
    assert wrong.baseline.smoothed
    assert len(wrong.rows) < 0.01 * len(felt.rows)


def test_touches_of_one_row_are_no_spikes(recording):
    """A fast finger on a skin without spikes touches for one row only."""
    brief = recording.force * (np.arange(NUM_ROWS) % 7 == 0)[:, None]
    skin = RawSkin(NUM_RECEPTORS, float(brief.max()), NUM_ROWS, spikes=0.0)
    found = find_touches(recording.q, skin.read(brief))
    assert not found.baseline.smoothed
    assert found.num_lone == 0
    firm = np.flatnonzero(brief.max(axis=1) > 0.5)
    assert np.isin(firm, found.rows).mean() > 0.95


@pytest.mark.parametrize("width", [0.2, 0.25, 0.35])
def test_a_touch_that_few_receptors_feel_is_no_spike(recording, width):
    """Fields that hardly overlap: one or two receptors feel a touch, firmly, for many rows."""
    force = narrow(recording, width)
    num_felt = np.count_nonzero(force, axis=1)
    assert np.mean(num_felt[num_felt > 0] <= 4) > 0.95
    raw = RawSkin(NUM_RECEPTORS, 1.0, NUM_ROWS, spikes=0.0).read(force)
    found = find_touches(recording.q, raw)
    assert not found.baseline.spikes
    assert found.num_lone == 0
    firm = force.max(axis=1) > 0.2
    left = np.isin(np.flatnonzero(firm), found.rows).sum() + found.num_fading
    assert left > 0.95 * firm.sum()


def test_spikes_are_told_from_touches_that_few_receptors_feel(recording):
    force = narrow(recording, 0.35)
    found = find_touches(recording.q, RawSkin(NUM_RECEPTORS, 1.0, NUM_ROWS).read(force))
    assert found.baseline.smoothed
    firm = np.flatnonzero(force.max(axis=1) > 0.2)
    assert np.isin(firm, found.rows).mean() > 0.95


def narrow(recording, width):
    """`(n, S)` what is felt by the receptors nearer than `width` alone."""
    apart = np.linalg.norm(recording.place[:, None] - fibonacci(NUM_RECEPTORS), axis=2)
    return (np.clip(1 - apart / width, 0, None) * touched(recording)[:, None]).astype(np.float32)


def test_rare_spikes_are_found(recording):
    skin = RawSkin(NUM_RECEPTORS, float(recording.force.max()), NUM_ROWS, spikes=0.001)
    found = find_touches(recording.q, skin.read(recording.force))
    assert found.baseline.smoothed
    assert np.mean(~touched(recording)[found.rows]) < 0.01


def test_the_filter_can_be_chosen(recording):
    raw = find_touches(recording.q, recording.raw, filtering="none")
    assert not raw.baseline.smoothed
    assert not raw.baseline.spikes
    assert raw.num_lone == 0
    # One of a hundred receptors has a spike in every second row.
    assert len(raw.rows) > 0.7 * NUM_ROWS
    clean = RawSkin(NUM_RECEPTORS, float(recording.force.max()), NUM_ROWS, spikes=0.0)
    found = find_touches(recording.q, clean.read(recording.force), filtering="median")
    assert found.baseline.smoothed
    assert found.num_lone == 0
    order = np.random.default_rng(0).permutation(NUM_ROWS)
    with pytest.raises(ValueError, match="filter is median, but the joints jump from row to row"):
        find_touches(recording.q[order], recording.raw, filtering="median")


def test_later_readings_become_sensations_row_by_row(recording):
    """A body that lives is calibrated once, from a first stretch."""
    first = 8000
    skin = RawSkin(NUM_RECEPTORS, float(recording.force.max()), NUM_ROWS, spikes=0.0)
    raw = skin.read(recording.force)
    baseline = estimate_baseline(recording.q[:first], raw[:first])
    found = baseline.sensation(raw[first:])
    one_by_one = [baseline.sensation(row[None])[0] for row in raw[first:]]
    np.testing.assert_array_equal(found, one_by_one)
    assert found.dtype == np.float32
    force = recording.force[first:]
    firm = force.max(axis=1) > 0.5
    assert found[firm].any(axis=1).mean() > 0.95
    assert found[np.flatnonzero(~force.any(axis=1))].any(axis=1).mean() < 0.1  # what decays slowly
    again = Baseline.from_arrays(baseline.to_arrays() | {"made_for": np.array("a run")})
    np.testing.assert_array_equal(again.sensation(raw[first:]), found)
    assert again.rising is True


def test_later_spikes_that_no_neighbour_shares_are_no_touch(recording):
    first = 8000
    baseline = estimate_baseline(recording.q[:first], recording.raw[:first])
    found = baseline.sensation(recording.raw[first:]).any(axis=1)
    assert baseline.spikes
    assert np.mean(~touched(recording)[first:][found]) < 0.1


def test_a_stretch_without_a_touch_calibrates():
    skin = RawSkin(NUM_RECEPTORS, 1.0, 2000, spikes=0.0, seed=4)
    rest = skin.read(np.zeros((1000, NUM_RECEPTORS), dtype=np.float32))
    baseline = estimate_baseline(np.zeros((1000, 3)), rest)
    pressed = np.zeros((1000, NUM_RECEPTORS), dtype=np.float32)
    pressed[500:, 3] = 0.8
    found = baseline.sensation(skin.read(pressed))
    assert baseline.rising
    assert not found[:500].any()
    assert found[500:, 3].all()


def test_a_perfect_skin_is_as_it_is(recording):
    estimated = estimate_baseline(recording.q, recording.force)
    np.testing.assert_array_equal(estimated.sensation(recording.force), recording.force)
    assert not estimated.threshold.any()
    assert not estimated.offset.any()


def test_spikes_are_left_out_where_rows_have_no_order(recording):
    rows = np.random.default_rng(1).permutation(NUM_ROWS)
    found = find_touches(recording.q[rows], recording.raw[rows])
    assert not found.baseline.smoothed
    assert found.num_lone > 0.5 * 0.01 * recording.raw.size
    assert np.mean(~touched(recording)[rows][found.rows]) < 0.05


def test_what_comes_back_slowly_is_left_out():
    """Short touches of a skin whose readings take ten rows to decay."""
    num_rows = 4000
    time = np.arange(num_rows)
    q = np.stack([np.sin(time / 150), np.cos(time / 110)], axis=1)
    force = np.zeros((num_rows, 20))
    touching = time % 40 < 8
    force[touching, :3] = np.sin((time[touching] % 40 + 0.5) / 8 * np.pi)[:, None]
    at_once = find_touches(q, force, offset=0.0, threshold=0.0)
    assert at_once.num_fading == 0
    held = force.copy()
    for row in range(1, num_rows):
        held[row] = np.maximum(force[row], 0.8 * held[row - 1])
    found = find_touches(q, held, offset=0.0, threshold=0.01)
    assert found.num_fading > 0
    assert np.mean(touching[found.rows]) == 1.0
    # No row with rising pressure is lost.
    rising = np.flatnonzero(touching & (time % 40 < 4))
    assert np.isin(rising, found.rows).all()


def test_a_receptor_that_never_reads_is_known(recording):
    raw = recording.raw.copy()
    raw[:, 17] = 33
    assert find_touches(recording.q, raw).silent.tolist() == [17]


def test_offset_and_threshold_can_be_set(recording):
    found = find_touches(recording.q, recording.raw, offset=60.0, threshold=50.0, rising=True)
    assert (found.baseline.offset == 60).all()
    assert (found.baseline.threshold == 50).all()
    assert found.baseline.drift.max() == 0
    assert found.sensation[found.sensation > 0].min() > 50


@pytest.mark.parametrize(
    ("q", "readings", "message"),
    [
        (np.ones(5), np.ones((5, 4)), "q has shape (5,): give it as (rows, joints)"),
        (np.ones((5, 2)), np.ones((4, 4)), "q has 5 rows and readings 4: give one"),
        (np.ones((5, 2)), np.full((5, 4), "a"), "readings holds <U1: give real numbers"),
        (np.ones((5, 2)), np.full((5, 4), np.nan), "readings row 0 holds NaN or infinity: dr"),
        (np.ones((5, 2)), np.ones((5, 4)), "nothing is felt in 5 rows: the readings of all"),
    ],
)
def test_what_cannot_be_used_is_refused(q, readings, message):
    with pytest.raises(ValueError, match=r"^\w") as error:
        find_touches(q, readings)
    assert str(error.value).startswith(message)


@pytest.mark.parametrize("name", ["offset", "threshold"])
def test_what_is_given_is_finite(recording, name):
    with pytest.raises(ValueError, match=rf"^{name} is nan: give a finite number$"):
        find_touches(recording.q, recording.raw, **{name: float("nan")})
