"""The command line."""

from __future__ import annotations

import sys

INTERRUPTED = 130  # exit code where Ctrl-C ended it, as shells have it


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while it is imported."""
    try:
        from floatplan.cli.commands import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
