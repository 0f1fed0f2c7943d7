"""Flights in the plane by the general path, which flights in space take: the reference for what the kernel does."""

from __future__ import annotations

import pytest
from general_flight import general_flight

from floatplan.planning import planned
from floatplan.planning.transcription import trajectory


def take_general_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plan without the kernel, but for quadratic programs and the order of starts."""
    monkeypatch.setattr(planned, "is_plain", lambda problem: False)
    monkeypatch.setattr(trajectory, "flight_dynamics", general_flight)
