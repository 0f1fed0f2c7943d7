"""Many plans in one process: memory, caches, threads and forks. ``scripts/fuzz --load`` makes 1000 plans of it."""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.long

PLANS, ROBOTS = 80, 200
MOST_GROWTH = 2.0  # [MB]
LARGEST_CACHE = 64  # robots


@pytest.fixture(scope="module")
def load(root):
    """What is measured in a process of its own: no other test has filled its memory."""
    if not sys.platform.startswith("linux"):
        pytest.skip("memory is read from /proc")
    command = [sys.executable, root / "tests" / "helpers" / "load.py", str(PLANS), str(ROBOTS)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    run = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_plans_leave_little_in_memory(load):
    assert load["MB grown"] < MOST_GROWTH


def test_old_robots_are_forgotten(load):
    assert load["robots kept"] <= LARGEST_CACHE


def test_a_fork_after_threads_answers_the_same(load):
    assert load["fork agrees"] is True
