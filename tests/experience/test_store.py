import gc
import threading
import weakref
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from selftouch_drake.experience.store import (
    Contacts,
    ExperienceReader,
    Shard,
    StoreError,
    WalkCounts,
    read_counts,
    shard_name,
    write_shard,
)

PRINT = "0123456789abcdef"


def _contacts(num_rows, rng):
    """One to three contacts of each touch."""
    offsets = np.concatenate([[0], np.cumsum(rng.integers(1, 4, num_rows))])
    return Contacts(
        offsets=offsets,
        skin=rng.integers(0, 3, offsets[-1]).astype(np.int8),
        toucher=rng.integers(0, 2, offsets[-1]).astype(np.int8),
        p_LC=rng.uniform(-1, 1, (offsets[-1], 3)).astype(np.float32),
    )


def _shard(walk=0, num_rows=7, num_receptors=20):
    rng = np.random.default_rng(walk)
    return Shard(
        walk=walk,
        num_steps=1000 + walk,
        num_impossible=walk,
        step=np.sort(rng.choice(1000, num_rows, replace=False)),
        q=rng.uniform(-3, 3, (num_rows, 6)).astype(np.float32),
        sensation=rng.uniform(0, 5, (num_rows, num_receptors)).astype(np.float32),
        contacts=_contacts(num_rows, rng),
    )


