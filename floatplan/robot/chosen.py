"""A robot from a file of either kind, with the user's settings; errors name who chose them."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.robot.robot import Robot
from floatplan.tables import RobotKind


def chosen_robot(
    source: str | Path,
    choices: Mapping[str, Any],
    asker: str | Path | None,
    prefix: str,
    kind: RobotKind | None = None,
) -> Robot:
    """Return the robot of a file, with the settings of a problem file, a plan file or a command line.

    Parameters
    ----------
    source : path
    choices : keyword arguments of ``Robot.from_urdf``, None where left out
    asker, prefix : as of :func:`blamed`
    kind : of the file, where its name decides it

    Raises
    ------
    InputError
        As of ``Robot.from_urdf`` and ``Robot.from_mjcf``.
    """
    with blamed(choices, asker, prefix):
        return Robot.from_file(source, kind, **choices)


@contextmanager
def blamed(choices: Mapping[str, Any], asker: str | Path | None, prefix: str) -> Iterator[None]:
    """Let errors about choices, where one was made, name who made them.

    Parameters
    ----------
    choices : keyword arguments of ``Robot.from_urdf``, None where left out
    asker : who sets them, such as a problem file; it is the source of errors about them, the robot's file of all others
    prefix : of their names there, such as "robot."
    """
    try:
        yield
    except InputError as error:
        word = re.split(r"[.\[ ]", error.element or "")[0]
        if asker is None or word not in choices or all(value is None for value in choices.values()):
            raise
        raise InputError(error.reason, source=asker, element=f"{prefix}{error.element}", advice=error.advice) from None
