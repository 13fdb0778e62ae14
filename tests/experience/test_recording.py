"""Tables of other tools are read and checked; unusable ones are refused."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

Q = np.arange(12.0).reshape(4, 3)
READINGS = (np.arange(48).reshape(4, 12) * 5).astype(np.uint8)
TIME_S = np.array([0.0, 0.1, 0.2, 0.4])


def arrays(rows):
    flat = pa.array(np.ascontiguousarray(rows).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, rows.shape[1])


def columns():
    """One column per number, unordered."""
    named = {f"taxel_{n}": READINGS[:, n] for n in reversed(range(12))}
    return named | {f"joint_{n}": Q[:, n] for n in range(3)} | {"time_s": TIME_S}


def lerobot(folder, names):
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    features = {"observation.state": {"dtype": "float32", "shape": [3], "names": names}}
    (folder / "meta" / "info.json").write_text(json.dumps({"features": features}))
    pq.write_table(pa.table({"tasks": ["touch"]}), folder / "meta" / "tasks.parquet")
    for episode, rows in enumerate((slice(0, 2), slice(2, 4))):
        table = {
            "observation.state": pa.array(Q[rows].astype(np.float32).tolist()),
            # A grid of taxels, as an array of two dimensions is stored.
            "observation.touch": pa.array(READINGS[rows].reshape(2, 3, 4).tolist()),
            "timestamp": np.array([0.0, 0.1]),
            "episode_index": np.full(2, episode),
            "next.done": np.array([False, True]),
        }
        file = folder / "data" / "chunk-000" / f"episode_{episode:06d}.parquet"
        pq.write_table(pa.table(table), file)


def written(kind, folder):
    """A recording in some form, and the options that it needs."""
    if kind == "npz":
        np.savez(folder / "a.npz", q=Q, taxels=READINGS, time_s=TIME_S)
        return folder / "a.npz", {}
    if kind == "parquet":
        table = {"q": arrays(Q), "sensation": arrays(READINGS), "time": TIME_S}
        pq.write_table(pa.table(table), folder / "a.parquet")
        return folder / "a.parquet", {}
    if kind == "csv":
        pa.csv.write_csv(pa.table(columns()), folder / "a.csv")
        return folder / "a.csv", {}
    if kind == "named":
        table = {"angles": arrays(Q), "t": TIME_S}
        table |= {f"pad{n}_raw": READINGS[:, n] for n in range(12)}
        pq.write_table(pa.table(table), folder / "a.parquet")
        return folder / "a.parquet", {"q": "angles", "sensation": "pad*_raw"}
    if kind == "folder":
        for number in range(2):
            rows = slice(2 * number, 2 * number + 2)
            part = {"q": Q[rows], "touch": READINGS[rows], "t": TIME_S[rows]}
            np.savez(folder / f"{number}.npz", **part)
        return folder, {}
    lerobot(folder / "robot", ["yaw", "pitch", "roll"])
    return folder / "robot", {}


@pytest.mark.parametrize("kind", ["npz", "parquet", "csv", "named", "folder", "lerobot"])
def test_every_form_gives_the_same(kind, tmp_path):
    source, options = written(kind, tmp_path)
    found = read_recording(source, **options)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.readings, READINGS)
    assert (found.num_rows, found.num_incomplete) == (4, 0)
    assert len(found.joints) == 3
    assert len(found.receptors) == 12
    pieces = 2 if kind in ("folder", "lerobot") else 1
    assert len(np.unique(found.piece)) == pieces
    # Nothing is known between two pieces.
    assert len(found.speeds()) == 4 - pieces
    assert found.speeds()[0] == pytest.approx(30.0)


def test_names_are_those_of_the_columns(tmp_path):
    source, _ = written("csv", tmp_path)
    found = read_recording(source)
    assert found.joints == ("joint_0", "joint_1", "joint_2")
    assert found.receptors == tuple(f"taxel_{n}" for n in range(12))
    source, _ = written("lerobot", tmp_path)
    assert read_recording(source).joints == ("yaw", "pitch", "roll")


def test_columns_can_be_listed(tmp_path):
    source, _ = written("csv", tmp_path)
    found = read_recording(
        source, q="joint_2,joint_0", sensation="taxel_1*", time="joint_1", time_unit="s"
    )
    assert found.joints == ("joint_2", "joint_0")
    assert found.receptors == ("taxel_1", "taxel_10", "taxel_11")
    np.testing.assert_array_equal(found.time_s, Q[:, 1])


def test_bytes_stay_bytes(tmp_path):
    for kind in ("csv", "lerobot", "npz"):
        source, _ = written(kind, tmp_path)
        assert read_recording(source).readings.dtype == np.uint8


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "|"])
def test_the_delimiter_is_found(delimiter, tmp_path):
    names = list(columns())
    rows = np.column_stack(list(columns().values())).tolist()
    lines = [delimiter.join(map(str, row)) for row in [names, *rows]]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    for given in (None, delimiter):
        found = read_recording(tmp_path / "a.csv", delimiter=given)
        np.testing.assert_array_equal(found.q, Q)
        np.testing.assert_array_equal(found.readings, READINGS)
    with pytest.raises(RecordingError, match="--delimiter is ';;'; give one character, such as ;"):
        read_recording(tmp_path / "a.csv", delimiter=";;")


@pytest.mark.parametrize("form", ["{}", "[{}]", "({})", '"[{}]"'])
@pytest.mark.parametrize("between", [",", ", ", " ", "  ", "\n "])
def test_lists_may_be_text(form, between, tmp_path):
    """One column for each joint, and one list for each part of the skin, as pyCub writes it."""
    if "\n" in between and '"' not in form:
        pytest.skip("only quotes hold a line together")
    delimiter = ";" if "," in between and '"' not in form else "\t"
    lines = [["timestamp", "yaw", "pitch", "roll", "left_arm", "torso"]]
    for time, q, readings in zip(TIME_S, Q, READINGS / 10, strict=True):
        lists = [form.format(between.join(map(str, part))) for part in np.split(readings, [5])]
        lines.append([str(time), *map(str, q), *lists])
    lines.append(["0.5", "1", "2", "3", "", form.format(between.join("1" * 7))])
    (tmp_path / "a.csv").write_text("\n".join(delimiter.join(line) for line in lines) + "\n")
    found = read_recording(tmp_path / "a.csv", q="yaw,pitch,roll", sensation="left_arm,torso")
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_allclose(found.readings, READINGS / 10)
    np.testing.assert_array_equal(found.time_s, TIME_S)
    assert found.receptors[4:6] == ("left_arm[4]", "torso[0]")
    assert found.num_incomplete == 1


def test_lists_of_words_or_of_unequal_length_are_refused(tmp_path):
    for text, message in (("[1 a]", "holds string; name a column that"), ("1 2 3", "another len")):
        (tmp_path / "a.csv").write_text(f"q;touch\n[1 2];[1 2]\n[1 2];{text}\n")
        with pytest.raises(RecordingError, match=message):
            read_recording(tmp_path / "a.csv")


def test_an_archive_may_name_its_joints(tmp_path):
    names = {"joint_names": np.array(["yaw", "pitch", "roll"])}
    taxels = {"touch_names": np.array([f"pad {n}" for n in range(12)])}
    np.savez(tmp_path / "a.npz", q=Q, touch=READINGS, **names, **taxels)
    found = read_recording(tmp_path / "a.npz")
    assert found.joints == ("yaw", "pitch", "roll")
    assert found.receptors[-1] == "pad 11"
    np.savez(tmp_path / "a.npz", q=Q, touch=READINGS, joint_names=np.array(["yaw"]))
    assert read_recording(tmp_path / "a.npz").joints == ("q[0]", "q[1]", "q[2]")


@pytest.mark.parametrize(("turned", "as_they_are"), [("q", "touch"), ("touch", "q"), ("both", "")])
def test_transposed_arrays_are_recognised(turned, as_they_are, tmp_path):
    given = {"q": np.tile(Q, (5, 1)), "touch": np.tile(READINGS, (5, 1))}
    turned_round = {name: a if name == as_they_are else a.T for name, a in given.items()}
    np.savez(tmp_path / "a.npz", **turned_round, time_s=np.arange(20.0))
    found = read_recording(tmp_path / "a.npz")
    np.testing.assert_array_equal(found.q, given["q"])
    np.testing.assert_array_equal(found.readings, given["touch"])
    assert found.joints == ("q[0]", "q[1]", "q[2]")


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_rows_can_be_chosen(kind, tmp_path):
    table = {"q": Q, "touch": READINGS, "time_s": TIME_S}
    table |= {
        "finger": np.array(["left", "right", "left", "thumb"]),
        "trial": np.array([1, 1, 2, 2]),
    }
    path = tmp_path / f"a.{kind}"
    if kind == "npz":
        np.savez(path, **table)
    elif kind == "parquet":
        pq.write_table(pa.table(table | {"q": arrays(Q), "touch": arrays(READINGS)}), path)
    else:
        lists = {name: [str(row) for row in table[name]] for name in ("q", "touch")}
        pa.csv.write_csv(pa.table(table | lists), path)
    whole = read_recording(path)
    assert whole.choices == {"finger": ("left", "right", "thumb"), "trial": ("1", "2")}
    found = read_recording(path, rows=["finger=left"])
    np.testing.assert_array_equal(found.q, Q[[0, 2]])
    assert (found.num_rows, found.num_incomplete) == (2, 0)
    # What was left out lies between them.
    assert len(np.unique(found.piece)) == 2
    assert len(read_recording(path, rows=["finger=left,right"]).q) == 3
    assert len(read_recording(path, rows=["finger=left", "trial=1.0"]).q) == 1
    for rows, message in (
        ("finger", "--rows is 'finger'; write it as COLUMN=VALUE"),
        ("hand=left", r"--rows is 'hand'; .* has no such column"),
        ("finger=toe", r"--rows is finger=toe; no row of .* is so: correct it"),
        ("q=1", "does not hold one word or number for each instant|no row of .* is so"),
    ):
        with pytest.raises(RecordingError, match=message):
            read_recording(path, rows=[rows])


def test_incomplete_rows_are_left_out_and_counted(tmp_path):
    q, readings = Q.copy(), READINGS.astype(float)
    q[1, 2], readings[3, 5] = np.nan, np.inf
    np.savez(tmp_path / "a.npz", q=q, touch=readings)
    found = read_recording(tmp_path / "a.npz")
    assert (found.num_rows, found.num_incomplete) == (4, 2)
    np.testing.assert_array_equal(found.q, Q[[0, 2]])
    table = {"q": pa.array([[1.0, 2.0], None, [3.0, None]]), "touch": pa.array([[1, 2]] * 3)}
    pq.write_table(pa.table(table), tmp_path / "a.parquet")
    assert read_recording(tmp_path / "a.parquet").num_incomplete == 2


@pytest.mark.parametrize(
    ("arrays", "options", "message"),
    [
        (
            {"angles": Q, "touch": READINGS},
            {},
            "a.npz has no column with a usual name for --q; it has angles, touch: "
            "give those that hold joints, by name or by a pattern such as --q 'joint*'",
        ),
        (
            {"q": Q, "touch": READINGS},
            {"sensation": "tuch"},
            "--sensation is 'tuch'; a.npz has no such column: did you mean touch?",
        ),
        (
            {"q": Q, "touch": READINGS},
            {"time": "stamp"},
            "--time is 'stamp'; a.npz has no such column: it has q, touch",
        ),
        (
            {"q": Q, "touch": READINGS[:3]},
            {},
            "a.npz has 4 rows of q and 3 of sensation; record them together, or give each times of "
            "its own",
        ),
        (
            {"q": Q, "touch": np.full((4, 12), "a")},
            {},
            "column touch of a.npz holds <U1; name a column that holds numbers",
        ),
        (
            {"q": np.full((4, 3), np.nan), "touch": READINGS},
            {},
            "a.npz has no complete row: in each of 4 a number is missing; record q and sensation "
            "in the same row",
        ),
    ],
)
def test_what_cannot_be_used_is_refused(arrays, options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("a.npz", **arrays)
    with pytest.raises(RecordingError, match=r"\w") as error:
        read_recording(tmp_path / "a.npz", **options)
    assert str(error.value).replace(f"{tmp_path}/", "") == message


def test_folders_that_cannot_be_used_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere does not exist; give a file or a folder"):
        read_recording(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match=r"holds no csv, .* file"):
        read_recording(tmp_path)
    np.savez(tmp_path / "a.npz", q=Q, touch=READINGS)
    np.savez(tmp_path / "b.npz", q=Q[:, :2], touch=READINGS)
    with pytest.raises(RecordingError, match=r"b\.npz has 2 joints, but .*a.npz has"):
        read_recording(tmp_path)
    (tmp_path / "c.csv").write_text("q\n1\n")
    with pytest.raises(RecordingError, match=r"holds files of kinds \.csv, \.npz; give one kind"):
        read_recording(tmp_path)
    (tmp_path / "d.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(RecordingError, match=r"d\.parquet is damaged"):
        read_recording(tmp_path / "d.parquet")
    (tmp_path / "notes.md").write_text("q")
    with pytest.raises(RecordingError, match=r"notes\.md is not a csv, .* file; convert it"):
        read_recording(tmp_path / "notes.md")
    table = {"q": pa.array([[1.0], [1.0, 2.0]]), "touch": pa.array([[1], [1]])}
    pq.write_table(pa.table(table), tmp_path / "e.parquet")
    with pytest.raises(RecordingError, match="has arrays of length 1, but another length"):
        read_recording(tmp_path / "e.parquet")


def test_columns_of_further_files_may_come_in_another_order(tmp_path):
    for number, rows in enumerate((slice(0, 2), slice(2, 4))):
        order = slice(None) if number == 0 else slice(None, None, -1)
        names = np.array(["yaw", "pitch", "roll"])[order]
        arrays = {"q": Q[rows][:, order], "joint_names": names, "touch": READINGS[rows]}
        np.savez(tmp_path / f"{number}.npz", **arrays)
    found = read_recording(tmp_path)
    assert found.joints == ("yaw", "pitch", "roll")
    np.testing.assert_array_equal(found.q, Q)


def test_the_only_clock_is_the_time_whatever_its_name(tmp_path):
    arrays = {"q": Q, "touch": READINGS, "ros_time": 100 + TIME_S, "contact_time": TIME_S[::-1]}
    np.savez(tmp_path / "a.npz", **arrays)
    found = read_recording(tmp_path / "a.npz")
    np.testing.assert_allclose(found.time_s, 100 + TIME_S)
    assert found.time_from == "column ros_time"
    np.savez(tmp_path / "a.npz", **arrays, sim_time=TIME_S)
    assert read_recording(tmp_path / "a.npz").time_s is None
