"""The experience store: touching motor configurations and their sensations, as Parquet shards.

One shard is one random walk. `experience/` holds what the agent felt, `truth/` what only the
experimenter may know, with the same rows. A shard is written aside, flushed and renamed, truth
first: if the experience of a walk exists, it is complete, and so is its truth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from selftouch_drake.files import written_whole
from selftouch_drake.threads import mapped

# Shards that are read side by side.
_AT_ONCE = 2

# The columns of the truth.
_CONTACTS = {
    **dict.fromkeys(("skin", "toucher"), pa.list_(pa.int8())),
    "p_LC": pa.list_(pa.list_(pa.float32(), 3)),
}

# What Arrow raises for damaged files; the last for names in a footer, which has no checksum.
UNREADABLE = (pa.ArrowException, OSError, UnicodeDecodeError)


class StoreError(ValueError):
    """A shard that is missing, damaged or of another experiment; the text names it."""


class WalkCounts(NamedTuple):
    """What walks took.

    Attributes:
        num_steps: steps.
        num_impossible: of these, touching ones in a posture that the robot cannot take.
        num_rows: touches that were kept.
        robot_s: s, time of a body that has a time of its own.
    """

    num_steps: int = 0
    num_impossible: int = 0
    num_rows: int = 0
    robot_s: float = 0.0

    def __add__(self, other):
        return WalkCounts(*(a + b for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contacts:
    """The contacts behind N touches, C in all: the truth.

    Attributes:
        offsets: `(N + 1,)` touch n has the contacts `offsets[n]:offsets[n + 1]`.
        skin: `(C,)` int8, number of the skin that is pressed.
        toucher: `(C,)` int8, number of the toucher that presses it; skins come after the touchers.
        p_LC: `(C, 3)` float32 m, centre of pressure in the frame of the pressed skin's link.
    """

    offsets: np.ndarray
    skin: np.ndarray
    toucher: np.ndarray
    p_LC: np.ndarray

    @staticmethod
    def of_rows(found: Any, rows: np.ndarray) -> "Contacts":
        """Contacts of some rows; those found have `row` (ascending), `skin`, `toucher`, `p_LC`."""
        start, end = (np.searchsorted(found.row, rows, side) for side in ("left", "right"))
        offsets = np.concatenate([[0], np.cumsum(end - start)])
        chosen = np.repeat(start - offsets[:-1], end - start) + np.arange(offsets[-1])
        return Contacts(
            offsets=offsets.astype(np.int64),
            skin=found.skin[chosen].astype(np.int8),
            toucher=found.toucher[chosen].astype(np.int8),
            p_LC=found.p_LC[chosen].astype(np.float32),
        )

    @staticmethod
    def joined(parts: "Sequence[Contacts]") -> "Contacts":
        """The contacts of all parts, one after another."""
        counts = np.concatenate([np.diff(part.offsets) for part in parts])
        return Contacts(
            offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            **{n: np.concatenate([getattr(part, n) for part in parts]) for n in _CONTACTS},
        )

    def __len__(self) -> int:
        """N."""
        return len(self.offsets) - 1

    @property
    def row(self) -> np.ndarray:
        """`(C,)` the touch that each contact belongs to."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))

    def __getitem__(self, rows: np.ndarray) -> "Contacts":
        """The contacts of some touches, in any order."""
        return Contacts.of_rows(self, np.asarray(rows))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shard:
    """The touches of one random walk, in the order of the walk.

    Attributes:
        walk: number of the walk.
        num_steps: steps walked, touching or not.
        num_impossible: steps that touched in a posture that the robot cannot take.
        step: `(N,)` the step of each touch.
        q: `(N, J)` rad or m, motor configurations.
        sensation: `(N, S)` N, the skins' readings one after another.
        contacts: of each touch: the truth; None if it is unknown.
        robot_s: s, time of a body that has a time of its own.
    """

    walk: int
    num_steps: int
    num_impossible: int = 0
    step: np.ndarray
    q: np.ndarray
    sensation: np.ndarray
    contacts: Contacts | None = None
    robot_s: float = 0.0

    @property
    def counts(self) -> WalkCounts:
        """What this walk took."""
        return WalkCounts(
            num_steps=self.num_steps,
            num_impossible=self.num_impossible,
            num_rows=len(self.step),
            robot_s=self.robot_s,
        )


def shard_name(walk: int) -> str:
    """The file name of a walk's shard."""
    return f"part-{walk:05d}.parquet"