def _files(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def test_what_was_written_is_read_in_walk_order(tmp_path):
    shards = [_shard(walk, num_rows=3 + walk) for walk in range(3)]
    for shard in reversed(shards):
        write_shard(tmp_path, shard, fingerprint=PRINT)
    experience = ExperienceReader(tmp_path / "experience")
    truth = ExperienceReader(tmp_path / "truth")
    for column in ("q", "sensation"):
        expected = [getattr(shard, column).astype(np.float32) for shard in shards]
        np.testing.assert_array_equal(experience.read(column), np.concatenate(expected))
        for batch, rows in zip(experience.batches(column), expected, strict=True):
            np.testing.assert_array_equal(batch, rows)
    for found, shard in zip(truth.contacts(), shards, strict=True):
        assert_same(found, shard.contacts)


def test_reading_that_is_left_off_holds_no_threads_and_lets_garbage_be_freed(tmp_path):
    for walk in range(5):
        write_shard(tmp_path, _shard(walk), fingerprint=PRINT)
    before, forgotten = threading.enumerate(), []
    batches = ExperienceReader(tmp_path / "experience").batches("q")
    forgotten += [forgotten, batches]
    freed = weakref.ref(batches)
    next(batches)
    assert gc.isenabled()
    assert set(threading.enumerate()) <= set(before)
    del batches, forgotten
    gc.collect()
    assert freed() is None


def assert_same(found, expected):
    for name in ("offsets", "skin", "toucher", "p_LC"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_contacts_are_taken_by_row_in_any_order(tmp_path):
    shards = [_shard(walk, num_rows=3 + walk) for walk in range(3)]
    for shard in shards:
        write_shard(tmp_path, shard, fingerprint=PRINT)
    reader = ExperienceReader(tmp_path / "truth")
    whole = Contacts.joined([shard.contacts for shard in shards])
    for rows in ([11, 0, 4, 4, 3, 2], [5], range(12)):
        found = reader.take_contacts(np.array(rows))
        for number, row in enumerate(rows):
            mine, there = (
                slice(*found.offsets[number : number + 2]),
                slice(*whole.offsets[row : row + 2]),
            )
            np.testing.assert_array_equal(found.p_LC[mine], whole.p_LC[there])
            np.testing.assert_array_equal(found.skin[mine], whole.skin[there])
    with pytest.raises(
        StoreError, match=r"truth has 12 rows, but row 12 is needed; it belongs to another"
    ):
        reader.take_contacts(np.array([3, 12]))


def test_the_files_have_the_schema_that_others_rely_on(tmp_path):
    shard = _shard(walk=12)
    write_shard(tmp_path, shard, fingerprint=PRINT)
    assert _files(tmp_path) == ["experience/part-00012.parquet", "truth/part-00012.parquet"]
    experience = pq.read_table(tmp_path / "experience" / shard_name(12))
    truth = pq.read_table(tmp_path / "truth" / shard_name(12))
    key = [("walk", pa.int32()), ("step", pa.int64())]
    vector = [("q", pa.list_(pa.float32(), 6)), ("sensation", pa.list_(pa.float32(), 20))]
    assert experience.schema.equals(pa.schema(key + vector))
    contacts = [("skin", pa.int8()), ("toucher", pa.int8()), ("p_LC", pa.list_(pa.float32(), 3))]
    lists = [(name, pa.list_(kind)) for name, kind in contacts]
    assert truth.schema.equals(pa.schema([*key, *lists]))
    for table in (experience, truth):
        assert table["walk"].to_pylist() == [12] * 7
        assert table["step"].to_pylist() == shard.step.tolist()
        assert all(column.null_count == 0 for column in table.columns)


def test_equal_shards_are_equal_bytes(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        write_shard(tmp_path / name, _shard(), fingerprint=PRINT)
    one, other = (tmp_path / name / "experience" / shard_name(0) for name in ("one", "other"))
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("failing", ["truth", "experience"])
def test_a_write_that_fails_leaves_no_shard_behind(tmp_path, monkeypatch, failing):
    write_table = pq.write_table

    def full_disk(table, path, **options):
        if Path(path).parent.name == failing:
            Path(path).write_bytes(b"PAR1 and no more")
            raise OSError(28, "No space left on device")
        write_table(table, path, **options)

    monkeypatch.setattr(pq, "write_table", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_shard(tmp_path, _shard(), fingerprint=PRINT)
    # Truth comes first: it may be there, but never an experience without it, nor a part of one.
    assert _files(tmp_path) == ([] if failing == "truth" else ["truth/part-00000.parquet"])
    assert read_counts(tmp_path, 0, num_rows=7, fingerprint=PRINT) is None


def test_a_write_that_fails_leaves_the_shard_that_was_there(tmp_path, monkeypatch):
    write_shard(tmp_path, _shard(), fingerprint=PRINT)
    before = (tmp_path / "experience" / shard_name(0)).read_bytes()

    def no_disk(table, path, **options):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(pq, "write_table", no_disk)
    with pytest.raises(OSError, match="Input/output"):
        write_shard(tmp_path, _shard(num_rows=3), fingerprint=PRINT)
    assert (tmp_path / "experience" / shard_name(0)).read_bytes() == before


def test_experience_reads_without_the_truth(tmp_path):
    write_shard(tmp_path, _shard(), fingerprint=PRINT)
    (tmp_path / "truth" / shard_name(0)).unlink()
    (tmp_path / "truth").rmdir()
    np.testing.assert_array_equal(ExperienceReader(tmp_path / "experience").read("q"), _shard().q)
    assert read_counts(tmp_path, 0, num_rows=7, fingerprint=PRINT) == WalkCounts(1000, 0, 7)


def test_a_stored_walk_is_known_by_its_fingerprint_and_its_rows(tmp_path):
    assert read_counts(tmp_path, 4, num_rows=7, fingerprint=PRINT) is None
    write_shard(tmp_path, _shard(walk=4), fingerprint=PRINT)
    path = tmp_path / "experience" / shard_name(4)
    assert read_counts(tmp_path, 4, num_rows=7, fingerprint=PRINT) == WalkCounts(1004, 4, 7)
    with pytest.raises(StoreError) as error:
        read_counts(tmp_path, 4, num_rows=7, fingerprint="another")
    assert str(error.value) == f"{path} belongs to another experiment; choose another --out"
    with pytest.raises(StoreError) as error:
        read_counts(tmp_path, 4, num_rows=8, fingerprint=PRINT)
    assert str(error.value) == f"{path} has 7 rows, not 8; delete it"


def test_a_parquet_file_from_elsewhere_is_refused(tmp_path):
    (tmp_path / "experience").mkdir()
    path = tmp_path / "experience" / shard_name(0)
    pq.write_table(pa.table({"x": [1.0, 2.0], "sensation": [[1.0], [2.0, 3.0]]}), path)
    with pytest.raises(StoreError, match="belongs to another experiment"):
        read_counts(tmp_path, 0, num_rows=2, fingerprint=PRINT)
    for column in ("q", "sensation"):
        with pytest.raises(StoreError) as error:
            ExperienceReader(tmp_path / "experience").read(column)
        assert str(error.value) == f"{path} has no column {column}; give a folder of such shards"


def test_a_folder_without_shards_is_refused(tmp_path):
    with pytest.raises(StoreError) as error:
        ExperienceReader(tmp_path / "experience")
    assert str(error.value) == (
        f"{tmp_path / 'experience'} holds no shard; run `selftouch babble` first"
    )


def test_damage_anywhere_is_reported_or_harmless(tmp_path):
    """A shard that was cut or overwritten is never read as if it were intact."""
    write_shard(tmp_path, _shard(num_rows=200), fingerprint=PRINT)
    path = tmp_path / "experience" / shard_name(0)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for cut in rng.integers(len(whole), size=40):
        path.write_bytes(whole[:cut])
        with pytest.raises(StoreError) as error:
            ExperienceReader(tmp_path / "experience").read("q")
        assert str(error.value).startswith(f"{path} is damaged (")
    refused = 0
    for start in rng.integers(len(whole) - 16, size=100):
        path.write_bytes(whole[:start] + rng.bytes(16) + whole[start + 16 :])
        for column in ("q", "sensation"):
            try:
                rows = ExperienceReader(tmp_path / "experience").read(column)
            except StoreError:
                refused += 1
            else:
                np.testing.assert_array_equal(rows, getattr(_shard(num_rows=200), column))
    assert refused > 50
