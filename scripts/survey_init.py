"""What ``floatplan init`` finds for robots: a line each, and how many of those that stand on feet jump.

    .venv/bin/python scripts/survey_init.py                    # all of example-robot-data; hours
    .venv/bin/python scripts/survey_init.py go2 talos          # those whose paths hold one of these words
    .venv/bin/python scripts/survey_init.py ../mine/robot.urdf --seconds 100

Robots are taken one after the other, each in a process that may take so many seconds of CPU. A line says what was found
(a turn, a jump, afloat, or nothing), how long that took, and why it is no more than that.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from floatplan.robot.urdf.tree import PREFIX, example_urdfs

SECONDS = 200  # of CPU, for each robot
LONGEST = 160  # [characters] of a reason
# what is found, by words of the first line of the file that is written
FOUND = {"flips": "turn", "turns over": "turn", "jumps": "jump", "afloat": "afloat"}
NO_FEET = "No feet were found"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", help="files, or words in the paths of robots of example-robot-data")
    parser.add_argument("--seconds", type=int, default=SECONDS, help="of CPU, for each robot")
    options = parser.parse_args()
    files = [word for word in options.robots if Path(word).exists()]
    words = [word for word in options.robots if word not in files]
    examples = [PREFIX + name for name in example_urdfs() if not options.robots or any(word in name for word in words)]
    standing = jumping = 0
    for robot in (*files, *examples):
        result, has_feet, seconds, reason = surveyed(robot, options.seconds)
        standing += has_feet
        jumping += result in ("turn", "jump")
        print(f"{result:<8}{seconds:>6.0f} s  {robot.removeprefix(PREFIX)}  {reason[:LONGEST]}", flush=True)
    print(f"{jumping} of {standing} robots that stand on feet jump.")


def surveyed(robot: str, most: int) -> tuple[str, bool, float, str]:
    """Return what is found for a robot, whether it stands on feet, the seconds that took, and why it is no more."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "floatplan", "init", robot, "-o", str(Path(folder) / "found.toml")]
        run = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
        )
    lines = run.stderr.splitlines()
    written = next((line for line in lines if "found.toml: " in line), "")
    result = next((name for word, name in FOUND.items() if word in written), "nothing")
    reasons = [line for line in lines if " was not found: " in line or "No " in line or line.startswith("error: ")]
    reason = " ".join(reasons) or ("it took too long" if run.returncode < 0 else "")
    has_feet = NO_FEET not in run.stderr and run.returncode != 2
    return result, has_feet, time.monotonic() - began, reason


if __name__ == "__main__":
    main()
