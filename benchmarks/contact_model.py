"""A robot on a free base in MuJoCo, with the ground: its links' hulls as prisms, its feet as spheres.

Every joint of the file moves, those that plans lock too. Links touch the ground alone, not one another. Bodies are the
URDF's; there is no damping.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import floatplan as fp
from floatplan.arrays import IntArray
from floatplan.simulation.mujoco_model import import_mujoco, inertial_spec
from floatplan.stance.motion import BASE, point_in_joint

WIDTH = 0.02  # [m] of the links' prisms
THIN = 1e-4  # [m] a hull that is thinner is no shape
STEP = 5e-4  # [s] of the simulation
STIFF = (4e-3, 1.0)  # [s, -] time constant and damping of contacts
SLIPLESS = 10.0  # [-] stiffness of friction over that of the normal force


@dataclass(frozen=True)
class Surroundings:
    """What a plan knows, and what it may be wrong about.

    Attributes
    ----------
    friction : of the ground
    mass : factor of all masses and inertias
    armature : kg m^2 of each joint
    gravity : m/s^2
    """

    friction: float
    mass: float = 1.0
    armature: float = 0.0
    gravity: float = 9.81


@dataclass(frozen=True, eq=False)
class ContactModel:
    """A model with contact.

    Attributes
    ----------
    model : mujoco.MjModel
        Its free joint comes first, in the axes of the file.
    positions, velocities : (m,) entries in ``qpos`` and ``qvel`` of all joints of ``robot.model`` but its base's
    floor : the ground's geom
    feet : the feet's geoms
    """

    model: Any
    positions: IntArray
    velocities: IntArray
    floor: int
    feet: frozenset[int]


def contact_model(
    robot: fp.Robot, feet: Mapping[str, float], ground: float, surroundings: Surroundings
) -> ContactModel:
    """Build the model.

    Parameters
    ----------
    feet : frames that stand, with the radii of spheres about their origins, m
    ground : its height, m
    """
    mujoco = import_mujoco()
    spec = inertial_spec(robot, robot.file_tree, {}, in_plane=False)
    up, kinds = np.asarray(robot.plane.vertical, dtype=np.float64), mujoco.mjtGeom
    spec.option.gravity = -surroundings.gravity * up
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, SLIPLESS
    for joint in spec.joints:
        joint.limited = joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    moving = range(BASE + 1, robot.model.njoints)
    carriers = {joint: spec.joint(f"joint{joint}").parent for joint in moving}
    carriers[BASE] = next(each for each in spec.joints if each.type == mujoco.mjtJoint.mjJNT_FREE).parent
    slide = [surroundings.friction, 0, 0]
    floor = {"name": "floor", "type": kinds.mjGEOM_PLANE, "size": [0, 0, 1], "pos": ground * up, "friction": slide}
    spec.worldbody.add_geom(**floor, zaxis=up, solref=STIFF, contype=1)
    touching = {"solref": STIFF, "contype": 0, "conaffinity": 1, "friction": [0, 0, 0]}
    for name, radius in feet.items():
        joint, place = point_in_joint(robot, name, robot.frames[name].local)
        carriers[joint].add_geom(name=name, type=kinds.mjGEOM_SPHERE, size=[radius, 0, 0], pos=place, **touching)
    standing = {robot.contact_link(robot.frames[name].link) for name in feet}
    for link in robot.link_hulls:
        prism = None if link in standing else _prism(robot, link)
        if prism is not None:
            spec.add_mesh(name=link, uservert=prism[1].ravel())
            carriers[prism[0]].add_geom(name=link, type=kinds.mjGEOM_MESH, meshname=link, **touching)
    model = spec.compile()
    joints = [model.joint(f"joint{joint}") for joint in moving]
    positions, velocities = (np.array([getattr(each, key)[0] for each in joints]) for key in ("qposadr", "dofadr"))
    model.body_mass[:] *= surroundings.mass
    model.body_inertia[:] *= surroundings.mass
    model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = 0, 0, 0
    model.dof_armature[velocities] = surroundings.armature
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return ContactModel(
        model,
        positions,
        velocities,
        model.geom("floor").id,
        frozenset(model.geom(name).id for name in feet),
    )


def _prism(robot: fp.Robot, link: str) -> tuple[int, np.ndarray] | None:
    """The joint that carries a link, and its prism (2 c, 3) m in the joint's axes; None of what is no shape."""
    corners = np.array([[each.start, each.end] for each in robot.link_hulls[link]]).ravel()
    centred = corners - corners.mean()
    if np.linalg.svd(np.stack((centred.real, centred.imag)), compute_uv=False)[-1] < THIN:
        return None
    found = [point_in_joint(robot, link, complex(corner)) for corner in corners]
    joint, data = found[0][0], robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.reference.copy())
    across = WIDTH / 2 * data.oMi[joint].rotation.T @ robot.plane.normal
    middle = np.array([place for _, place in found])
    return joint, np.concatenate((middle - across, middle + across))
