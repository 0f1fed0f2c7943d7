"""How results show themselves: short text for a prompt, tables for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import islice
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

MOST_NUMBERS = 8  # [-] of a list in a line
LINE = 160  # [-] characters of one


def shortened(values: Iterable[float]) -> str:
    """Numbers in a line, so many at most."""
    numbers = [f"{float(value) + 0.0:.4g}" for value in values]
    more = len(numbers) - MOST_NUMBERS
    return ", ".join(numbers if more <= 0 else [*numbers[:MOST_NUMBERS], f"... ({more} more)"])


class Outlined:
    """A dataclass that shows its fields, or what ``shown`` names, one a line; arrays by their shapes and ranges."""

    shown: ClassVar[Sequence[str]] = ()

    def __repr__(self) -> str:
        names = self.shown or [each.name for each in fields(self)]  # type: ignore[arg-type]
        rows = ((name, _brief(getattr(self, name))) for name in names)
        return outline(type(self).__name__, ((name, text) for name, text in rows if text))


def outline(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """A title, and a line for each row below it."""
    lines = (f"  {name}: {text}" for name, text in rows)
    return "\n".join([title, *(line if len(line) <= LINE else f"{line[: LINE - 4]} ..." for line in lines)])


def _brief(value: object) -> str:
    """A value in at most about a line."""
    if isinstance(value, np.ndarray):
        return _brief_array(value)
    if isinstance(value, Mapping):
        first = [f"{key} {_brief(item)}" for key, item in islice(value.items(), MOST_NUMBERS)]
        return "; ".join([*first, *([f"... ({len(value)})"] if len(value) > MOST_NUMBERS else [])])
    if isinstance(value, list | tuple) and not all(isinstance(item, str | int | float) for item in value):
        return f"{len(value)} of {type(value[0]).__name__}"
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else repr(value).partition("\n")[0]


def _brief_array(array: npt.NDArray[Any]) -> str:
    if array.dtype.kind == "U":
        words, counts = np.unique(array, return_counts=True)
        return ", ".join(f"{count} {word or repr('')}" for word, count in zip(words, counts, strict=True))
    if array.size <= MOST_NUMBERS and array.ndim == 1:
        return shortened(array)
    finite = array[np.isfinite(array)]
    return f"{array.shape}" + (f" from {finite.min():.4g} to {finite.max():.4g}" if finite.size else "")


def html_table(title: str, rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table as HTML; everything in it is text."""

    def cells(texts: Sequence[str], tag: str) -> str:
        return "".join(f'<{tag} style="text-align: left">{html.escape(text)}</{tag}>' for text in texts)

    above = f"<thead><tr>{cells(head, 'th')}</tr></thead>" if head else ""
    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return f"<table><caption><b>{html.escape(title)}</b></caption>{above}<tbody>{body}</tbody></table>"
