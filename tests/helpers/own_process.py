"""The command line in a process of its own, with streams, environment and constants of a test's choice."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from elsewhere import hear_ctrl_c

CODE = """
import importlib, json, sys
from floatplan.cli import main
for place, value in json.loads(sys.argv.pop(1)).items():
    module, _, name = place.rpartition(".")
    setattr(importlib.import_module(module), name, value)
main()
"""


def started(
    *arguments: str | Path,
    stdout: int,
    stderr: int,
    cwd: Path | None = None,
    environment: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
) -> subprocess.Popen[bytes]:
    """Begin a command as the leader of a group of processes; constants are of the package, by module and name."""
    return subprocess.Popen(
        [sys.executable, "-c", CODE, json.dumps(dict(constants or {})), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
        cwd=cwd,
        env=environment,
        start_new_session=True,
        preexec_fn=hear_ctrl_c,
    )
