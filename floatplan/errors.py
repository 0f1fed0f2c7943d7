"""The exceptions that floatplan raises on purpose; the command line turns :class:`InputError` into exit code 2."""

from __future__ import annotations

from pathlib import Path


class FloatplanError(Exception):
    """Base of every exception that floatplan raises on purpose."""


class InputError(FloatplanError, ValueError):
    """Something that the user gave is wrong.

    Parameters
    ----------
    reason : str
        What is wrong, in one sentence without a full stop.
    source : path or str, optional
        The file (or argument) that holds the fault.
    element : str, optional
        The place in it: a link, a joint, a key such as ``flight.duration``.
    advice : str, optional
        What to do about it, in one sentence without a full stop.
    """

    def __init__(
        self,
        reason: str,
        *,
        source: str | Path | None = None,
        element: str | None = None,
        advice: str | None = None,
    ) -> None:
        self.reason = reason
        self.source = None if source is None else str(source)
        self.element = element
        self.advice = advice
        place = ": ".join(part for part in (self.source, element) if part)
        super().__init__(f"{place}: {reason}" if place else reason)

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message}; {self.advice}" if self.advice else message

    def within(self, source: str | Path | None = None, element: str | None = None) -> InputError:
        """Return the same error with its file, or the element around it, added."""
        inner = ".".join(part for part in (element, self.element) if part) or None
        return InputError(self.reason, source=source or self.source, element=inner, advice=self.advice)
