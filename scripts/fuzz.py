"""Runs floatplan on spoiled input: ``scripts/fuzz N [--first SEED] [--clips | --processes | --kills | --load]``.

Each of the N cases is a problem, URDF, mesh or plan file spoiled by its seed and met by a command, or a command line
with strange options. In process they run in batches, so that a crash is seen and costs one case; ``--processes``
starts the command line anew for each; ``--jobs J`` run at once. ``--clips`` spoils recorded motions instead, in all of
their formats, and judges or repairs them.
``--kills`` kills sound commands at random moments instead, and looks at the files that they leave. ``--load`` makes
1000 plans in one process, and tells what it grew by.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))

import fuzz_runs  # noqa: E402
import fuzz_sources  # noqa: E402
import load  # noqa: E402

BATCH = 50  # cases in one process
PATIENCE = float(fuzz_runs.WAITING)  # s for one case
SLOW = 60.0  # s for each of many
PLANS, ROBOTS = 1000, 200  # of --load
MOST_GROWTH = 5.0  # MB


MODES = {
    "here": fuzz_runs.run_here,
    "clips": fuzz_runs.run_clip,
    "processes": fuzz_runs.run_process,
    "kills": fuzz_runs.run_killed,
}


def worker(seeds: range, mode: str) -> None:
    """Run cases and print what they break, a line of JSON each; a line before each says which comes next."""
    run = MODES[mode]
    if mode in ("here", "clips"):
        resource.setrlimit(resource.RLIMIT_DATA, (fuzz_runs.LARGEST, fuzz_runs.LARGEST))
    out = sys.stdout
    for seed in seeds:
        print(json.dumps({"next": seed}), file=out, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            for finding in run(seed, Path(folder)):
                print(json.dumps({"broken": finding.broken, "text": str(finding)}), file=out, flush=True)


def batch(seeds: range, mode: str) -> Iterator[str]:
    """What a batch breaks, crashes and hangs of its process included."""
    while seeds:
        command = [sys.executable, __file__, "--worker", str(seeds.start), str(seeds.stop), "--mode", mode]
        last = seeds.start
        ended = "a crash"
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                output, errors = process.communicate(timeout=PATIENCE + SLOW * len(seeds))
            except subprocess.TimeoutExpired:
                process.kill()
                output, errors = process.communicate()
                ended = "a hang"
        for line in output.decode("utf-8", "replace").splitlines():
            content = json.loads(line)
            last = content.get("next", last)
            if "text" in content:
                yield content["text"]
        if process.returncode == 0:
            return
        yield f"seed {last}: {ended} ({process.returncode})\n  {errors.decode('utf-8', 'replace')[-1500:]}"
        seeds = range(last + 1, seeds.stop)


def main() -> None:
    """Run and report; exit code 1 where anything broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=int, nargs="?", default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", dest="mode", action="store_const", const="processes", default="here")
    parser.add_argument("--clips", dest="mode", action="store_const", const="clips")
    parser.add_argument("--kills", dest="mode", action="store_const", const="kills")
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--mode", choices=MODES, help=argparse.SUPPRESS)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        worker(range(*options.worker), options.mode)
        return
    if options.load:
        found = load.measured(PLANS, ROBOTS)
        print(json.dumps(found))
        raise SystemExit(0 if found["MB grown"] < MOST_GROWTH and found["fork agrees"] else 1)
    fuzz_sources.prepare()
    last = options.first + options.cases
    batches = [range(first, min(first + BATCH, last)) for first in range(options.first, last, BATCH)]
    broken = 0
    with ThreadPoolExecutor(options.jobs) as pool:
        for texts in pool.map(lambda seeds: list(batch(seeds, options.mode)), batches):
            for text in texts:
                broken += 1
                print(text, flush=True)
    print(f"{options.cases} cases, {broken} promises broken")
    raise SystemExit(1 if broken else 0)


if __name__ == "__main__":
    main()
