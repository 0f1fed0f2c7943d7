"""Flights in the plane by the general path, which flights in space take: the reference for what the kernel does."""

from __future__ import annotations

import pytest

from floatplan.planning import attempt, planned
from floatplan.planning.transcription import exchange, program


def take_general_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plan without the kernel, but for quadratic programs and the order of starts."""
    monkeypatch.setattr(planned, "follow_together", lambda problem, search: None)
    monkeypatch.setattr(attempt, "compiled_solution", lambda *problem: None)
    monkeypatch.setattr(program, "compiled_rows", lambda *rows: None)
    monkeypatch.setattr(exchange, "watch_of", lambda *constraints: None)