def write_shard(run: Path, shard: Shard, *, fingerprint: str, folder: str = "experience") -> None:
    """Writes the experience of one walk, and the truth if it is known, into the run directory.

    The experience goes into `folder`, with its fingerprint.
    """
    metadata = {
        b"selftouch.fingerprint": fingerprint.encode(),
        b"selftouch.num_steps": str(shard.num_steps).encode(),
        b"selftouch.num_impossible": str(shard.num_impossible).encode(),
    }
    if shard.robot_s:
        metadata[b"selftouch.robot_s"] = repr(shard.robot_s).encode()
    walk = pa.array(np.full(len(shard.step), shard.walk, dtype=np.int32))
    key = {"walk": walk, "step": pa.array(shard.step.astype(np.int64))}
    felt = {**key, "q": _vectors(shard.q), "sensation": _vectors(shard.sensation)}
    folders = {folder: felt}
    if (contacts := shard.contacts) is not None:
        truth = {
            **key,
            "skin": _lists(contacts.offsets, pa.array(contacts.skin.astype(np.int8))),
            "toucher": _lists(contacts.offsets, pa.array(contacts.toucher.astype(np.int8))),
            "p_LC": _lists(contacts.offsets, _vectors(contacts.p_LC)),
        }
        # Truth first: experience without it would look complete.
        folders = {"truth": truth} | folders
    for into, columns in folders.items():
        table = pa.table(columns).replace_schema_metadata(metadata)
        (run / into).mkdir(exist_ok=True)
        with written_whole(run / into / shard_name(shard.walk)) as aside:
            pq.write_table(
                table, aside, compression="zstd", use_dictionary=False, write_page_checksum=True
            )


def read_counts(
    run: Path,
    walk: int,
    *,
    num_rows: int,
    fingerprint: str,
    folder: str = "experience",
    or_fewer: bool = False,
) -> WalkCounts | None:
    """What a walk took that is already stored in `folder` of a run, or None if it is not.

    It has `num_rows` touches, or may have ended with fewer, because time was up.

    Raises:
        StoreError: the shard is damaged, or of another experiment.
    """
    path = run / folder / shard_name(walk)
    if not path.exists():
        return None
    parquet = _open(path)
    metadata = parquet.schema_arrow.metadata or {}
    if metadata.get(b"selftouch.fingerprint") != fingerprint.encode():
        raise StoreError(f"{path} belongs to another experiment; choose another --out")
    found = parquet.metadata.num_rows
    if found != num_rows and not (or_fewer and found < num_rows):
        raise StoreError(f"{path} has {found} rows, not {num_rows}; delete it")
    try:
        return WalkCounts(
            num_steps=int(metadata[b"selftouch.num_steps"]),
            num_impossible=int(metadata[b"selftouch.num_impossible"]),
            num_rows=found,
            robot_s=float(metadata.get(b"selftouch.robot_s", 0.0)),
        )
    except (KeyError, ValueError):
        raise StoreError(f"{path} lacks its number of steps; delete it and babble again") from None


def shards_of(folder: Path) -> list[Path]:
    """The shards of a folder, in order of their walks; none if there is no such folder."""
    # By number: beyond 99999 the names are longer.
    return sorted(folder.glob("part-*.parquet"), key=lambda p: (len(p.name), p.name))


@dataclass(frozen=True, slots=True)
class StoredTouches:
    """The touches of one shard, which are read where they are needed."""

    path: Path
    num_rows: int

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Sensations `(N, S)` and motor configurations `(N, J)`."""
        return _vector_rows(self.path, "sensation"), _vector_rows(self.path, "q")


class ExperienceReader:
    """Reads the shards of one folder, `experience` or `truth`, in walk order.

    Shards of another folder, that were added later, come after them.

    Raises:
        StoreError: there is no shard, or one is damaged or misses a column.
    """

    def __init__(self, folder: Path, added: Path | None = None):
        self._paths = shards_of(folder)
        if added is not None:
            self._paths += shards_of(added)
        if not self._paths:
            raise StoreError(f"{folder} holds no shard; run `selftouch babble` first")

    @property
    def num_rows(self) -> int:
        """Touches in all shards, read from their footers."""
        return sum(_open(path).metadata.num_rows for path in self._paths)

    def batches(self, column: str) -> Iterator[np.ndarray]:
        """The rows `(N, width)` of a vector column, one array per shard."""
        width = None
        for first in range(0, len(self._paths), _AT_ONCE):
            paths = self._paths[first : first + _AT_ONCE]
            read = mapped(lambda path: _vector_rows(path, column), paths)
            for path, rows in zip(paths, read, strict=True):
                if width not in (None, rows.shape[1]):
                    raise StoreError(
                        f"{path} has {rows.shape[1]} numbers per row in {column}, earlier shards "
                        f"{width}; remove it: it belongs to another experiment"
                    )
                width = rows.shape[1]
                yield rows

    def contacts(self) -> "Iterator[Contacts]":
        """The contacts of the truth, one object per shard.

        Raises:
            StoreError: a shard is damaged, or does not hold the truth.
        """
        return map(_contacts_of, self._paths)

    def take_contacts(self, rows: np.ndarray) -> "Contacts":
        """The contacts of some touches, in memory that does not grow with the store.

        The `(R,)` numbers of the touches may be in any order.

        Raises:
            StoreError: one is too large, or a shard is damaged.
        """
        order = np.argsort(rows, kind="stable")
        taken, first, parts = 0, 0, []
        for contacts in self.contacts():
            end = int(np.searchsorted(rows, first + len(contacts), sorter=order))
            parts.append(contacts[rows[order[taken:end]] - first])
            taken, first = end, first + len(contacts)
        if taken < len(rows):
            raise StoreError(
                f"{self._paths[0].parent} has {first} rows, but row {max(rows)} is needed; it "
                "belongs to another experiment: babble again"
            )
        return Contacts.joined(parts)[np.argsort(order, kind="stable")]

    def touches(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Sensations `(N, S)` and motor configurations `(N, J)`, two arrays per shard."""
        return zip(self.batches("sensation"), self.batches("q"), strict=True)

    def steps(self) -> Iterator[np.ndarray]:
        """`(N,)` numbers of the steps of a walk in which touches were felt, one array per shard."""
        return (_open(path).read(["step"]).column("step").to_numpy() for path in self._paths)

    def stored(self) -> Iterator[StoredTouches]:
        """The same, unread, for processes that see these files."""
        return (StoredTouches(p.resolve(), _open(p).metadata.num_rows) for p in self._paths)

    def read(self, column: str) -> np.ndarray:
        """All rows `(N, width)` of a vector column."""
        return np.concatenate(list(self.batches(column)))


