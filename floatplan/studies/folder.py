"""The folder of a study and its table: chunks written whole, resumed, merged into one table; one run at a time."""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock, Timeout

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError, import_optional
from floatplan.files import read_json, read_regular, write_atomically

FORMAT = "floatplan.study/1"
STUDY, RESULTS, CHUNKS, SHARDS, LOCK = "study.json", "results.parquet", "chunks", "shards", ".lock"
MAPS = ("map.png", "map.svg", "map.html")
LARGEST_CHUNK = 1_000_000_000  # [bytes]
LARGEST_STUDY_RECORD = 1_000_000  # [bytes] of study.json
ROW_GROUP = 65_536  # rows
WORDS = ("status", "explanation", "verdict")  # columns

Range = tuple[int, int]


@dataclass(frozen=True)
class Shard:
    """The ``number``-th, from 1, of ``count`` equal shares of a study's rows, which follow each other."""

    number: int
    count: int

    def __str__(self) -> str:
        """As it is asked for."""
        return f"{self.number}/{self.count}"

    def rows(self, total: int) -> Range:
        """Its rows of so many."""
        return total * (self.number - 1) // self.count, total * self.number // self.count

    @classmethod
    def asked(cls, words: str, total: int) -> Shard:
        """Read "3/64" about a study of so many rows; each shard has one at least."""
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", words)
        shard = cls(int(found[1]), int(found[2])) if found else cls(0, 0)
        if not 1 <= shard.number <= shard.count <= total:
            reason = f"must be the number of a shard and how many there are, such as 3/64, not {words!r}"
            raise InputError(reason, element="shard", advice=f"{total} rows make 1/1 to {total}/{total}")
        return shard


class StudyFolder:
    """Where some rows of a study are kept, from the first to the one before the last, or all of them."""

    def __init__(self, path: Path, rows: Range) -> None:
        self.path = path
        self.rows = rows

    @property
    def results(self) -> Path:
        """The merged table."""
        return self.path / RESULTS

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out; a lock goes with its process, however that ends.

        Raises
        ------
        InputError
            Another run is at work here, or the folder cannot be written to.
        """
        # no lock of another kind where the file system has none: it would outlive a process that is killed
        lock = FileLock(self.path / LOCK, blocking=False, fallback_to_soft=False)
        with naming_the_folder(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(Timeout):
                lock.acquire()
        if not lock.is_locked:
            raise InputError("another run is at work in this folder", source=self.path)
        try:
            yield
        finally:
            lock.release()

    def open(self, digest: str, facts: Mapping[str, Any], restart: bool) -> None:
        """Take the folder for a study, or go on with it.

        Raises
        ------
        InputError
            It holds another study, or results of unknown origin.
        """
        if restart:  # what a study leaves goes, and nothing else
            made = [self.path / name for name in (RESULTS, *MAPS, STUDY)]
            for path in [*(path for path, _ in self._chunks()), *made]:
                path.unlink(missing_ok=True)
        known = self.record()
        if known is None:
            if any(self.path.glob(f"{CHUNKS}/*.parquet")) or self.results.exists():
                raise InputError("holds results of no known study", source=self.path, advice=ADVICE)
            record = {"format": FORMAT, "hash": digest, **facts}
            write_atomically(self.path / STUDY, json.dumps(record, indent=1, allow_nan=False))
        elif known.get("hash") != digest:
            raise InputError(
                "holds results of another study, problem, robot, code or solver", source=self.path, advice=ADVICE
            )

    def record(self) -> dict[str, Any] | None:
        """What it says of its study, nothing where that is spoiled; None where there is no record."""
        path = self.path / STUDY
        if not path.exists():
            return None
        try:
            content = read_json(path, LARGEST_STUDY_RECORD, "a study's record")
        except InputError as error:
            raise InputError(error.reason, source=path, advice=ADVICE) from None
        return content if isinstance(content, dict) else {}

    def _chunks(self) -> list[tuple[Path, Range]]:
        """Files of chunks by their names, in the order of their rows."""
        found = []
        for path in (self.path / CHUNKS).glob("*.parquet"):
            name = re.fullmatch(r"(\d{7,9})-(\d{7,9})", path.stem, flags=re.ASCII)
            if name:
                found.append((path, (int(name[1]), int(name[2]) + 1)))
        return sorted(found, key=lambda chunk: chunk[1])

    def keep(self, first: int, stop: int, content: bytes) -> None:
        """Write a chunk, whole or not at all."""
        with naming_the_folder(self.path):
            write_atomically(self.path / CHUNKS / f"{first:07d}-{stop - 1:07d}.parquet", content)

    def missing(self, are_in: Callable[[Any, int, int], bool]) -> list[Range]:
        """Ranges of rows that are still to be planned.

        Chunks are removed that cannot be read, or that do not hold their rows: ``are_in`` says so of a table.
        """
        gaps, reached = [], self.rows[0]
        for path, (first, stop) in self._chunks():
            if first < reached or stop > self.rows[1] or not _holds(path, first, stop, are_in):
                with naming_the_folder(path):
                    path.unlink(missing_ok=True)
                continue
            if first > reached:
                gaps.append((reached, first))
            reached = stop
        return [*gaps, (reached, self.rows[1])] if reached < self.rows[1] else gaps

    def table(self) -> Any:
        """All chunks as one table."""
        pa, _ = arrow()
        return pa.concat_tables([_read(path) for path, _ in self._chunks()])

    def merge(self) -> Any:
        """Put all chunks into one table, write it, and return it."""
        table = self.table()
        with naming_the_folder(self.path):
            write_atomically(self.results, written(table))
        return table


ADVICE = "--restart discards them; or give another folder"
KEPT = "what is there stays, and is resumed"


@contextmanager
def naming_the_folder(path: Path) -> Iterator[None]:
    """Say of what the system refuses, such as on a full disk, which file it is and that nothing is lost."""
    try:
        yield
    except InputError as error:
        raise InputError(error.reason, source=error.source, advice=KEPT) from None
    except OSError as error:
        reason = f"cannot be written: {error.strerror or error}"
        raise InputError(reason, source=error.filename or path, advice=KEPT) from None


def _holds(path: Path, first: int, stop: int, are_in: Callable[[Any, int, int], bool]) -> bool:
    """Whether a chunk can be read, its pages have their checksums, and it has its rows."""
    pa, _ = arrow()
    with contextlib.suppress(InputError, OSError, pa.ArrowException):
        return are_in(_read(path), first, stop)
    return False


def _read(path: Path) -> Any:
    """A chunk as a table."""
    return read_table(read_regular(path, LARGEST_CHUNK, "a chunk of a study"))


def arrow() -> tuple[Any, ...]:
    """Return pyarrow and pyarrow.parquet.

    Raises
    ------
    InputError
        They are not installed.
    """
    return tuple(
        import_optional(module, name="pyarrow", element="study", extra="study")
        for module in ("pyarrow", "pyarrow.parquet")
    )


def written(table: Any) -> bytes:
    """A table as a Parquet file, whose damage would be seen."""
    _, pq = arrow()
    stream = io.BytesIO()
    names = table.column_names
    pq.write_table(
        table,
        stream,
        row_group_size=ROW_GROUP,
        compression="snappy",
        use_dictionary=[name for name in WORDS if name in names],  # numbers hardly ever repeat
        write_statistics=[name for name in names if name != "coefficients"],  # by which nobody looks for a row
        write_page_checksum=True,
    )
    return stream.getvalue()


def read_table(content: bytes) -> Any:
    """A table from a Parquet file's content; its pages are checked."""
    pa, pq = arrow()
    with pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True) as file:
        return file.read(use_threads=False)


