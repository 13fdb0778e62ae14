import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from selftouch_drake.files import (
    kept_arrays,
    load_arrays,
    save_arrays,
    write_text_whole,
    written_whole,
)

ARRAYS = {"q": np.arange(12.0).reshape(2, 6), "row": np.array([3, 1, 2])}


def test_a_file_takes_the_place_of_the_one_before(tmp_path):
    path = tmp_path / "figures.json"
    write_text_whole(path, "{}")
    write_text_whole(path, "Größe in m³")
    assert path.read_text(encoding="utf-8") == "Größe in m³"
    assert [p.name for p in tmp_path.iterdir()] == ["figures.json"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("before", [None, "as it was"])
def test_a_write_that_fails_changes_nothing(tmp_path, error, before):
    path = tmp_path / "figures.json"
    if before is not None:
        path.write_text(before)

    def write_half():
        with written_whole(path) as aside:
            aside.write_text("half of")
            raise error

    with pytest.raises(type(error)):
        write_half()
    assert [p.read_text() for p in tmp_path.iterdir()] == ([] if before is None else [before])


def test_a_half_written_file_does_not_have_the_name_of_a_whole_one(tmp_path):
    path = tmp_path / "part-00000.parquet"
    with written_whole(path) as aside:
        aside.write_bytes(b"half of")
        assert not path.exists()
        assert list(tmp_path.glob("part-*.parquet")) == []
        assert list(tmp_path.iterdir()) == [aside]
    assert path.read_bytes() == b"half of"


@settings(max_examples=50, deadline=None)
@given(
    arrays=st.dictionaries(
        st.from_regex(r"[a-z_]{1,8}", fullmatch=True),
        hnp.arrays(
            st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.bool_]),
            hnp.array_shapes(min_dims=0, min_side=0),
        ),
        max_size=4,
    )
)
def test_arrays_come_back_as_they_were_and_in_the_same_bytes(arrays, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp() / "files"
    save_arrays(folder / "a.npz", arrays)
    save_arrays(folder / "b.npz", arrays)
    loaded = load_arrays(folder / "a.npz", arrays)
    assert list(loaded) == list(arrays)
    for name, array in arrays.items():
        assert loaded[name].dtype == array.dtype
        np.testing.assert_array_equal(loaded[name], array)
    assert (folder / "a.npz").read_bytes() == (folder / "b.npz").read_bytes()


def test_a_file_that_is_not_there_is_not_found(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_arrays(tmp_path / "nothing.npz")


def test_arrays_that_are_missing_are_named(tmp_path):
    path = tmp_path / "plan.npz"
    save_arrays(path, ARRAYS)
    with pytest.raises(ValueError, match="lacks") as error:
        load_arrays(path, ("row", "felt", "v"))
    assert str(error.value) == f"{path} lacks felt, v; make it again"


def test_nothing_is_unpickled(tmp_path):
    path = tmp_path / "plan.npz"
    np.savez(path, q=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match=r"is damaged .*pickle.*; make it again"):
        load_arrays(path)


def test_a_bare_array_is_no_archive(tmp_path):
    path = tmp_path / "plan.npz"
    with path.open("wb") as file:
        np.save(file, ARRAYS["q"])
    with pytest.raises(ValueError, match=f"^{path} is damaged .*; make it again$"):
        load_arrays(path)


def test_damage_anywhere_is_reported_or_harmless(tmp_path):
    path = tmp_path / "plan.npz"
    save_arrays(path, ARRAYS)
    whole = path.read_bytes()

    def is_refused(content) -> bool:
        path.write_bytes(content)
        try:
            loaded = load_arrays(path, ARRAYS)
        except ValueError as error:
            return str(error).startswith(str(path))
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(loaded[name], array)
        return False

    assert all(is_refused(whole[:size]) for size in range(len(whole)))
    flipped = [
        is_refused(whole[:at] + bytes([whole[at] ^ bits]) + whole[at + 1 :])
        for at in range(len(whole))
        for bits in (0x01, 0xFF)
    ]
    assert sum(flipped) > len(flipped) / 2


@settings(max_examples=50, deadline=None)
@given(content=st.binary(max_size=64))
def test_a_foreign_file_is_reported(content, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "foreign.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="make it again"):
        load_arrays(path)


@pytest.mark.parametrize("there", [None, b"", b"garbage", "lacks"])
def test_kept_arrays_are_made_again_where_they_are_missing_or_damaged(tmp_path, there):
    path, calls = tmp_path / "cache" / "kept.npz", []
    if there is not None:
        save_arrays(path, {"other": ARRAYS["q"]})
    if isinstance(there, bytes):
        path.write_bytes(there)

    def make():
        calls.append(1)
        return ARRAYS

    for _ in range(2):
        found = kept_arrays(path, ARRAYS, make)
        for name, array in ARRAYS.items():
            np.testing.assert_array_equal(found[name], array)
    assert len(calls) == 1


def test_arrays_that_cannot_be_kept_are_made_each_time(tmp_path):
    (tmp_path / "cache").write_text("a file, not a folder")
    path = tmp_path / "cache" / "kept.npz"
    assert kept_arrays(path, ARRAYS, lambda: ARRAYS) is ARRAYS