def _contacts_of(path: Path) -> Contacts:
    """The contacts in one shard of the truth."""
    parquet = _open(path)
    if any(_type(parquet.schema_arrow, name) != kind for name, kind in _CONTACTS.items()):
        raise StoreError(f"{path} has no contacts; give a folder of shards of the truth")
    try:
        table = parquet.read([*_CONTACTS])
    except UNREADABLE as error:
        raise _damaged(path, error) from None
    columns = [one_chunk(table.column(name)) for name in _CONTACTS]
    lengths = [np.diff(lists.offsets.to_numpy()) for lists in columns]
    values = [lists.flatten() for lists in columns]
    has_nulls = any(array.null_count for array in (*columns, *values))
    if has_nulls or any(not np.array_equal(lengths[0], other) for other in lengths[1:]):
        raise StoreError(f"{path} lacks values; delete it and babble again")
    skin, toucher, p_LC = values
    return Contacts(
        offsets=np.concatenate([[0], np.cumsum(lengths[0])]).astype(np.int64),
        skin=skin.to_numpy(zero_copy_only=False),
        toucher=toucher.to_numpy(zero_copy_only=False),
        p_LC=p_LC.flatten().to_numpy(zero_copy_only=False).reshape(-1, 3),
    )


def _vectors(rows: np.ndarray) -> pa.FixedSizeListArray:
    flat = pa.array(np.ascontiguousarray(rows, dtype=np.float32).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, rows.shape[1])


def _lists(offsets: np.ndarray, values: pa.Array) -> pa.ListArray:
    return pa.ListArray.from_arrays(pa.array(offsets.astype(np.int32)), values)


def one_chunk(column: pa.ChunkedArray) -> pa.Array:
    """The values of a column in one array."""
    joined = column.combine_chunks()
    return pa.concat_arrays(joined.chunks) if isinstance(joined, pa.ChunkedArray) else joined


def _type(schema: pa.Schema, column: str) -> pa.DataType:
    """The type of a column; null unless there is exactly one of that name."""
    return schema.field(column).type if schema.names.count(column) == 1 else pa.null()


def _open(path: Path) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(path, page_checksum_verification=True)
    except UNREADABLE as error:
        raise _damaged(path, error) from None


def _vector_rows(path: Path, column: str) -> np.ndarray:
    """The rows `(N, width)` of a vector column of one shard."""
    parquet = _open(path)
    kind = _type(parquet.schema_arrow, column)
    fits = pa.types.is_fixed_size_list(kind) and pa.types.is_float32(kind.value_type)
    if not fits or not kind.list_size:
        raise StoreError(f"{path} has no column {column}; give a folder of such shards")
    try:
        vectors = one_chunk(parquet.read([column]).column(column))
    except UNREADABLE as error:
        raise _damaged(path, error) from None
    numbers = vectors.flatten()
    num_rows = parquet.metadata.num_rows
    if len(vectors) != num_rows or vectors.null_count or numbers.null_count:
        raise StoreError(f"{path} lacks values of {column}; delete it and babble again")
    return numbers.to_numpy().reshape(num_rows, vectors.type.list_size)


def _damaged(path: Path, error: Exception) -> StoreError:
    reason = str(error).splitlines()[0][:200]
    return StoreError(f"{path} is damaged ({reason}); delete it and babble again")
