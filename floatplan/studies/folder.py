"""The folder of a study and its table: chunks written whole, resumed, merged into one table; one run at a time."""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock, Timeout

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError, import_optional
from floatplan.files import check_readable, read_json, read_regular, write_atomically


class ResultFile(StrEnum):
    """Names of files and folders of a study."""

    RECORD = "study.json"
    RESULTS = "results.parquet"
    CHUNKS = "chunks"  # a folder
    SHARDS = "shards"  # a folder of folders


LARGEST_RECORD = 1_000_000  # [bytes] of study.json
WORDS = ("status", "explanation", "verdict")  # columns

Range = tuple[int, int]


@dataclass(frozen=True)
class Shard:
    """The ``number``-th, from 1, of ``count`` equal shares of a study's rows, which follow each other."""

    number: int
    count: int

    def __str__(self) -> str:
        """As the command line has it."""
        return f"{self.number}/{self.count}"

    def rows(self, total: int) -> Range:
        """Its rows of so many."""
        return total * (self.number - 1) // self.count, total * self.number // self.count

    @classmethod
    def parse(cls, words: str, total: int) -> Shard:
        """Read "3/64" about a study of so many rows; each shard has one at least."""
        match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", words)
        shard = cls(int(match[1]), int(match[2])) if match else cls(0, 0)
        if not 1 <= shard.number <= shard.count <= total:
            reason = f"must be the number of a shard and how many there are, such as 3/64, not {words!r}"
            raise InputError(reason, element="shard", advice=f"{total} rows make 1/1 to {total}/{total}")
        return shard


