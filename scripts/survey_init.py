"""What ``floatplan init`` finds for robots: a line each, and how many of those that stand on legs jump.

    .venv/bin/python scripts/survey_init.py                    # all of example-robot-data; hours
    .venv/bin/python scripts/survey_init.py legs               # those of them that stand on legs; half an hour
    .venv/bin/python scripts/survey_init.py go2 talos          # those whose paths hold one of these words
    .venv/bin/python scripts/survey_init.py ../mine/robot.urdf --seconds 100

Robots are taken one after the other, each in a process that may take so many seconds of CPU. A line says what was
found (a turn, a jump, afloat, or nothing), how many seconds of CPU that took, and why it is no more. A robot that is
refused for inertias that no body can have is tried again with ``--balance-inertias``, which the refusal advises.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from floatplan.robot.urdf.tree import PREFIX, example_urdfs

SECONDS = 200  # of CPU, for each robot
LONGEST = 160  # [characters] of a reason
# what is found, by words of the first line of the file that is written
FOUND = {"flips": "turn", "turns over": "turn", "jumps": "jump", "afloat": "afloat"}
NO_FEET = "No feet were found"
BALANCED = "--balance-inertias"
# Robots of example-robot-data on legs, by their folders. Torsos of humanoids and arms stand on nothing of their own,
# though their hands or elbows may be what is lowest.
LEGGED = (
    *("a1", "alexander", "anymal_b_simple", "anymal_c_simple", "b1", "bolt", "centauro", "g1", "go1", "go2", "human"),
    *("hyq", "icub", "laikago", "quadruped", "romeo", "simple_humanoid", "solo", "talos"),
)
ARMS = ("talos_left_arm",)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", help="files, or words in the paths of robots of example-robot-data")
    parser.add_argument("--seconds", type=int, default=SECONDS, help="of CPU, for each robot")
    options = parser.parse_args()
    files = [word for word in options.robots if Path(word).exists()]
    words = [word for word in options.robots if word not in files]
    examples = [PREFIX + name for name in example_urdfs() if not options.robots or is_named(name, words)]
    standing = jumping = 0
    for robot in (*files, *examples):
        result, has_feet, seconds, reason = surveyed(robot, options.seconds)
        stands = on_legs(robot.removeprefix(PREFIX)) if robot in examples else has_feet
        standing += stands
        jumping += stands and result in ("turn", "jump")
        beside = "" if stands else "(no legs) "
        print(f"{result:<8}{seconds:>6.0f} s  {robot.removeprefix(PREFIX)}  {beside}{reason[:LONGEST]}", flush=True)
    print(f"{jumping} of {standing} robots that stand on legs jump.")


def is_named(name: str, words: list[str]) -> bool:
    """Whether a path of example-robot-data holds one of these words, of which "legs" is all robots on legs."""
    return any(word in name or (word == "legs" and on_legs(name)) for word in words)


def on_legs(name: str) -> bool:
    """Whether a path of example-robot-data is that of a robot that stands on legs."""
    folder = name.split("/")[0].removesuffix("_description").removesuffix("_data")
    return folder in LEGGED and not any(arm in name for arm in ARMS)


def surveyed(robot: str, most: int, *more: str) -> tuple[str, bool, float, str]:
    """Return what is found for a robot, whether it stands on feet, the seconds that took, and why it is no more."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        output = str(Path(folder) / "found.toml")
        run = subprocess.run(
            [sys.executable, "-m", "floatplan", "init", robot, *more, "-o", output],
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
        )
    if BALANCED in run.stderr and run.returncode and BALANCED not in more:
        return surveyed(robot, most, BALANCED)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = run.stderr.splitlines()
    written = next((line for line in lines if "found.toml: " in line), "")
    result = next((name for word, name in FOUND.items() if word in written), "nothing")
    told = ("error: ", "warning: ")
    reasons = [*more, *(line for line in lines if " was not found: " in line or "No " in line or line.startswith(told))]
    reason = " ".join(reasons) or ("it took too long" if run.returncode < 0 else "")
    has_feet = NO_FEET not in run.stderr and run.returncode != 2
    return result, has_feet, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, reason


if __name__ == "__main__":
    main()
