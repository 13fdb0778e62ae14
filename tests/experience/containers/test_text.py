"""Tables as text from programs of all kinds: the same numbers, or one line."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from known_recording import Good, require_same, said
from scipy.io import savemat

from selftouch_drake.experience.recording import read_recording
from selftouch_drake.experience.recording_error import RecordingError

NUM_ROWS = 500


@pytest.fixture(scope="module")
def good():
    return Good(NUM_ROWS)


def lists(good, form):
    columns = {"q": [form(row) for row in good.q], "touch": [form(row) for row in good.force]}
    return pd.DataFrame({"time_s": good.time_s} | columns).to_csv(index=False)


def plotjuggler(good):
    columns = {"__time": 1_777_000_000 + good.time_s}
    for n in range(4):
        columns[f"/joint_states/arm_{n}/position"] = good.q[:, n]
        columns[f"/joint_states/arm_{n}/velocity"] = 0 * good.q[:, n]
    columns |= {f"/tactile/data[{n}]": good.force[:, n] for n in range(40)}
    return pd.DataFrame(columns).to_csv(index=False)


def thousands(good):
    table = good.table().astype(object)
    for name in table.columns[5:]:
        table[name] = [f"{1000 * value:,.1f}" for value in table[name]]
    return table.to_csv(index=False)


def with_dates(good):
    stamps = np.datetime64("2026-05-01T10:00:00") + (1000 * good.time_s).round().astype("m8[ms]")
    return good.table().drop(columns="time_s").set_index(pd.to_datetime(stamps))


TEXTS = {
    "lines above the header": lambda good: (
        "Robot: iCub\nDate;2026-05-01\nOperator;N. N.\n\n"
        + good.table().to_csv(index=False, sep=";")
    ),
    "empty rows of a spreadsheet": lambda good: (
        f"# note{',' * 44}\n{',' * 44}\n{good.table().to_csv(index=False)}"
    ),
    "a spreadsheet's delimiter": lambda good: f"sep=;\n{good.table().to_csv(index=False, sep=';')}",
    "a typesetter's minus": lambda good: good.table().to_csv(index=False).replace("-", "−"),
    "arrays of numpy": lambda good: lists(good, repr),
    "tensors": lambda good: lists(good, lambda row: f"tensor({row.tolist()}, dtype=torch.float64)"),
    "an index of dates": lambda good: with_dates(good).to_csv(),
    "plotjuggler": plotjuggler,
    "taxels of a grid": lambda good: good.table().to_csv(
        index=False,
        header=[
            "time_s",
            *(f"q_{n}" for n in range(4)),
            *(f"taxel_{n // 8}_{n % 8}" for n in range(40)),
        ],
    ),
    "taxels of two sides": lambda good: good.table().to_csv(
        index=False,
        header=[
            "t",
            *["q_0", "q_1", "q_2", "q_3"],
            *(f"{side}_taxel_{n}" for side in ("left", "right") for n in range(20)),
        ],
    ),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_texts_of_programs_hold_the_same(kind, good, tmp_path):
    (tmp_path / "a.csv").write_text(TEXTS[kind](good), encoding="utf-8")
    data = require_same(good, tmp_path / "a.csv")
    assert ("4 lines above its header: left out" in said(data)) == (
        kind == "lines above the header"
    )
    assert "time: 9.98 s at 50 Hz" in said(data)


def test_commas_between_thousands_are_said(good, tmp_path):
    (tmp_path / "a.csv").write_text(thousands(good))
    data = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(data.readings, (1000 * good.force).round(1), atol=0.051)
    assert "numbers have commas between thousands" in data.notes


def test_types_of_tables_do_not_matter(good, tmp_path):
    path = tmp_path / "a.parquet"
    good.table().astype(str).to_parquet(path)
    require_same(good, path)
    table = pa.Table.from_pandas(good.table())
    decimals = table.column("q_0").cast(pa.decimal128(12, 4))
    pq.write_table(table.set_column(1, "q_0", decimals), path)
    require_same(good, path)
    with_dates(good).to_parquet(path)
    assert "50 Hz, from column time, dates" in said(require_same(good, path))


def test_structs_of_matlab_are_episodes(good, tmp_path):
    cells = np.empty(2, dtype=object)
    for number, rows in enumerate((slice(0, 300), slice(300, None))):
        cells[number] = {"q": good.q[rows], "touch": good.force[rows], "t": good.time_s[rows, None]}
    savemat(tmp_path / "a.mat", {"episodes": cells})
    data = require_same(good, tmp_path / "a.mat")
    assert np.flatnonzero(np.diff(data.recording.piece)).tolist() == [299]
    cells[1] = {"q": good.q, "t": good.time_s}
    savemat(tmp_path / "a.mat", {"episodes": cells})
    with pytest.raises(RecordingError, match="has episodes whose arrays differ in names or rows"):
        read_recording(tmp_path / "a.mat")


def refused(path, content):
    if isinstance(content, str):
        path.write_text(content)
    else:
        np.savez(path, **content)
    with pytest.raises(RecordingError, match=r".") as error:
        read_recording(path)
    return str(error.value)


def test_what_no_program_reads_is_refused(good, tmp_path):
    with np.printoptions(threshold=10):
        text = lists(good, str)
    assert "printed with ... in them; write all numbers" in refused(tmp_path / "a.csv", text)
    text = good.table(force=good.force.astype(str) + np.array(" N", dtype=object)).to_csv(
        index=False
    )
    assert "name a column that holds numbers" in refused(tmp_path / "a.csv", text)
    objects = {"q": np.array([*good.q, None], dtype=object), "touch": good.force}
    assert "objects of Python; save arrays of numbers" in refused(tmp_path / "a.npz", objects)
    arrays = {"q": good.q, "touch": np.zeros(0)}
    assert "column touch of" in refused(tmp_path / "a.npz", arrays)