class StudyFolder:
    """The folder of some rows of a study, from the first to the one before the last, or of all."""

    def __init__(self, path: Path, rows: Range) -> None:
        self.path = path
        self.rows = rows

    @property
    def results(self) -> Path:
        """The merged table."""
        return self.path / ResultFile.RESULTS

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out; a lock goes with its process, however that ends.

        Raises
        ------
        InputError
            Another run is at work here, or the folder cannot be written to.
        """
        # no lock of another kind where the file system has none: it would outlive a process that is killed
        lock = FileLock(self.path / ".lock", blocking=False, fallback_to_soft=False)
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
            It holds another study, or results of unknown origin; or what is to be discarded cannot be read.
        """
        if restart:
            self._discard()
        record = self.record()
        if record is None:
            if self._chunks() or self.results.exists():
                raise InputError("holds results of no known study", source=self.path, advice=ADVICE)
            new_record = {"format": "floatplan.study/1", "hash": digest, **facts}
            write_atomically(self.path / ResultFile.RECORD, json.dumps(new_record, indent=1, allow_nan=False))
        elif record.get("hash") != digest:
            raise InputError(
                "holds results of another study, problem, robot, code or solver", source=self.path, advice=ADVICE
            )

    def _discard(self) -> None:
        """Remove all files of a study, and nothing else; nothing where some of them cannot be read."""
        discarded = [path for path, _ in self._chunks()]
        discarded += [
            self.path / name for name in (ResultFile.RESULTS, "map.png", "map.svg", "map.html", ResultFile.RECORD)
        ]
        for path in discarded:
            check_readable(path, "is not discarded")
        with naming_the_folder(self.path):
            for path in discarded:
                path.unlink(missing_ok=True)

    def record(self) -> dict[str, Any] | None:
        """The record of its study, an empty one where that is spoiled; None where there is no record.

        Raises
        ------
        InputError
            The record cannot be read, or is no JSON.
        """
        path = self.path / ResultFile.RECORD
        with naming_unreadable(path):
            if not path.exists():
                return None
        read_regular(path, LARGEST_RECORD, "a study's record")  # where this fails, nothing is to be discarded
        try:
            content = read_json(path, LARGEST_RECORD, "a study's record")
        except InputError as error:
            raise InputError(error.reason, source=path, advice=ADVICE) from None
        return content if isinstance(content, dict) else {}

    def _chunks(self) -> list[tuple[Path, Range]]:
        """Files of chunks by their names, in the order of their rows.

        Raises
        ------
        InputError
            The folder is there and cannot be listed.
        """
        chunks = []
        for path in listed(self.path / ResultFile.CHUNKS):
            match = re.fullmatch(r"(\d{7,9})-(\d{7,9})\.parquet", path.name, flags=re.ASCII)
            if match:
                chunks.append((path, (int(match[1]), int(match[2]) + 1)))
        return sorted(chunks, key=lambda chunk: chunk[1])

    def save(self, first: int, stop: int, content: bytes) -> None:
        """Write a chunk, whole or not at all."""
        with naming_the_folder(self.path):
            write_atomically(self.path / ResultFile.CHUNKS / f"{first:07d}-{stop - 1:07d}.parquet", content)

    def contents(self, are_in: Callable[[Any, int, int], bool]) -> Contents:
        """Return what the folder has; all chunks are read, and nothing changes.

        Parameters
        ----------
        are_in : callable
            Whether a table holds the rows from one index to the one before another.

        Raises
        ------
        InputError
            A chunk cannot be read, so that nobody can tell whether it is damaged.
        """
        contents = Contents()
        next_row = self.rows[0]
        for path, (first, stop) in self._chunks():
            table = _read(path)
            if first < next_row or stop > self.rows[1] or table is None or not are_in(table, first, stop):
                contents.damaged.append(path)
                continue
            if first > next_row:
                contents.gaps.append((next_row, first))
            contents.chunks.append(path)
            next_row = stop
        if next_row < self.rows[1]:
            contents.gaps.append((next_row, self.rows[1]))
        return contents

    def missing(self, are_in: Callable[[Any, int, int], bool]) -> list[Range]:
        """Return the ranges of rows that are still to be planned, and remove the chunks that are damaged.

        A chunk is damaged when it was read and is no table, or does not hold its rows by ``are_in``, which is as of
        :meth:`contents`. Where a chunk cannot be read nothing is removed.

        Raises
        ------
        InputError
            As :meth:`contents`; or a damaged chunk cannot be removed.
        """
        contents = self.contents(are_in)
        for path in contents.damaged:
            with naming_the_folder(path):
                path.unlink(missing_ok=True)
        return contents.gaps

    def table(self, chunks: Sequence[Path] | None = None) -> Any:
        """Chunks, all of the folder if left out, as one table."""
        pa, _ = arrow()
        paths = [path for path, _ in self._chunks()] if chunks is None else chunks
        tables = list(map(_read, paths))
        for path, table in zip(paths, tables, strict=True):
            if table is None:
                raise InputError("was damaged meanwhile", source=path, advice="give the same command again")
        return pa.concat_tables(tables)

    def merge(self) -> Any:
        """Put all chunks into one table, write it, and return it."""
        table = self.table()
        with naming_the_folder(self.path):
            write_atomically(self.results, written(table))
        return table


@dataclass(frozen=True)
class Contents:
    """The chunks in a study's folder, and the rows that are missing.

    Attributes
    ----------
    chunks : list of Path
        Chunks that hold their rows, in the order of these.
    damaged : list of Path
        Chunks that were read and are no tables, or do not hold their rows, or hold rows that an earlier one has.
    gaps : list of (int, int)
        Ranges of rows that no chunk holds, each from its first row to the one after its last.
    """

    chunks: list[Path] = field(default_factory=list)
    damaged: list[Path] = field(default_factory=list)
    gaps: list[Range] = field(default_factory=list)


ADVICE = "--restart discards them; or give another folder"
STAYS = "what is there stays, and is resumed"
NOTHING_REMOVED = "nothing was removed; make it readable, or move it away to have its rows planned again"


@contextmanager
def naming_the_folder(path: Path) -> Iterator[None]:
    """Name the file in errors of the system, such as of a full disk, and say that nothing is lost."""
    try:
        yield
    except InputError as error:
        raise InputError(error.reason, source=error.source, advice=STAYS) from None
    except OSError as error:
        reason = f"cannot be written: {error.strerror or error}"
        raise InputError(reason, source=error.filename or path, advice=STAYS) from None


@contextmanager
def naming_unreadable(path: Path) -> Iterator[None]:
    """Convert errors of the system about a path into messages that name it."""
    try:
        yield
    except OSError as error:
        reason = f"cannot be read: {error.strerror or error}"
        raise InputError(reason, source=error.filename or path, advice=NOTHING_REMOVED) from None


