"""Flights in the plane by the general path, which flights in space take: the reference for what the kernel does."""

from __future__ import annotations

import pytest

from floatplan.planning import attempt, planned
from floatplan.planning.transcription import exchange, program


def take_general_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plan without the kernel, but for quadratic programs and the order of starts."""
    monkeypatch.setattr(planned, "follow_together", lambda problem, search: None)
    monkeypatch.setattr(attempt, "follow_compiled", lambda *problem: None)
    for room in (program, exchange):
        monkeypatch.setattr(room, "watch_of", lambda *constraints: None)
