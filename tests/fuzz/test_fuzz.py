"""Spoiled files through every command: 25 cases each time, 200 with the long tests, any number by ``scripts/fuzz``."""

from __future__ import annotations

import pytest
from fuzz_cases import WEIGHTS, Case
from fuzz_runs import judge, run_here, run_killed
from fuzz_sources import has_gallery
from long_cases import cases
from needed import skip_or_fail

CASES, BATCH = 200, 25
EVERY_TIME = 25  # of them


@pytest.fixture(scope="module", autouse=True)
def plans(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FLOATPLAN_FUZZ_PLANS", str(tmp_path_factory.mktemp("plans")))
        yield


@pytest.mark.parametrize("first", cases(range(0, CASES, BATCH), range(EVERY_TIME, CASES)))
def test_every_promise_is_kept(first, tmp_path):
    broken = []
    for seed in range(first, first + BATCH):
        folder = tmp_path / str(seed)
        folder.mkdir()
        broken += run_here(seed, folder)
    assert not broken, "\n".join(map(str, broken))


@pytest.mark.parametrize("seed", cases(range(8), range(2, 8)))
def test_a_killed_command_leaves_no_half_of_a_file(seed, tmp_path):
    assert run_killed(seed, tmp_path) == []


def test_every_kind_of_case_is_met():
    if not has_gallery():
        skip_or_fail("example-robot-data is not installed")
    assert {Case(seed).kind for seed in range(CASES)} == set(WEIGHTS)


@pytest.mark.parametrize("kind", WEIGHTS)
def test_a_case_is_its_seed(tmp_path, kind):
    seed = next(seed for seed in range(CASES) if Case(seed).kind == kind)
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
    first, second = ([word.replace(str(f), "") for word in Case(seed).prepare(f)] for f in folders)
    assert first == second


@pytest.mark.parametrize(
    ("code", "errors", "seconds", "broken"),
    [
        (0, "", 0.1, []),
        (2, "error: wrong", 0.1, []),
        (3, "", 0.1, ["exit code 3"]),
        (1, "Traceback (most recent call last)", 0.1, ["traceback"]),
        (0, "RuntimeWarning: overflow", 0.1, ["warning"]),
        (2, "x" * 3000, 0.1, ["message of 3000 characters"]),
        (2, "error: there is not enough memory for this", 0.1, ["more memory than it may have"]),
        (2, "", 0.1, ["exit code 2 without a message"]),
        (0, "\x1b[31m", 0.1, ["control characters"]),
        (0, "", 99.0, ["99.0 s of CPU"]),
    ],
)
def test_a_broken_promise_is_seen(code, errors, seconds, broken):
    assert [finding.broken for finding in judge(0, ["plan"], code, "", errors, seconds)] == broken
