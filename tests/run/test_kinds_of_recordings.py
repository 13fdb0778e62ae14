"""Recordings as other people write them: the same touches whatever the form, or one line.

A recording with a known result is written in forms that must not matter; what matters is read with
the right value or refused.
"""

import json
import shutil

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
from commands import selftouch
from known_recording import NUM_JOINTS, NUM_RECEPTORS, NUM_ROWS, RATE_HZ, Good, require_same, said
from scipy.io import savemat

from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.run.imported import read_data


@pytest.fixture(scope="module")
def good():
    return Good()


# What must not matter: how the same numbers are written as text.


def as_text(table, path, **form):
    table.to_csv(path, index=False, **form)
    return path


def test_the_good_recording_is_read_as_it_is(good, tmp_path):
    data = require_same(good, as_text(good.table(), tmp_path / "a.csv"))
    text = said(data)
    assert f"rows: {NUM_ROWS:,}, of which 0 are incomplete" in text
    assert "time: 59.98 s at 50 Hz, from column time_s" in text
    assert "alive: 40 of 40 receptors" in text
    for word in ("left out", "odd", "understood", "set aside"):
        assert word not in text


TEXTS = {
    "semicolons": {"sep": ";"},
    "tabs": {"sep": "\t"},
    "decimal commas": {"sep": ";", "decimal": ","},
    "decimal commas between tabs": {"sep": "\t", "decimal": ","},
    "decimal commas in quotes": {"sep": ",", "decimal": ",", "quoting": 1},
    "quoted names": {"quoting": 2},
    "with a mark of the byte order": {"encoding": "utf-8-sig"},
    "UTF-16": {"encoding": "utf-16", "sep": "\t"},
    "Windows line ends": {"lineterminator": "\r\n"},
}


@pytest.mark.parametrize("form", TEXTS.values(), ids=TEXTS)
def test_how_text_is_written_does_not_matter(form, good, tmp_path):
    require_same(good, as_text(good.table(), tmp_path / "a.csv", **form))


def changed(lines, kind):
    """The lines of a CSV file, changed in a way that must not matter."""
    header, rows = lines[0], lines[1:]
    empty = "," * (header.count(",") + 3)
    return {
        "commented header": [f"# {header}", *rows],
        "percent header": ["% made by a script", f"% {header}", *rows],
        "comments first": ["# torso, seen from above", "# 2 Nm", header, *rows],
        "blank lines": ["", header, "", *rows, "", ""],
        "blanks in the header": [header.replace(",", ", "), *rows],
        "blanks everywhere": [line.replace(",", " , ") for line in lines],
        "capitals": [header.replace("q_", "Q_").replace("taxel", "Taxel"), *rows],
        "brackets": [
            ",".join(
                f"q[{name[2:]}]" if name.startswith("q_") else name for name in header.split(",")
            ),
            *rows,
        ],
        "commas at the end": [f"{line},," for line in lines],
        "commas at the end of rows": [header, *(f"{row}," for row in rows)],
        "an empty last line": [*lines, empty.replace(",,,", "")],
        "units in the header": [
            header.replace("time_s", "time [ms]").replace("q_0", "q_0 (rad)"),
            *(f"{float(row.split(',', 1)[0]) * 1000:g},{row.split(',', 1)[1]}" for row in rows),
        ],
        "a row of units": [
            header.replace("time_s", "time"),
            ",".join(["s", *["rad"] * NUM_JOINTS, *["N"] * NUM_RECEPTORS]),
            *rows,
        ],
        "columns the other way round": [",".join(line.split(",")[::-1]) for line in lines],
        "a column twice": [f"{line},{line.split(',')[0]}" for line in lines],
        "units of pressure": [
            header.replace("taxel_0", "taxel_0 [kPa]").replace("taxel_1,", "taxel_1 (N),"),
            *rows,
        ],
        "an index first": [f",{header}", *(f"{n},{row}" for n, row in enumerate(rows))],
        "other columns": [
            f"note,{header},q_vel_0,temperature",
            *(f"warm,{row},{n % 7},{20 + n % 3}.5" for n, row in enumerate(rows)),
        ],
    }[kind]


