"""Plans and proves the flight phase of robots that have left the ground.

In flight no external torque acts: the angular momentum about the centre of mass is constant, and the base turns as the
joints rotate it. floatplan finds joint motions that bring joints *and* base to a goal in a given time.

Units
-----
SI and radians, everywhere in Python and in every file that the program writes.

Frames
------
plane
    A horizontal axis, a vertical axis (up) and a normal. The letters of its name are the first two: "xz" is +x, +z.
    The normal is the axis that the planned joints share.
world
    Origin where the takeoff frame is at t = 0. Places are (horizontal, vertical).
orientation
    Absolute angle of the base link about the normal, unbounded: 2 pi more is one somersault more. The absolute angle
    of a link is the orientation plus the joint angles on the path to it, with the sign of each joint's axis.

Symbols
-------
====================  ==========================================================================================
n                     planned joints; bodies 0 to n for a chain
theta_0               ``orientation``, rad
q, q', q''            ``positions``, ``velocities``, ``accelerations`` (n,): rad, rad/s, rad/s^2
h                     ``angular_momentum`` about the centre of mass and the normal, kg m^2/s
D = (D_0 .. D_n)      inertia row of (4): ``D_0 theta_0' + sum_i D_i q_i' = h``, kg m^2
T                     ``duration`` of the flight, s; s = t/T
p_i(t), b, k_i        ``q_i = centre_i + amplitude_i sin(p_i(t))``, (12); its ``coefficients``; its degree
tau                   ``torques`` (n,), N m
r                     ``com_position`` (2,), m; ``com_velocity`` (2,), m/s
====================  ==========================================================================================

Numbers in parentheses are the equations of the paper whose method this is: see the README.

Public names are listed only in ``__init__.pyi``.
"""

import re
from importlib import import_module
from pathlib import Path

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOMES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+)", _STUB, re.MULTILINE)}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> object:
    """Import public names when they are first used: Pinocchio takes longer than ``floatplan --help`` may."""
    if name == "__version__":
        value = import_module("importlib.metadata").version("floatplan")
    elif _HOMES.get(name) == __name__:
        value = import_module(f"{__name__}.{name}")
    elif name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
