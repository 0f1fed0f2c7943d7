"""Which bodies of a compiled MJCF are the robot, what they are called, and what of them is no tree of rigid links."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import import_mujoco

SKEW = 1e-9  # [-] between axes of unit length that are at right angles but for rounding
DIGITS = 12  # of a unit vector; the rest is rounding of the quaternion that turned it
LOSSES = ("dof_armature", "dof_damping", "dof_frictionloss")
TENDON_ACTS = ("limited", "actfrclimited", "stiffness", "damping", "frictionloss", "armature")  # where one is not zero


class MjcfTree:
    """The robot in a ``mujoco.MjModel``: the one body of the world that moves, and what it carries.

    Attributes
    ----------
    bodies : numbers of its bodies, the base first and parents before children
    joints : numbers of the joints of each body
    moving : numbers of the joints between the bodies
    warnings : what the file has and a flight has not

    Raises
    ------
    InputError
        No body of the world moves, or several do; or the robot has what a tree of rigid links has not.
    """

    def __init__(self, model: Any) -> None:
        self.model = model
        moved = sorted(set(model.body_rootid[model.jnt_bodyid].tolist()))
        if len(moved) != 1:
            listed = f": {', '.join(self.body_names[body] for body in moved[:5])}" if moved else ""
            reason = f"{len(moved)} bodies of the world move, where one robot flies{listed}"
            raise InputError(reason, element="<worldbody>", advice="let one alone move, by a <freejoint/>")
        self.bodies: list[int] = np.flatnonzero(model.body_rootid == moved[0]).tolist()
        self.joints = {body: np.flatnonzero(model.jnt_bodyid == body).tolist() for body in self.bodies}
        self.moving: list[int] = [joint for body in self.bodies[1:] for joint in self.joints[body]]
        self._check_base()
        self._check_rigid()
        self.warnings = self._left_out()

    @cached_property
    def body_names(self) -> dict[int, str]:
        """Names of all bodies by their numbers; one without is called ``body`` and its number."""
        return self._names("body", self.model.nbody, lambda body: f"body{body}")

    @cached_property
    def joint_names(self) -> dict[int, str]:
        """Names of all joints by their numbers; one without is called after its body."""
        bodies = self.model.jnt_bodyid.tolist()
        return self._names("joint", self.model.njnt, lambda joint: f"{self.body_names[bodies[joint]]}_joint")

    @property
    def gravity_direction(self) -> Array | None:
        """Unit vector (3,) along gravity, in the base's axes as the file draws it; None where the file has none."""
        gravity = np.array(self.model.opt.gravity)
        strength = float(np.linalg.norm(gravity))
        if not 0.0 < strength < math.inf:
            return None
        turned = pin.Quaternion(*self.model.body_quat[self.bodies[0]].tolist()).normalized().inverse()
        return read_only((turned * (gravity / strength)).round(DIGITS) + 0.0)

    def slides(self, joint: int) -> bool:
        """Whether a joint slides; it turns otherwise."""
        return bool(self.model.jnt_type[joint] == import_mujoco().mjtJoint.mjJNT_SLIDE)

    def _names(self, kind: str, count: int, otherwise: Callable[[int], str]) -> dict[int, str]:
        given = {number: str(getattr(self.model, kind)(number).name) for number in range(count)}
        taken = set(given.values())
        return {number: name or new_name(otherwise(number), taken) for number, name in given.items()}

    def _check_base(self) -> None:
        """The base is free, or slides along two axes and turns about a third, or nothing at all holds it."""
        kinds, base = import_mujoco().mjtJoint, self.joints[self.bodies[0]]
        types = self.model.jnt_type[base].tolist()
        axes = self.model.jnt_axis[base][np.argsort(types, kind="stable")]  # those that slide first
        in_plane = sorted(types) == [kinds.mjJNT_SLIDE, kinds.mjJNT_SLIDE, kinds.mjJNT_HINGE]
        if in_plane:
            in_plane = bool(np.linalg.norm(np.cross(*axes[:2])) > SKEW and abs(axes[:2] @ axes[2]).max() < SKEW)
        if base and types != [kinds.mjJNT_FREE] and not in_plane:
            reason = f"is held to the world by {', '.join(self.joint_names[joint] for joint in base)}, and cannot fly"
            advice = "let it have a <freejoint/>, or slide along two axes and turn about the third"
            raise InputError(reason, element=f'body "{self.body_names[self.bodies[0]]}"', advice=advice)

    def _check_rigid(self) -> None:
        mujoco, model = import_mujoco(), self.model
        for joint in self.moving:
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
                reason, advice = "is a ball joint, and only joints of one axis can be planned", "write three hinges"
                raise InputError(reason, element=f'joint "{self.joint_names[joint]}"', advice=advice)
        for number in np.flatnonzero(model.eq_active0).tolist():
            reason = "is a constraint between bodies or joints, and a robot that is planned is a tree of joints"
            advice = "remove it; joints that follow others can be coupled to them: coupled ="
            raise InputError(reason, element=_called("equality", model.equality(number), number), advice=advice)
        pulled = model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0].tolist()
        acting = [getattr(model, f"tendon_{key}", np.zeros((model.ntendon, 1))) for key in TENDON_ACTS]
        for number in range(model.ntendon):
            if number in pulled or any(np.any(values[number]) for values in acting):
                reason = "is a tendon that pulls, and only joints with a motor of their own can be planned"
                raise InputError(reason, element=_called("tendon", model.tendon(number), number), advice="remove it")

    def _left_out(self) -> list[str]:
        """Warnings about what is in the file and not planned with."""
        model, option, base = self.model, self.model.opt, self.bodies[0]
        springs = [self.joint_names[joint] for joint in self.moving if model.jnt_stiffness[joint]]
        losses = np.stack([getattr(model, key) for key in LOSSES])[:, model.dof_bodyid == base]
        others = [self.body_names[body] for body in range(1, model.nbody) if model.body_rootid[body] != base]
        there = {
            f"the springs of {', '.join(springs)}": bool(springs),
            f"armature, damping and friction of {self.body_names[base]}": losses.any(),
            "gravity compensation": model.body_gravcomp[self.bodies].any(),
            "the forces of a medium": option.density or option.viscosity or option.wind.any(),
            f"bodies of the world ({', '.join(others)})": bool(others),
        }
        left_out = [what for what, present in there.items() if present]
        held = (
            [] if self.joints[base] else [f"{self.body_names[base]} is fixed to the world in the file; here it flies"]
        )
        return [*held, *([f"left out: {'; '.join(left_out)}"] if left_out else [])]


def new_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and take it."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _called(kind: str, view: Any, number: int) -> str:
    return f'{kind} "{view.name}"' if view.name else f"{kind} number {number + 1}"