def lines_of(table):
    return table.to_csv(index=False).splitlines()


CHANGES = (
    *("commented header", "percent header", "comments first", "blank lines"),
    *("blanks in the header", "blanks everywhere", "capitals", "brackets", "commas at the end"),
    *("commas at the end of rows", "units in the header", "a row of units"),
    *("columns the other way round", "a column twice", "an index first", "other columns"),
    "units of pressure",
)


@pytest.mark.parametrize("kind", CHANGES)
def test_what_surrounds_the_numbers_does_not_matter(kind, good, tmp_path):
    lines = changed(lines_of(good.table()), kind)
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    require_same(good, tmp_path / "a.csv")


@pytest.mark.parametrize("delimiter", [" ", "\t", ","])
def test_files_of_savetxt_are_read(delimiter, good, tmp_path):
    names = delimiter.join(good.table().columns)
    np.savetxt(tmp_path / "a.csv", good.table(), fmt="%10.4f", delimiter=delimiter, header=names)
    require_same(good, tmp_path / "a.csv")


def test_a_file_without_a_header_is_read_by_the_numbers_of_its_columns(good, tmp_path):
    path = as_text(good.table(), tmp_path / "a.csv", header=False)
    with pytest.raises(RecordingError, match="it has column_0, column_1, "):
        read_data(path)
    columns = {"q": "column_1..column_4", "sensation": "column_5..column_44", "time": "column_0"}
    data = require_same(good, path, **columns)
    assert "has no header: its columns are called column_0" in said(data)
    as_text(good.table(), path, header=False, sep=";", decimal=",")
    require_same(good, path, **columns)
    # pandas writes numbers above columns that have no name.
    as_text(pd.DataFrame(good.table().to_numpy()), path)
    require_same(good, path, q="1..4", sensation="5..44", time="0")


def test_rows_that_are_broken_are_left_out_and_counted(good, tmp_path):
    lines = lines_of(good.table())
    lines.insert(1500, lines[0])  # a logger that was started again
    lines[700] = lines[700].replace(",", ",ERR,", 1).rsplit(",", 1)[0]
    lines.append("59.99,0.1,0.2")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    data = read_data(tmp_path / "a.csv")
    assert (data.recording.num_rows, data.recording.num_incomplete) == (NUM_ROWS + 2, 3)
    assert "words among numbers count as missing" in said(data)


# What must not matter: the format.


def in_format(good, kind, folder):
    arrays = {"q": good.q, "touch": good.force, "time_s": good.time_s}
    if kind == "npz":
        np.savez(folder / "a.npz", **arrays)
    elif kind == "mat":
        savemat(folder / "a.mat", arrays)
    elif kind == "transposed mat":
        savemat(folder / "a.mat", {"data": {name: array.T for name, array in arrays.items()}})
    elif kind == "npy":
        for name, array in arrays.items():
            np.save(folder / f"{name}.npy", array)
        return folder
    elif kind == "npy of walks":
        half = NUM_ROWS // 2
        for walk, rows in enumerate((slice(0, half), slice(half, None))):
            for name, array in arrays.items():
                np.save(folder / f"walk{walk}_{name}.npy", array[rows])
        return folder
    elif kind == "parquet":
        good.table().to_parquet(folder / "a.parquet")
    elif kind == "feather":
        pyarrow.feather.write_feather(pa.Table.from_pandas(good.table()), folder / "a.feather")
    elif kind == "tsv":
        as_text(good.table(), folder / "a.tsv", sep="\t")
    return folder / f"a.{kind.split()[-1]}"


FORMATS = ("npz", "mat", "transposed mat", "npy", "npy of walks", "parquet", "feather", "tsv")


@pytest.mark.parametrize("kind", FORMATS)
def test_the_format_does_not_matter(kind, good, tmp_path):
    require_same(good, in_format(good, kind, tmp_path))


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("a.pkl", "save its arrays as npz"),
        ("a.bag", "export its topics"),
        ("a.xlsx", "save it as csv"),
        ("a.log", "rename it"),
        ("a.npy", "give the folder"),
    ],
)
def test_other_formats_are_refused_with_a_remedy(name, remedy, tmp_path):
    np.save(tmp_path / "a.npy", np.ones(3))
    (tmp_path / name).touch()
    found = selftouch("import", tmp_path / name, "--out", tmp_path / "run")
    assert found.status == 2
    assert remedy in found.stderr
    assert found.stderr.count("\n") == 1


