"""The command line."""

from __future__ import annotations

import gc
import io
import sys
from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ends."""

    DONE = 0
    FAILED = 1
    BAD_INPUT = 2
    INTERRUPTED = 130  # after Ctrl-C, as shells have it


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while it is imported."""
    gc.set_threshold(100_000)  # objects: what a command imports stays, and collecting it again takes time
    if isinstance(sys.stdout, io.TextIOWrapper):  # a name may have letters that the locale's encoding has not
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        from floatplan.cli.commands import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(ExitCode.INTERRUPTED)
