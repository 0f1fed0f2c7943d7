"""Python in another folder, with the package that is there."""

from __future__ import annotations

import os
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