def test_files_left_behind_are_no_data(good, tmp_path):
    folder = tmp_path / "rec"
    (folder / ".ipynb_checkpoints").mkdir(parents=True)
    (folder / "__MACOSX").mkdir()
    as_text(good.table(), folder / "a.csv")
    for copy in ("._a.csv", ".ipynb_checkpoints/a-checkpoint.csv", "__MACOSX/a.csv", "a copy.csv"):
        shutil.copy(folder / "a.csv", folder / copy)
    text = said(require_same(good, folder))
    assert "3 hidden files or copies of an editor are left out" in text
    assert "1 files are copies of others and left out, as a.csv of a copy.csv" in text


# Time.


def times(good, kind):
    """A column of times of the good recording, its name, and what the summary says of it."""
    seconds = good.time_s
    start = np.datetime64("2026-05-01T10:00:00.000")
    dates = start + (1000 * seconds).round().astype("timedelta64[ms]")
    nanoseconds = dates.astype("datetime64[ns]").astype(np.int64)
    text = np.datetime_as_string(dates)
    return {
        "dates": ("timestamp", text, "timestamp, dates"),
        "dates with blanks": ("stamp", [t.replace("T", " ") for t in text], "stamp, dates"),
        "dates with a zone": ("time", [f"{t}Z" for t in text], "time, dates"),
        "times of the day": ("time", [t.split("T")[1] for t in text], "time, dates"),
        "ns since 1970": ("t", nanoseconds, "t, ns since 1970"),
        "us since 1970": ("timestamp", nanoseconds // 1000, "timestamp, us since 1970"),
        "ms since 1970": ("timestamp", nanoseconds // 1_000_000, "timestamp, ms since 1970"),
        "s since 1970": ("stamp", nanoseconds / 1e9, "stamp, s since 1970"),
        "ms in the name": ("time_ms", 1000 * seconds, "time_ms, in ms"),
        "us in brackets": ("Time (us)", 1e6 * seconds, "Time (us), in us"),
        "seconds": ("elapsed_s", seconds, None),
    }[kind]


TIMES = (
    *("dates", "dates with blanks", "dates with a zone", "times of the day", "ns since 1970"),
    *("us since 1970", "ms since 1970", "s since 1970", "ms in the name", "us in brackets"),
)


@pytest.mark.parametrize("kind", TIMES)
@pytest.mark.parametrize("file", ["a.csv", "a.parquet"])
def test_times_are_turned_to_seconds(kind, file, good, tmp_path):
    name, column, what = times(good, kind)
    table = good.table(**{name: column})
    if file.endswith("csv"):
        as_text(table, tmp_path / file)
    else:
        table.to_parquet(tmp_path / file)
    data = require_same(good, tmp_path / file)
    assert f"from column {what}" in said(data)


def test_stamps_in_two_columns_are_one_time(good, tmp_path):
    counts = (1e9 * good.time_s).round().astype(np.int64) + 1_777_000_000_000_000_000
    stamp = {"header.stamp.secs": counts // 10**9, "header.stamp.nsecs": counts % 10**9}
    require_same(good, as_text(good.table(**stamp), tmp_path / "a.csv"))


def test_a_time_in_an_unknown_unit_is_refused(good, tmp_path):
    path = as_text(good.table(time=good.time_s / 0.02), tmp_path / "a.csv")
    found = selftouch("import", path, "--out", tmp_path / "run")
    assert found.status == 2
    assert "column time of" in found.stderr
    # 1 Hz, or 1 kHz.
    assert "has steps of 1, in an unknown unit: give --time-unit s, ms, us or ns" in found.stderr
    assert read_data(path, time="none").recording.time_s is None
    # Postures that were recorded one by one, and not from row to row.
    order = np.random.default_rng(0).permutation(NUM_ROWS)
    path = as_text(good.table(q=good.q[order], time=20 * np.arange(NUM_ROWS)), tmp_path / "a.csv")
    with pytest.raises(RecordingError, match="in an unknown unit: give --time-unit"):
        read_data(path)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_unit_is_known_where_joints_move_as_joints_do_in_one_alone(unit, factor, good, tmp_path):
    counts = (factor * (good.time_s + 1800)).round().astype(np.int64)
    path = as_text(good.table(stamp=counts), tmp_path / "a.csv")
    assert f"stamp, taken for {unit}, in which alone" in said(require_same(good, path))
    require_same(good, path, time_unit=unit)


def test_a_time_that_is_none_is_refused_or_left_out(good, tmp_path):
    path = as_text(good.table(time="noon"), tmp_path / "a.csv")
    with pytest.raises(RecordingError, match="holds no times: give numbers or dates"):
        read_data(path)
    data = read_data(path, time="none")
    assert data.recording.time_s is None
    assert "time: none, so speeds are not known" in said(data)


def test_rows_out_of_order_are_sorted(good, tmp_path):
    rng = np.random.default_rng(0)
    for order in (rng.permutation(NUM_ROWS), np.arange(NUM_ROWS)[::-1]):
        path = as_text(good.table().iloc[order], tmp_path / "a.csv")
        assert "rows are earlier than those before: sorted" in said(require_same(good, path))
    order = np.arange(NUM_ROWS)
    order[[500, 501, 900, 902]] = order[[501, 500, 902, 900]]
    path = as_text(good.table().iloc[order], tmp_path / "a.csv")
    require_same(good, path)


def test_gaps_and_restarts_begin_new_pieces(good, tmp_path):
    time_s = good.time_s.copy()
    time_s[1000:] += 40.0
    time_s[2000:] -= time_s[2000]
    data = require_same(good, as_text(good.table(time_s=time_s), tmp_path / "a.csv"))
    starts = np.flatnonzero(np.diff(data.recording.piece)) + 1
    assert starts.tolist() == [1000, 2000]
    text = said(data)
    assert "the clock starts again 1 times" in text
    assert "1 gaps; 3 pieces of motion" in text


# Joints.


def test_degrees_that_are_stated_are_turned_to_radians(good, tmp_path):
    table = good.table(q=np.rad2deg(good.q))
    table.columns = [f"{name} [deg]" if name.startswith("q_") else name for name in table.columns]
    data = require_same(good, as_text(table, tmp_path / "a.csv"))
    assert data.recording.joints == ("q_0", "q_1", "q_2", "q_3")
    assert "joints: deg turned to rad" in said(data)


@pytest.mark.parametrize(("factor", "words"), [(60.0, "as degrees do"), (5000.0, "encoder ticks")])
def test_degrees_and_ticks_that_are_not_stated_are_said(factor, words, good, tmp_path):
    q = factor * good.q
    path = as_text(good.table(q=q.round() if factor > 100 else q), tmp_path / "a.csv")
    data = read_data(path)
    assert words in said(data)
    np.testing.assert_array_equal(data.felt.rows, np.flatnonzero(good.touching))


def test_velocities_are_no_joints(good, tmp_path):
    velocity = np.gradient(good.q, axis=0) * RATE_HZ
    effort = np.random.default_rng(7).normal(size=good.q.shape)
    for parts in ([good.q, velocity], [good.q, velocity, effort]):
        for state in (np.hstack(parts), np.stack(parts, 2).reshape(NUM_ROWS, -1)):
            np.savez(tmp_path / "a.npz", state=state, touch=good.force, time_s=good.time_s)
            text = said(require_same(good, tmp_path / "a.npz"))
            num = state.shape[1] - NUM_JOINTS
            assert f"are {num} velocities, or efforts, of the other joints: left out" in text
    table = good.table()
    for joint in range(NUM_JOINTS):
        table[f"q_{joint}_vel"] = velocity[:, joint]
    path = as_text(table, tmp_path / "a.csv")
    require_same(good, path)
    with pytest.raises(RecordingError, match="--q is 'q_\\*'; it takes q_0_vel too, which by its"):
        read_data(path, q="q_*")


def test_joints_that_circle_are_no_velocities(good, tmp_path):
    angle = np.arange(NUM_ROWS) / 40
    q = np.column_stack([np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)])
    np.savez(tmp_path / "a.npz", q=q, touch=good.force, time_s=good.time_s)
    assert read_data(tmp_path / "a.npz").recording.q.shape[1] == 4


def test_joints_that_jump_away_and_back_are_left_out(good, tmp_path):
    q = good.q.copy()
    wrong = np.array([400, 401, 1200, 2500])
    q[wrong[:2]] = 0.0
    q[wrong[2:], 2] += [-9.0, 7.0]
    path = as_text(good.table(q=q), tmp_path / "a.csv")
    data = require_same(good, path, rows=np.setdiff1d(np.arange(NUM_ROWS), wrong))
    assert "left out: 4 rows: a joint jumps away and back" in said(data)


def test_implausible_speeds_are_said(good, tmp_path):
    path = as_text(good.table(time_s=good.time_s / 1000), tmp_path / "a.csv")
    text = said(read_data(path))
    assert "joints cross their range in" in text
    assert "give --time-unit" in text


def test_a_joint_that_is_logged_twice_is_said(good, tmp_path):
    path = as_text(good.table(q=good.q[:, [0, 1, 2, 0]]), tmp_path / "a.csv")
    assert "joint q_3 repeats q_0" in said(read_data(path))
    lines = [f"{line},{'q_1' if n == 0 else n}" for n, line in enumerate(lines_of(good.table()))]
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="several columns q_1 that differ; rename all but one"):
        read_data(path)


def turntable(num_rows=6000):
    """A table that turns, a finger that slides along its edge and onto it: (angle, slides)."""
    rng = np.random.default_rng(0)
    steps = np.convolve(rng.normal(size=num_rows + 200), np.hanning(120), "same")[:num_rows]
    angle = np.cumsum(0.012 * steps)
    height = np.sin(np.arange(num_rows) / 37)
    depth = 0.3 + np.sin(np.arange(num_rows) / 23)
    places = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    apart = np.abs((angle[:, None] - places + np.pi) % (2 * np.pi) - np.pi)
    lower = np.maximum(1 - np.hypot(apart, height[:, None] + 0.5) / 0.9, 0)
    upper = np.maximum(1 - np.hypot(apart, height[:, None] - 0.5) / 0.9, 0)
    sensation = np.hstack([lower, upper]) * np.maximum(depth, 0)[:, None]
    return angle, np.column_stack([height, depth]), sensation


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0, 4096.0])
def test_a_turntable_may_count_its_turns_or_not(turn, tmp_path):
    angle, slides, sensation = turntable()
    assert np.ptp(angle) > 4 * np.pi
    counted = angle * turn / (2 * np.pi)
    counted = counted.round() if turn > 400 else counted
    wrapped = counted - turn * np.floor(counted / turn + 0.5)
    time_s = np.arange(len(angle)) / 50
    found = []
    for name, q in (("counted", counted), ("wrapped", wrapped)):
        path = tmp_path / f"{name}.npz"
        np.savez(path, q=np.column_stack([q, slides]), touch=sensation, time_s=time_s)
        found.append(read_data(path))
    one, other = found
    np.testing.assert_array_equal(one.felt.rows, other.felt.rows)
    np.testing.assert_allclose(one.felt.q, other.felt.q, atol=1e-9)
    np.testing.assert_allclose(one.recording.speeds(), other.recording.speeds(), atol=1e-6)
    assert "q[0] turned more than once, and touches come back after a turn" in said(one)
    assert "begin again after a turn" in said(other)


