"""Times as other people's clocks and programs write them, in seconds."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.shared.raw_skin import recorded
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.times import in_seconds

TIME_S = np.round(np.arange(600) / 50, 3)
START = np.datetime64("2026-05-01T10:00:00")
# Over noon and midnight, and over the end of a month.
STAMPS = pd.to_datetime(START + (1e6 * TIME_S).round().astype("timedelta64[us]"))


def written(form, stamps=STAMPS):
    return np.array([stamp.strftime(form) for stamp in stamps])


FORMS = (
    *("%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%d  %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ"),
    *("%Y-%m-%dT%H:%M:%S.%f+02:00", "%Y/%m/%d %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f"),
    *("%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S,%f", "%Y%m%dT%H%M%S.%f", "%Y%m%d_%H%M%S_%f"),
    *("%Y-%m-%d-%H-%M-%S-%f", "%Y-%m-%d %I:%M:%S.%f %p", "%H:%M:%S.%f", "%I:%M:%S.%f PM"),
)


@pytest.mark.parametrize("form", FORMS)
def test_dates_are_read_in_every_form(form):
    found = in_seconds(written(form), "time", "column time", None)
    np.testing.assert_allclose(found.time_s, TIME_S, atol=1e-6)
    assert found.note == "dates"


@pytest.mark.parametrize("form", ["%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f"])
@pytest.mark.parametrize("day", ["2026-03-04", "2026-12-31", "2026-01-09"])
def test_midnight_tells_the_day_from_the_month(form, day):
    stamps = pd.to_datetime(
        np.datetime64(f"{day}T23:59:54") + (1e6 * TIME_S).round().astype("timedelta64[us]")
    )
    found = in_seconds(written(form, stamps), "time", "column time", None)
    np.testing.assert_allclose(found.time_s, TIME_S, atol=1e-6)


def test_zones_and_noon_are_minded():
    # The clock is set back by an hour, and the zone says so.
    zones = np.where(np.arange(600) < 300, "+02:00", "+01:00")
    hours = np.where(np.arange(600) < 300, 0, -1)
    local = [stamp + pd.Timedelta(hours=hour) for stamp, hour in zip(STAMPS, hours, strict=True)]
    texts = [
        f"{text}{zone}"
        for text, zone in zip(written("%Y-%m-%dT%H:%M:%S.%f", local), zones, strict=True)
    ]
    found = in_seconds(np.array(texts), "time", "column time", None)
    np.testing.assert_allclose(found.time_s, TIME_S, atol=1e-6)
    stamps = pd.to_datetime(
        np.datetime64("2026-05-01T11:59:54") + (1e6 * TIME_S).round().astype("timedelta64[us]")
    )
    found = in_seconds(written("%Y-%m-%d %I:%M:%S.%f %p", stamps), "time", "column time", None)
    np.testing.assert_allclose(found.time_s, TIME_S, atol=1e-6)


@pytest.mark.parametrize("words", [["noon"], ["3 apples"], ["2026-13-40 10:00:00"], ["", ""]])
def test_what_is_no_date_is_refused(words):
    with pytest.raises(RecordingError, match="column time holds no times: give numbers or dates"):
        in_seconds(np.array(words), "time", "column time", None)


@pytest.mark.parametrize(
    ("counts", "note"),
    [
        (45_778.4166666 + TIME_S / 86_400, "days since 1900"),
        (740_000.25 + TIME_S / 86_400, "days since the year 0"),
        ((134e15 + 1e7 * TIME_S).round().astype(np.int64), "100 ns since 1601"),
        ((639e15 + 1e7 * TIME_S).round().astype(np.int64), "100 ns since the year 1"),
    ],
)
def test_calendars_of_programs_are_known(counts, note):
    found = in_seconds(counts, "time", "column time", None)
    np.testing.assert_allclose(found.time_s, TIME_S, atol=2e-5)
    assert found.note == note


def test_seconds_of_a_computer_that_ran_for_long_are_no_days():
    for start in (45_778.0, 740_000.0):
        found = in_seconds(start + TIME_S, "time", "column time", None)
        np.testing.assert_allclose(found.time_s, start + TIME_S)
        assert found.note == ""


JOINTS = recorded(600, 10).q[:, :4]


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_the_unit_is_known_in_which_alone_joints_move_as_joints_do(factor):
    unit = {1e3: "ms", 1e6: "us", 1e9: "ns"}[factor]
    order = np.random.default_rng(0).permutation(600)
    for rows in (np.arange(600), order):
        counts = factor * (TIME_S[rows] + 77.0)
        found = in_seconds(counts, "time", "column time", None, JOINTS[rows])
        np.testing.assert_allclose(found.time_s, TIME_S[rows] + 77.0)
        assert found.note.startswith(f"taken for {unit}, in which alone the joints")


@pytest.mark.parametrize(
    ("counts", "joints"),
    [
        (1e3 * TIME_S, None),
        # Numbers of rows.
        (np.arange(600.0), JOINTS),
        # Postures, one after another.
        (1e3 * TIME_S, np.random.default_rng(0).normal(size=(600, 4))),
        # Every four milliseconds, or every four seconds: both may be.
        (4.1 * np.arange(600), JOINTS / [1, 1, 1, 8]),
        (1e3 * TIME_S, np.ones((600, 4))),
    ],
)
def test_a_unit_that_is_open_is_refused(counts, joints):
    with pytest.raises(RecordingError, match="in an unknown unit: give --time-unit s, ms, us or"):
        in_seconds(counts, "time", "column time", None, joints)


def test_times_in_too_few_bits_are_refused():
    counts = (1_777_000_000 + TIME_S).astype(np.float32)
    with pytest.raises(RecordingError, match="rounded to 128, as 32 bits are too few: write 64"):
        in_seconds(
            np.repeat(counts, 30), "time", "column time", None, np.repeat(JOINTS, 30, axis=0)
        )
