import dataclasses
import time
import zipfile

import numpy as np
import pytest

from selftouch_drake.agent.representation import QuotientRepresentation

# design.md: others read these by name.
CONTRACT = {
    "target_sensations",
    "kernel_offsets",
    "kernel_q",
    "kernel_row",
    "set_distance",
    "edges",
    "edge_cost",
    "embedding",
}


def test_what_is_saved_is_loaded(representation, tmp_path):
    representation.save(tmp_path / "representation.npz")
    found = QuotientRepresentation.load(tmp_path / "representation.npz")
    for field in dataclasses.fields(representation):
        here, there = getattr(representation, field.name), getattr(found, field.name)
        assert here.dtype == there.dtype
        np.testing.assert_array_equal(here, there)


def test_the_file_holds_the_contract_and_nothing_is_left_aside(representation, tmp_path):
    representation.save(tmp_path / "representation.npz")
    with np.load(tmp_path / "representation.npz") as archive:
        assert set(archive.files) >= CONTRACT
    assert [path.name for path in tmp_path.iterdir()] == ["representation.npz"]


def test_equal_arrays_give_equal_bytes_at_any_time(representation, tmp_path, monkeypatch):
    representation.save(tmp_path / "a.npz")
    later = time.time() + 1e6
    monkeypatch.setattr(time, "time", lambda: later)
    representation.save(str(tmp_path / "b.npz"))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_failed_save_leaves_the_file_of_before(representation, tmp_path, monkeypatch):
    path = tmp_path / "representation.npz"
    representation.save(path)
    before = path.read_bytes()

    def full_disk(file, **arrays):
        file.write(b"PK")
        raise OSError("No space left on device")

    monkeypatch.setattr(np, "savez", full_disk)
    with pytest.raises(OSError, match="No space"):
        representation.save(path)
    assert path.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["representation.npz"]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_file_is_refused(representation, tmp_path, share):
    path = tmp_path / "representation.npz"
    representation.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match="selftouch learn") as error:
        QuotientRepresentation.load(path)
    assert str(error.value).startswith(f"{path} is damaged (")
    assert str(error.value).endswith("); make it again with `selftouch learn`")


def test_a_damaged_byte_is_refused(representation, tmp_path):
    path = tmp_path / "representation.npz"
    representation.save(path)
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match="selftouch learn"):
        QuotientRepresentation.load(path)


def test_foreign_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", edges=np.zeros((0, 2)))
    np.save(tmp_path / "bare.npy", np.zeros(3))
    (tmp_path / "text.npz").write_text("kernels")
    for name in ("other.npz", "bare.npy", "text.npz"):
        with pytest.raises(ValueError, match="selftouch learn"):
            QuotientRepresentation.load(tmp_path / name)


def test_missing_keys_are_named(representation, tmp_path):
    path = tmp_path / "representation.npz"
    arrays = {f.name: getattr(representation, f.name) for f in dataclasses.fields(representation)}
    del arrays["edges"], arrays["kernel_q"]
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match="lacks") as error:
        QuotientRepresentation.load(path)
    assert str(error.value) == (
        f"{path} lacks kernel_q, edges; make it again with `selftouch learn`"
    )


@pytest.mark.parametrize(
    ("name", "array", "reason"),
    [
        ("embedding", np.zeros((5, 3)), "embedding has shape (5, 3), expected (120, 3)"),
        ("kernel_offsets", np.array(3), "kernel_offsets has shape (), expected (121)"),
        ("target_sensations", np.array(3), "target_sensations has shape (), expected "),
        ("edges", np.full((9, 2), "x"), "edges holds <U1"),
        ("kernel_q", np.full((9, 6), 1j), "kernel_q holds complex128"),
        ("edges", np.zeros((9, 2)), "edges holds float64"),
    ],
)
def test_arrays_that_are_something_else_are_refused(representation, tmp_path, name, array, reason):
    arrays = {f.name: getattr(representation, f.name) for f in dataclasses.fields(representation)}
    np.savez(tmp_path / "other.npz", **(arrays | {name: array}))
    with pytest.raises(ValueError, match="selftouch learn") as error:
        QuotientRepresentation.load(tmp_path / "other.npz")
    assert str(error.value).startswith(
        f"{tmp_path / 'other.npz'} is no quotient representation: {reason}"
    )


def test_pickles_are_not_run(representation, tmp_path):
    arrays = {f.name: getattr(representation, f.name) for f in dataclasses.fields(representation)}
    arrays["edges"] = np.array([{}], dtype=object)
    np.savez(tmp_path / "evil.npz", **arrays)
    with pytest.raises(ValueError, match="allow_pickle"):
        QuotientRepresentation.load(tmp_path / "evil.npz")


def test_a_missing_file_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        QuotientRepresentation.load(tmp_path / "nowhere.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"embedding": np.zeros((5, 3))}, "embedding has shape (5, 3), expected (120, 3)."),
        ({"edges": np.array([[0, 120]]), "edge_cost": np.ones(1)}, "edges must join kernels 0 to"),
        ({"kernel_offsets": np.zeros(121, int)}, "kernel_offsets must rise from 0 to"),
    ],
)
def test_shapes_that_disagree_are_refused(representation, change, message):
    with pytest.raises(ValueError, match=r"shape|must") as error:
        dataclasses.replace(representation, **change)
    assert str(error.value).startswith(message)
