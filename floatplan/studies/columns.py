"""A study's table: its columns as pyarrow has them, and its file."""

from __future__ import annotations

import io
from collections.abc import Mapping
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
