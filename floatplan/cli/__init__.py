"""The command line."""

from floatplan.cli.commands import app, main

__all__ = ["app", "main"]
