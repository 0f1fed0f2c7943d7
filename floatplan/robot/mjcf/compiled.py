"""MuJoCo's module, and an MJCF compiled by it in another process."""

import hashlib
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError, import_optional, install_advice
from floatplan.robot.mjcf.process import compiler_response
from floatplan.robot.mjcf.text import MjcfText

ONE_AT_A_TIME = threading.Lock()  # MuJoCo waits for ever where two threads ask for its warnings at once
ARRAYS = (  # of an MjModel, as far as its version has them
    *("body_rootid", "body_parentid", "body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "body_iquat"),
    *("body_gravcomp", "dof_bodyid", "dof_armature", "dof_damping", "dof_frictionloss", "eq_active0"),
    *("geom_bodyid", "geom_type", "geom_size", "geom_pos", "geom_quat", "geom_dataid", "geom_contype"),
    *("geom_conaffinity", "pair_geom1", "pair_geom2", "mesh_pos", "mesh_quat", "mesh_scale", "qpos0", "key_qpos"),
    *("jnt_type", "jnt_bodyid", "jnt_qposadr", "jnt_dofadr", "jnt_axis", "jnt_pos", "jnt_limited", "jnt_range"),
    *("jnt_actfrclimited", "jnt_actfrcrange", "jnt_stiffness", "qpos_spring"),
    *("actuator_trntype", "actuator_trnid", "actuator_gear", "actuator_dyntype", "actuator_gaintype"),
    *("actuator_gainprm", "actuator_biastype", "actuator_biasprm", "actuator_ctrllimited", "actuator_ctrlrange"),
    *("actuator_forcelimited", "actuator_forcerange", "actuator_armature", "actuator_damping"),
    *("tendon_limited", "tendon_actfrclimited", "tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
    *("tendon_armature", "opt.gravity", "opt.density", "opt.viscosity", "opt.wind", "opt.disableflags"),
)


@dataclass(frozen=True, eq=False)
class CompiledMjcf:
    """The data of an MJCF that MuJoCo has compiled.

    Attributes
    ----------
    arrays : those of an MjModel by their names, such as ``body_mass``; attributes of this, too
    names : of elements by their kind, such as ``joint``, in the order of the arrays; empty where one has none
    constants : MuJoCo's, such as ``mjJNT_FREE``
    """

    arrays: Mapping[str, Array]
    names: Mapping[str, tuple[str, ...]]
    constants: Mapping[str, int]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"this version of MuJoCo has no {name}") from None

    def constant(self, number: int, prefix: str) -> str:
        """Name of the constant that begins so and has this number."""
        for name, value in self.constants.items():
            if name.startswith(prefix) and value == number:
                return name
        return ""


def import_mujoco(element: str = "engine", extra: str = "replay") -> ModuleType:
    """Return the module, which then writes no log of its warnings.

    Raises
    ------
    InputError
        It is not installed, or in a version that computes wrong accelerations.
    """
    with ONE_AT_A_TIME:
        mujoco = import_optional("mujoco", name="MuJoCo", element=element, extra=extra)
        # 4.0.0's Newton solver factors a sparse Hessian wrongly:
        # https://github.com/google-deepmind/mujoco/releases/tag/4.0.1
        if mujoco.__version__ == "4.0.0":
            reason = f"MuJoCo {mujoco.__version__} computes wrong accelerations under contacts"
            raise InputError(reason, element=element, advice=install_advice(extra))
        if mujoco.get_mju_user_warning() is None:  # else it writes MUJOCO_LOG.TXT where the user is
            mujoco.set_mju_user_warning(_ignore)
    return mujoco


def _ignore(_: str) -> None:
    """Ignore a warning: the landing counts, and the robot's data are checked by themselves."""


def compiled_mjcf(text: MjcfText) -> CompiledMjcf:
    """Return an MJCF as MuJoCo compiles it.

    Raises
    ------
    InputError
        MuJoCo is not installed or refuses it, or needs more time or memory than any robot takes.
    """
    if find_spec("mujoco") is None:
        raise _missing()
    xml = tostring(text.root, encoding="utf-8")
    contents = _Contents(xml, text.files)
    return _compiled(contents)


class _Contents:
    """An MJCF and its files, equal where their digests are."""

    def __init__(self, xml: bytes, files: Mapping[str, bytes]) -> None:
        self.xml = xml
        self.files = files
        digest = hashlib.sha256(xml)
        for name, content in sorted(files.items()):
            digest.update(f"\0{name}\0{len(content)}\0".encode())
            digest.update(content)
        self.digest = digest.digest()

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Contents) and other.digest == self.digest


@lru_cache(maxsize=16)  # files; a command reads few, and some of them many times
def _compiled(contents: _Contents) -> CompiledMjcf:
    # of the enumerations all members, of the arrays those that this version of MuJoCo has
    enumerations = ("mjtJoint", "mjtGeom", "mjtTrn", "mjtDyn", "mjtGain", "mjtBias", "mjtDisableBit")
    response = compiler_response({"arrays": ARRAYS, "constants": enumerations}, contents.xml, contents.files)
    if "missing" in response:
        raise _missing()
    if "error" in response:
        # lines and numbers are of the text that MuJoCo got, which nobody has seen
        where = r",? line \d+(, column \d+)?|,? id \d+|Element name ''"
        reason = " ".join(re.sub(where, "", response["error"]).split())
        advice = None
        if "balanceinertia" in reason:
            advice = "have it balanced: balance_inertias = true under [robot], or --balance-inertias"
        raise InputError(f"MuJoCo refuses it: {reason}", advice=advice)
    arrays = {}
    for name, written in response["arrays"].items():
        array = np.array(written["values"], dtype=written["dtype"]).reshape(written["shape"])
        array.flags.writeable = False
        arrays[name.replace(".", "_")] = array
    names = {kind: tuple(of_kind) for kind, of_kind in response["names"].items()}
    return CompiledMjcf(arrays, names, response["constants"])


def _missing() -> InputError:
    reason = 'MuJoCo is not installed: it comes with the extra "mjcf"'
    return InputError(reason, element="mjcf", advice=install_advice("mjcf"))
