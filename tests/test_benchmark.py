"""The benchmark runs: every section, with as little to measure as there is."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from needed import skip_or_fail

if importlib.util.find_spec("casadi") is None:
    skip_or_fail("casadi is not installed: the extra bench")


@pytest.fixture(scope="module")
def benchmark(root: Path) -> Iterator[ModuleType]:
    """The benchmark, its peers cut short."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(root / "scripts")
        import peers
        import sections as benchmark

        patch.setattr(peers, "MOST_SECONDS", 0.5)
        yield benchmark


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ("speed", "SLSQP own ms"),
        ("quality", "25.0411"),
        ("starts", "worse with more starts"),
        ("free", "with h free: 0 of 1"),
        ("random", "of 1"),
        ("forward", "easy"),
        ("obstacle", "cut into the margin"),
        ("witness", "violated between instants: 0"),
        ("growth", "time grows as n^"),
        ("startup", "processor s"),
        ("many", "plans/s"),
    ],
)
def test_section_runs(section: str, expected: str, benchmark: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    tiny = benchmark.Counts(
        turns=1,
        slow_turns=1,
        generated=1,
        compared=1,
        many=3,
        witnesses=1,
        starts=2,
        repeated=1,
        free=1,
        scanned=21,
        subprocesses=1,
        instants=400,
        chains=(3,),
        long_chains=(3, 4),
    )
    benchmark.SECTIONS[section](tiny)
    assert expected in capsys.readouterr().out


def test_section_that_there_is_not(benchmark: ModuleType) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(["nonsense"])
