"""Python in a process of its own: in another folder with the package that is there, or as in a terminal."""

import os
import signal
import subprocess
import sys
from pathlib import Path


def told(code: str, folder: Path, **environment: str) -> str:
    """Return what some code prints there, with additions to the environment."""
    return subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
    ).stdout


def hear_ctrl_c() -> None:
    """Let a process that begins (``preexec_fn``) hear Ctrl-C, also where the tests run without, as under ``nohup``."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
