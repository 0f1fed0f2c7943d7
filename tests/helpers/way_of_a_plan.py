"""Which functions of the package a plan calls: ``python way_of_a_plan.py FILE..`` prints {file: [functions, files]}.

Each problem is planned by a process of its own, forked after the imports: nothing is cached that another one computed.
"""

import json
import os
import sys
from pathlib import Path
from types import FrameType

import floatplan as fp
import floatplan.planning.in_space  # the planner imports it on first need

PACKAGE = str(Path(fp.__file__).parent)
PLAN = fp.plan  # imports the planner


def way(name: str) -> tuple[int, int]:
    """Functions that planning the problem calls, and the files that they stand in; comprehensions are none."""
    problem = fp.load_problem(name)
    called = set()

    def profile(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and not code.co_name.startswith("<"):
            called.add((code.co_filename, code.co_name, code.co_firstlineno))

    sys.setprofile(profile)
    plan = PLAN(problem)
    sys.setprofile(None)
    assert plan.status == "optimal", name
    return len(called), len({file for file, _, _ in called})


def forked(name: str) -> int:
    """The end of a pipe on which a process of its own writes the way."""
    reading, writing = os.pipe()
    if os.fork() == 0:
        os.write(writing, json.dumps(way(name)).encode())
        os._exit(0)
    os.close(writing)
    return reading


if __name__ == "__main__":
    pipes = {name: forked(name) for name in sys.argv[1:]}
    print(json.dumps({name: json.loads(os.read(pipe, 100)) for name, pipe in pipes.items()}))
