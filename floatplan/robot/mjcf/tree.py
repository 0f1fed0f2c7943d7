"""The bodies of a compiled MJCF that are the robot, their names, and the refusal of all but a tree of rigid links."""

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import CompiledMjcf
from floatplan.robot.urdf.base import moves_freely


class MjcfTree:
    """The robot in a compiled MJCF: the one body of the world that moves, and all that it carries.

    Attributes
    ----------
    bodies : numbers of its bodies, the base first and parents before children
    joints : numbers of the joints of each body
    moving : numbers of the joints between the bodies
    warnings : about properties of the file that a flight has not

    Raises
    ------
    InputError
        No body of the world moves, or several do; or the robot is no tree of rigid links.
    """

    def __init__(self, model: CompiledMjcf) -> None:
        self.model = model
        roots = sorted(set(model.body_rootid[model.jnt_bodyid].tolist()))
        if len(roots) != 1:
            listed = f": {', '.join(self.body_names[body] for body in roots[:5])}" if roots else ""
            reason = f"{len(roots)} bodies of the world move, where one robot flies{listed}"
            raise InputError(reason, element="<worldbody>", advice="let one alone move, by a <freejoint/>")
        self.bodies: list[int] = np.flatnonzero(model.body_rootid == roots[0]).tolist()
        self.joints = {body: np.flatnonzero(model.jnt_bodyid == body).tolist() for body in self.bodies}
        self.moving: list[int] = [joint for body in self.bodies[1:] for joint in self.joints[body]]
        self._check_base()
        self._check_rigid()
        self.warnings = self._left_out()

    @cached_property
    def body_names(self) -> dict[int, str]:
        """Names of all bodies by their numbers, see :func:`body_names`."""
        return body_names(self.model)

    @cached_property
    def joint_names(self) -> dict[int, str]:
        """Names of all joints by their numbers, see :func:`joint_names`."""
        return joint_names(self.model)

    @property
    def gravity_direction(self) -> Array | None:
        """Unit vector (3,) along gravity, in the base's axes as in the file's picture; None where the file has none."""
        gravity = self.model.opt_gravity
        strength = float(np.linalg.norm(gravity))
        disabled = int(self.model.opt_disableflags) & self.model.constants["mjDSBL_GRAVITY"]
        if disabled or not 0.0 < strength < math.inf:
            return None
        rotation = pin.Quaternion(*self.model.body_quat[self.bodies[0]].tolist()).normalized().inverse()
        # from the 13th digit on it is rounding of the quaternion
        return read_only((rotation * (gravity / strength)).round(12) + 0.0)

    def slides(self, joint: int) -> bool:
        """Whether a joint slides; it rotates otherwise."""
        return bool(self.model.jnt_type[joint] == self.model.constants["mjJNT_SLIDE"])

    def _check_base(self) -> None:
        """Check that the base is free, by a free joint, by joints as free in a plane or in space, or by none at all."""
        kinds = self.model.constants
        base = self.joints[self.bodies[0]]
        of_type: dict[int, list[Array]] = {}
        for joint in base:
            of_type.setdefault(int(self.model.jnt_type[joint]), []).append(self.model.jnt_axis[joint])
        slides = of_type.get(kinds["mjJNT_SLIDE"], [])
        rotations = of_type.get(kinds["mjJNT_HINGE"], [])
        if len(of_type.get(kinds["mjJNT_BALL"], [])) == 1 and not rotations:
            rotations = list(np.eye(3))  # as freely as three hinges about these axes
        if base and kinds["mjJNT_FREE"] not in of_type and not moves_freely(slides, rotations):
            reason = (
                f"is held to the world by {', '.join(self.joint_names[joint] for joint in base)}, which do not let it "
                "move freely, in a plane or in space"
            )
            advice = (
                "let it have a <freejoint/>; or slide along two axes and turn about the third, or slide along three "
                "and turn about three, each about another than the one before it"
            )
            raise InputError(reason, element=f'body "{self.body_names[self.bodies[0]]}"', advice=advice)

    def _check_rigid(self) -> None:
        model = self.model
        constants = self.model.constants
        for joint in self.moving:
            if model.jnt_type[joint] == constants["mjJNT_BALL"]:
                reason = "is a ball joint, and only joints of one axis can be planned"
                advice = "write three hinges"
                raise InputError(reason, element=f'joint "{self.joint_names[joint]}"', advice=advice)
        for number in np.flatnonzero(model.eq_active0).tolist():
            reason = "is a constraint between bodies or joints, and a robot that is planned is a tree of joints"
            advice = "remove it; joints that follow others can be coupled to them: coupled ="
            raise InputError(reason, element=_called(model, "equality", number), advice=advice)
        pulled = model.actuator_trnid[model.actuator_trntype == constants["mjTRN_TENDON"], 0].tolist()
        for number in range(len(model.names["tendon"])):
            acts = number in pulled
            for key in ("limited", "actfrclimited", "stiffness", "damping", "frictionloss", "armature"):
                values = getattr(model, f"tendon_{key}", None)
                acts = acts or (values is not None and bool(np.any(values[number])))
            if acts:
                reason = "is a tendon that pulls, and only joints with a motor of their own can be planned"
                raise InputError(reason, element=_called(model, "tendon", number), advice="remove it")

    def _left_out(self) -> list[str]:
        """Warnings about properties of the file that planning ignores."""
        model = self.model
        base = self.bodies[0]
        base_name = self.body_names[base]
        springs = [self.joint_names[joint] for joint in self.moving if model.jnt_stiffness[joint]]
        losses = np.stack((model.dof_armature, model.dof_damping, model.dof_frictionloss))[:, model.dof_bodyid == base]
        others = [self.body_names[body] for body in range(1, len(model.body_rootid)) if model.body_rootid[body] != base]
        left_out = []
        if springs:
            left_out.append(f"the springs of {', '.join(springs)}")
        if losses.any():
            left_out.append(f"armature, damping and friction of {base_name}")
        if model.body_gravcomp[self.bodies].any():
            left_out.append("gravity compensation")
        if model.opt_density or model.opt_viscosity or model.opt_wind.any():
            left_out.append("the forces of a medium")
        if others:
            left_out.append(f"bodies of the world ({', '.join(others)})")
        warnings = []
        if not self.joints[base]:
            warnings.append(f"{base_name} is fixed to the world in the file; here it flies")
        if len(self.joints[base]) > 3:  # more than a base in a plane has
            names = ", ".join(self.joint_names[joint] for joint in self.joints[base])
            warnings.append(f"read as the free base: {names}, by which the file lets the robot float")
        if left_out:
            warnings.append(f"left out: {'; '.join(left_out)}")
        return warnings


def body_names(model: CompiledMjcf) -> dict[int, str]:
    """Return names of all bodies by their numbers; one without is called ``body`` and its number."""
    return _names(model, "body", lambda body: f"body{body}")


def joint_names(model: CompiledMjcf) -> dict[int, str]:
    """Return names of all joints by their numbers; one without is called after its body."""
    bodies = model.jnt_bodyid.tolist()
    of_bodies = body_names(model)
    return _names(model, "joint", lambda joint: f"{of_bodies[bodies[joint]]}_joint")


def _names(model: CompiledMjcf, kind: str, otherwise: Callable[[int], str]) -> dict[int, str]:
    names = dict(enumerate(model.names[kind]))
    taken = set(names.values())
    return {number: name or new_name(otherwise(number), taken) for number, name in names.items()}


def new_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and take it."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _called(model: CompiledMjcf, kind: str, number: int) -> str:
    name = model.names[kind][number]
    return f'{kind} "{name}"' if name else f"{kind} number {number + 1}"
