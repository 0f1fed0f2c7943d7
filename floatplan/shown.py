"""How results show themselves: short text for a prompt, tables for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

MOST_NUMBERS = 8  # [-] of a list in a line


def shortened(values: Iterable[float]) -> str:
    """Numbers in a line, so many at most."""
    numbers = [f"{float(value) + 0.0:.4g}" for value in values]
    more = len(numbers) - MOST_NUMBERS
    return ", ".join(numbers if more <= 0 else [*numbers[:MOST_NUMBERS], f"... ({more} more)"])


def html_table(title: str, rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table as HTML; everything in it is text."""

    def cells(texts: Sequence[str], tag: str) -> str:
        return "".join(f'<{tag} style="text-align: left">{html.escape(text)}</{tag}>' for text in texts)

    above = f"<thead><tr>{cells(head, 'th')}</tr></thead>" if head else ""
    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return f"<table><caption><b>{html.escape(title)}</b></caption>{above}<tbody>{body}</tbody></table>"
