"""Spoiled files through every command: 10 cases each time, 100 with the long tests, any number by ``scripts/fuzz``."""

import pytest
from fuzz_runs import judge, run_clip, run_here, run_killed
from long_cases import cases

CASES, BATCH = 100, 10
EVERY_TIME = 10  # of them


@pytest.fixture(scope="module", autouse=True)
def plans(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FLOATPLAN_FUZZ_PLANS", str(tmp_path_factory.mktemp("plans")))
        yield


@pytest.mark.parametrize("first", cases(range(0, CASES, BATCH), range(EVERY_TIME, CASES)))
@pytest.mark.parametrize("run", [run_here, run_clip])
def test_every_promise_is_kept(run, first, tmp_path):
    broken = []
    for seed in range(first, first + BATCH):
        folder = tmp_path / str(seed)
        folder.mkdir()
        broken += run(seed, folder)
    assert not broken, "\n".join(map(str, broken))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_a_killed_command_leaves_no_half_of_a_file(seed, tmp_path):
    assert run_killed(seed, tmp_path) == []


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
