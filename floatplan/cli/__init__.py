"""The command line."""

from __future__ import annotations

import gc
import io
import sys

GARBAGE_THRESHOLD = 100_000  # [-] objects: what a command imports stays, and collecting it again takes time
INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while it is imported."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a name may have letters that the locale's encoding has not
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        from floatplan.cli.commands import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