def table_of(columns: Mapping[str, Any], units: Mapping[str, str]) -> Any:
    """A table of columns, with their units as metadata where they have one; NaN as null."""
    pa, _ = arrow()
    arrays = [_column(pa, name, values) for name, values in columns.items()]
    fields = [
        pa.field(name, array.type, metadata={"unit": units[name]} if units.get(name) else None)
        for name, array in zip(columns, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _column(pa: Any, name: str, values: Any) -> Any:
    if name in WORDS:
        return pa.array(values, type=pa.string())
    if name != "coefficients":
        return pa.array(values, from_pandas=True)
    return lists(pa, values) if isinstance(values, np.ndarray) else pa.array(values, pa.list_(pa.list_(pa.float64())))


def lists(pa: Any, values: Array) -> Any:
    """Lists (n) of lists from (N, n, k+1), without what is NaN: joints of unlike degrees, or rows without a motion."""
    count, n, size = values.shape
    finite = np.isfinite(values)
    if finite.all():
        inner = pa.ListArray.from_arrays(_offsets(np.full(count * n, size)), values.ravel())
        return pa.ListArray.from_arrays(_offsets(np.full(count, n)), inner)
    there = finite.any(axis=(1, 2))
    inner = pa.ListArray.from_arrays(_offsets(finite[there].sum(axis=2).ravel()), values[finite])
    missing = np.append(~there, False)
    return pa.ListArray.from_arrays(pa.array(_offsets(n * there), mask=missing), inner)


def _offsets(lengths: IntArray) -> npt.NDArray[np.int32]:
    """Where lists that follow each other begin, and where the last one ends."""
    return np.concatenate(([0], np.cumsum(lengths)), dtype=np.int32, casting="unsafe")


def words(table: Any, column: str) -> tuple[list[str], IntArray]:
    """Words of a column of a table, in the order in which they appear, and which (N,) each row has."""
    encoded = table[column].combine_chunks().dictionary_encode()
    return encoded.dictionary.to_pylist(), encoded.indices.to_numpy()