def test_a_slide_longer_than_two_pi_is_no_turntable(tmp_path):
    angle, slides, _ = turntable()
    along = 4.0 * np.sin(np.arange(len(angle)) / 97)
    apart = np.abs(along[:, None] - np.linspace(-4, 4, 30))
    sensation = np.maximum(1 - apart / 0.6, 0) * np.maximum(slides[:, 1:], 0)
    np.savez(tmp_path / "a.npz", q=np.column_stack([along, slides]), touch=sensation)
    data = read_data(tmp_path / "a.npz")
    assert np.ptp(data.felt.q[:, 0]) > 7.5
    assert "turn" not in said(data)


# The skin.


@pytest.fixture(scope="module")
def raw(good):
    """Eight-bit readings with an offset for each receptor, and noise."""
    rng = np.random.default_rng(1)
    pressed = 150 * good.force / good.force.max()
    noisy = pressed + rng.integers(20, 60, NUM_RECEPTORS) + rng.normal(0, 0.5, pressed.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def found_in(path, q, readings, time_s=None):
    arrays = {} if time_s is None else {"time_s": time_s}
    np.savez(path, q=q, touch=readings, **arrays)
    return read_data(path)


def test_readings_may_fall_and_have_any_width(good, raw, tmp_path):
    one = found_in(tmp_path / "a.npz", good.q, raw)
    for readings in (255 - raw, 4095 - raw.astype(np.int16) * 16, -raw.astype(float)):
        other = found_in(tmp_path / "b.npz", good.q, readings)
        np.testing.assert_array_equal(one.felt.rows, other.felt.rows)
        scale = other.felt.sensation.max() / one.felt.sensation.max()
        np.testing.assert_allclose(other.felt.sensation, scale * one.felt.sensation, rtol=1e-3)


@pytest.mark.parametrize("falling", [False, True])
@pytest.mark.parametrize("value", ["zeros", "all pressed", "own ends"])
def test_lost_packets_are_left_out_and_counted(falling, value, good, raw, tmp_path):
    rng = np.random.default_rng(2)
    lost = np.flatnonzero(rng.random(NUM_ROWS) < 0.01)
    readings = 255 - raw if falling else raw.copy()
    clean = found_in(tmp_path / "a.npz", good.q, readings)
    readings = readings.copy()
    if value == "own ends":
        ends = readings.astype(int).min(axis=0) - 30 if falling else readings.max(axis=0) + 30
        readings[lost] = np.clip(ends, 0, 255)
    else:
        readings[lost] = 0 if value == "zeros" else 255
    data = found_in(tmp_path / "b.npz", good.q, readings)
    assert not np.isin(data.recording.row[data.felt.rows], lost).any()
    left = data.recording.left_out
    assert len(data.felt.lost) + sum(left.values()) == len(lost)
    assert f"left out: {len(lost)} rows" in said(data)
    assert data.felt.baseline.rising is not falling
    expected = np.setdiff1d(clean.felt.rows, lost)
    assert abs(len(data.felt.rows) - len(expected)) < 0.02 * len(expected)


@pytest.mark.parametrize("end", [0, 255])
def test_a_lost_board_of_the_skin_is_left_out_and_counted(end, good, raw, tmp_path):
    rng = np.random.default_rng(6)
    lost = np.sort(rng.permutation(NUM_ROWS)[:40])
    readings = raw.copy()
    readings[np.ix_(lost, np.arange(10, 22))] = end
    data = found_in(tmp_path / "a.npz", good.q, readings)
    assert len(data.recording.q) == NUM_ROWS - 40
    assert "left out: 40 rows: a part of the skin is lost at once" in said(data)


def test_a_skin_that_freezes_is_left_out_and_counted(good, raw, tmp_path):
    readings = raw.copy()
    touching = np.flatnonzero(good.touching)
    starts = touching[[100, 600, 1100]]
    for start in starts:
        readings[start : start + 60] = readings[start]
    data = found_in(tmp_path / "a.npz", good.q, readings)
    assert len(data.recording.q) == NUM_ROWS - 3 * 59
    assert "left out: 177 rows: the skin stands still" in said(data)
    # One bit for each receptor stays as it is for many rows.
    bits = (good.force > 5).astype(np.uint8)
    assert not found_in(tmp_path / "b.npz", good.q, bits).recording.left_out


@pytest.mark.parametrize("rest", [0.0, 30.0])
def test_a_loose_contact_is_named_and_set_aside(rest, good, tmp_path):
    rng = np.random.default_rng(3)
    readings = 1.5 * good.force + rng.normal(0, 0.5, good.force.shape)
    clean = found_in(tmp_path / "a.npz", good.q, readings)
    on = np.repeat(rng.permutation(60) < 24, NUM_ROWS // 60)
    readings[:, 5] = np.where(on, 200.0, rest) + rng.normal(0, 0.5, NUM_ROWS)
    data = found_in(tmp_path / "b.npz", good.q, readings)
    assert data.loose == ["touch[5]"]
    assert "set aside: 1 (touch[5]): pressed far longer than the others" in said(data)
    assert abs(len(data.felt.rows) - len(clean.felt.rows)) < 0.03 * len(clean.felt.rows)
    # What is felt later by a body leaves it out as well.
    assert not data.felt.baseline.sensation(readings)[:, 5].any()


def test_receptors_without_neighbours_are_no_loose_contacts(good, tmp_path):
    """One fingertip that is pressed often, and never with the rest of the skin."""
    readings = good.force.copy()
    readings[:, 7] = 0.0
    free = ~readings.any(axis=1)
    readings[free & (np.arange(NUM_ROWS) % 100 < 50), 7] = 40.0
    assert found_in(tmp_path / "a.npz", good.q, readings).loose == []


@pytest.mark.parametrize("mark", [-1.0, -999.0, 65535.0, 1e9])
def test_marks_of_missing_numbers_are_left_out(mark, good, raw, tmp_path):
    rng = np.random.default_rng(4)
    readings = raw.astype(float)
    rows = np.sort(rng.permutation(NUM_ROWS)[:60])
    readings[rows, rng.integers(12, NUM_RECEPTORS, 60)] = mark
    readings[:, 11] = mark
    data = found_in(tmp_path / "a.npz", good.q, readings)
    assert len(data.recording.q) == NUM_ROWS - 60
    text = said(data)
    assert f"left out: 60 rows: {mark:g} stands for a missing number" in text
    assert "1 receptors (touch[11]) read nothing but a mark" in text
    assert data.felt.sensation.max() < 256


def test_a_skin_that_knows_few_values_has_no_marks(good, tmp_path):
    for readings in ((good.force > 0).astype(np.uint8), np.where(good.force > 0, 50.0, 0.0)):
        data = found_in(tmp_path / "a.npz", good.q, readings)
        np.testing.assert_array_equal(data.felt.rows, np.flatnonzero(good.touching))
        assert not data.recording.left_out


def test_a_saturated_skin_is_said(good, raw, tmp_path):
    data = found_in(tmp_path / "a.npz", good.q, np.minimum(raw, 90))
    assert "readings end at 90 in" in said(data)


def test_a_skin_that_is_read_less_often_keeps_its_fresh_rows(good, tmp_path):
    kept = np.arange(NUM_ROWS) // 5 * 5
    readings = 1.5 * good.force + np.random.default_rng(5).normal(0, 0.5, good.force.shape)
    data = found_in(tmp_path / "a.npz", good.q, readings[kept], good.time_s)
    np.testing.assert_array_equal(data.recording.q, good.q[::5])
    assert f"left out: {NUM_ROWS - NUM_ROWS // 5:,} rows: the skin only repeats" in said(data)
    data = found_in(tmp_path / "a.npz", good.q[kept], readings, good.time_s)
    np.testing.assert_array_equal(data.recording.readings, readings[::5])


def test_joints_and_skin_in_rows_of_their_own_are_joined(good, tmp_path):
    joints = good.table(force=np.full((NUM_ROWS, NUM_RECEPTORS), np.nan))
    skin = good.table(q=np.full((NUM_ROWS, NUM_JOINTS), np.nan)).iloc[1:-1:3]
    skin = skin.assign(time_s=skin["time_s"] - 0.01)
    both = pd.concat([joints, skin]).sort_values("time_s")
    data = read_data(as_text(both, tmp_path / "a.csv"))
    between = 0.5 * (good.q[1:-1:3] + good.q[:-2:3])
    np.testing.assert_allclose(data.recording.q, between, atol=1e-6)
    np.testing.assert_allclose(data.recording.readings, good.force[1:-1:3])
    assert f"the joints are interpolated in {len(between):,} rows of the skin" in said(data)


# Meaning: many forms at once.


@pytest.mark.parametrize("seed", range(40))
def test_forms_together_do_not_matter(seed, good, tmp_path):
    """A random form of everything that may differ; the touches are those of the good recording."""
    rng = np.random.default_rng(seed)
    name, column, _ = times(good, str(rng.choice(TIMES)))
    degrees, order = rng.random() < 0.3, rng.random() < 0.5
    table = good.table(np.rad2deg(good.q) if degrees else good.q, **{name: column})
    form = str(rng.choice(["q_{}", "joint_{}", "Q [{}]", "q.{}", "joint{}"]))
    unit = " (deg)" if degrees else str(rng.choice(["", " [rad]"]))
    renamed = {f"q_{joint}": form.format(joint) + unit for joint in range(NUM_JOINTS)}
    skin = str(rng.choice(["taxel_{}", "Tactile {}", "touch_{}", "skin_{}"]))
    renamed |= {f"taxel_{n}": skin.format(n) for n in range(NUM_RECEPTORS)}
    table = table.rename(columns=renamed)
    for extra in range(rng.integers(0, 4)):
        table[f"motor_temp_{extra}"] = 30 + rng.normal(size=NUM_ROWS).round(2)
    if order:
        table = table[rng.permutation(table.columns)]
    if rng.random() < 0.3:
        table = table.iloc[rng.permutation(NUM_ROWS)]
    if rng.random() < 0.3:
        table.to_parquet(tmp_path / "a.parquet", index=False)
        require_same(good, tmp_path / "a.parquet")
        return
    sep = str(rng.choice([",", ";", "\t", "|"]))
    decimal = "," if sep in ";\t" and rng.random() < 0.5 else "."
    lines = table.to_csv(index=False, sep=sep, decimal=decimal).splitlines()
    if rng.random() < 0.3:
        lines[0] = f"# {lines[0]}"
    if rng.random() < 0.3:
        lines = [line + sep for line in lines]
    if rng.random() < 0.3:
        lines = ["# a comment, with; signs", *lines]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    require_same(good, tmp_path / "a.csv")


def test_what_was_left_out_is_a_metric(good, raw, tmp_path):
    readings = raw.copy()
    readings[[100, 900]] = 255
    np.savez(tmp_path / "a.npz", q=good.q, touch=readings)
    settings = ("--set", "{representation: {num_targets: 50}}")
    assert selftouch("import", tmp_path / "a.npz", "--out", tmp_path / "run", *settings).status == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    # Touches keep the numbers of their rows in the file.
    step = pq.read_table(tmp_path / "run" / "experience").column("step").to_numpy()
    again = read_data(tmp_path / "a.npz")
    np.testing.assert_array_equal(step, again.recording.row[again.felt.rows])
    assert metrics["import_num_lost"] == 2
    assert "import_loose_receptors" not in metrics


def test_text_that_nobody_can_understand_is_refused(good, tmp_path):
    lines = lines_of(good.table())
    # R names rows, and not their column.
    rows = [lines[0], *(f"{n},{line}" for n, line in enumerate(lines[1:]))]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(RecordingError, match="has 46 cells in a row, but its header names 45"):
        read_data(tmp_path / "a.csv")
    # Decimal commas between commas.
    rows = [lines[0], *(line.replace(".", ",") for line in lines[1:])]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(
        RecordingError, match=r"cells in a row, but its header names 45|decimal comm"
    ):
        read_data(tmp_path / "a.csv")
    # Commas for decimals and points for thousands.
    table = good.table(q=good.q, force=good.force + 1000)
    lines = table.to_csv(index=False, sep=";", float_format="%.3f").splitlines()
    swapped = str.maketrans(".,", ",.")
    rows = [
        line.replace(";1", ";1,").translate(swapped) if n else line for n, line in enumerate(lines)
    ]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(
        RecordingError, match=r"write decimal points|name a column that holds numbers"
    ):
        read_data(tmp_path / "a.csv")
    for text, message in (("", "has no rows"), ("time_s,q_0,taxel_0\n", "has no rows")):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(RecordingError, match=message):
            read_data(tmp_path / "a.csv")
