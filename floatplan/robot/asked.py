"""A robot as a problem file, a plan file or a command line asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.robot.robot import Robot


def robot_as_asked(urdf: str | Path, choices: Mapping[str, Any], asker: str | Path | None, prefix: str) -> Robot:
    """Return the robot of a URDF.

    Parameters
    ----------
    urdf : path
    choices : keyword arguments of ``Robot.from_urdf``, None where left out
    asker : who gives them, such as a problem file; it has the blame for them, the URDF that for all else
    prefix : of their names there, such as "robot."

    Raises
    ------
    InputError
        As of ``Robot.from_urdf``.
    """
    try:
        return Robot.from_urdf(urdf, **choices)
    except InputError as error:
        word = (error.element or "").split(" ")[0]
        if asker is None or word not in choices or all(value is None for value in choices.values()):
            raise
        raise InputError(error.reason, source=asker, element=f"{prefix}{error.element}", advice=error.advice) from None
