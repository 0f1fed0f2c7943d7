"""Columns of a study's table as pyarrow has them, and its file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, IntArray
from floatplan.errors import import_optional

ROW_GROUP = 65_536  # rows
WORDS = ("status", "explanation", "verdict")  # columns


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


def chosen(words: Sequence[str], each: npt.NDArray[np.str_]) -> Any:
    """Words (N,), each among a few."""
    return taken(words, np.select([each == word for word in words], range(len(words)), default=len(words)))


def taken(words: Sequence[str], which: IntArray) -> Any:
    """Words (N,) by their places; pyarrow's own ``take`` is slow to load."""
    pa, _ = arrow()
    return pa.array(np.array(words, dtype=object)[which], type=pa.string())


def as_column(pa: Any, values: Any, kind: Any) -> Any:
    """Return an array, or what is one already, as pyarrow has it; NaN as null."""
    if isinstance(values, pa.Array):
        return values
    if not isinstance(values, np.ndarray):
        return pa.array(values, type=kind)
    return pa.array(values, type=kind, from_pandas=True) if values.ndim == 1 else lists(pa, values)


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
