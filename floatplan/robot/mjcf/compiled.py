"""MuJoCo's module, and an MJCF compiled by it."""

import re
import threading
import warnings
from types import ModuleType
from typing import Any
from xml.etree.ElementTree import tostring

from floatplan.errors import InputError, import_optional
from floatplan.robot.mjcf.text import MjcfText

ONE_AT_A_TIME = threading.Lock()  # MuJoCo waits for ever where two threads ask for its warnings at once
BALANCE = "have it balanced: balance_inertias = true under [robot], or --balance-inertias"
PLACES = re.compile(r",? line \d+(, column \d+)?|,? id \d+|Element name ''")  # in a text that nobody has seen


def import_mujoco(element: str = "engine", extra: str = "replay") -> ModuleType:
    """Return the module, which then writes no log of its warnings; InputError where it is not installed."""
    with ONE_AT_A_TIME:
        mujoco = import_optional("mujoco", name="MuJoCo", element=element, extra=extra)
        if mujoco.get_mju_user_warning() is None:  # else it writes MUJOCO_LOG.TXT where the user is
            mujoco.set_mju_user_warning(_ignore)
    return mujoco


def _ignore(_: str) -> None:
    """Take a warning: whether the robot lands as planned is what counts, and what it is made of is looked at."""


def compiled_mjcf(text: MjcfText) -> Any:
    """Return the ``mujoco.MjModel`` of an MJCF; InputError where MuJoCo is not installed or refuses it."""
    mujoco = import_mujoco("mjcf", "mjcf")
    try:
        with ONE_AT_A_TIME, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about what newer versions will no longer read
            spec = mujoco.MjSpec.from_string(tostring(text.root, encoding="unicode"), assets=dict(text.files))
            spec.compiler.fusestatic = False
            return spec.compile()
    except Exception as error:  # of several kinds, its own among them
        reason = " ".join(PLACES.sub("", str(error)).split())
        advice = BALANCE if "balanceinertia" in reason else None
        raise InputError(f"MuJoCo refuses it: {reason}", advice=advice) from None