def listed(folder: Path) -> list[Path]:
    """The paths in a folder; none where there is no folder.

    ``Path.glob`` would take a folder that cannot be listed for an empty one.

    Raises
    ------
    InputError
        The folder cannot be listed.
    """
    with naming_unreadable(folder):
        try:
            return sorted(folder.iterdir())
        except FileNotFoundError:
            return []


def _read(path: Path) -> Any:
    """A chunk as a table, or None where its content was read and is no table, or its pages lack their checksums.

    Raises
    ------
    InputError
        It cannot be read: the system refuses it, memory runs out, or this pyarrow cannot decode it. Such a chunk may be
        sound, so that it must not be taken for a damaged one.
    """
    pa, _ = arrow()
    try:
        content = read_regular(path, 1_000_000_000, "a chunk of a study")
    except InputError as error:
        raise InputError(error.reason, source=path, advice=NOTHING_REMOVED) from None
    try:
        return decoded(content)
    except (MemoryError, pa.ArrowNotImplementedError) as error:
        reason = str(error) or "memory ran out"
        raise InputError(f"cannot be read: {reason}", source=path, advice=NOTHING_REMOVED) from None


def decoded(content: bytes) -> Any:
    """A table from a Parquet file's content, or None where that is damaged.

    Raises
    ------
    MemoryError, pyarrow.ArrowNotImplementedError
        Memory runs out, or this pyarrow lacks what the file was written with.
    """
    pa, _ = arrow()
    try:
        return read_table(content)
    except (MemoryError, pa.ArrowNotImplementedError):
        raise
    except (OSError, pa.ArrowException):
        return None


def arrow() -> tuple[Any, ...]:
    """Return pyarrow and pyarrow.parquet.

    Raises
    ------
    InputError
        They are not installed.
    """
    parquet = import_optional("pyarrow.parquet", name="pyarrow", element="study", extra="study")
    return import_optional("pyarrow", name="pyarrow", element="study", extra="study"), parquet


def written(table: Any) -> bytes:
    """A table as a Parquet file, with checksums by which damage is recognised."""
    _, pq = arrow()
    stream = io.BytesIO()
    names = table.column_names
    pq.write_table(
        table,
        stream,
        row_group_size=65_536,
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
    arrays = []
    fields = []
    for name, values in columns.items():
        array = _column(pa, name, values)
        metadata = {"unit": units[name]} if units.get(name) else None
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata=metadata))
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _column(pa: Any, name: str, values: Any) -> Any:
    if name in WORDS:
        return pa.array(values, type=pa.string())
    if name != "coefficients":
        return pa.array(values, from_pandas=True)
    return lists(pa, values) if isinstance(values, np.ndarray) else pa.array(values, pa.list_(pa.list_(pa.float64())))


def lists(pa: Any, values: Array) -> Any:
    """Lists (n) of lists from (N, n, k+1), without NaN: joints of different degrees, or rows without a motion."""
    count, n, size = values.shape
    finite = np.isfinite(values)
    if finite.all():
        inner = pa.ListArray.from_arrays(_offsets(np.full(count * n, size)), values.ravel())
        return pa.ListArray.from_arrays(_offsets(np.full(count, n)), inner)
    has_motion = finite.any(axis=(1, 2))
    inner = pa.ListArray.from_arrays(_offsets(finite[has_motion].sum(axis=2).ravel()), values[finite])
    missing = np.append(~has_motion, False)
    return pa.ListArray.from_arrays(pa.array(_offsets(n * has_motion), mask=missing), inner)


def _offsets(lengths: IntArray) -> npt.NDArray[np.int32]:
    """Where lists that follow each other begin, and where the last one ends."""
    return np.concatenate(([0], np.cumsum(lengths)), dtype=np.int32, casting="unsafe")


def words(table: Any, column: str) -> tuple[list[str], IntArray]:
    """Words of a column of a table, in the order in which they appear, and which (N,) each row has."""
    encoded = table[column].combine_chunks().dictionary_encode()
    return encoded.dictionary.to_pylist(), encoded.indices.to_numpy()
