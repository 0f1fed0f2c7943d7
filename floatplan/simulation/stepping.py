"""One period of forward dynamics under torques that are held: for control loops, by Pinocchio or MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.robot import Robot
from floatplan.simulation.mujoco_model import import_mujoco, mujoco_model
from floatplan.simulation.reduced_model import ReducedModel

State: TypeAlias = tuple[Array, Array]  # positions, velocities (3 + m,)
Stepper: TypeAlias = Callable[[State, Array, float], State]  # state, torques (m,), s


def _stepper(acceleration: Callable[[Array, Array, Array], Array], size: int) -> Stepper:
    """The classical Runge-Kutta method with accelerations (3 + m,) from positions, velocities and forces."""
    forces = np.zeros(size)

    def step(state: State, torques: Array, duration: float) -> State:
        forces[BASE:] = torques
        q, v = state
        half = duration / 2
        a1 = acceleration(q, v, forces)
        v2 = v + half * a1
        a2 = acceleration(q + half * v, v2, forces)
        v3 = v + half * a2
        a3 = acceleration(q + half * v2, v3, forces)
        v4 = v + duration * a3
        a4 = acceleration(q + duration * v3, v4, forces)
        sixth = duration / 6
        return q + sixth * (v + 2 * (v2 + v3) + v4), v + sixth * (a1 + 2 * (a2 + a3) + a4)

    return step


def pinocchio_stepper(model: Any) -> Stepper:
    """Return a step by the articulated-body algorithm."""
    data = model.createData()
    return _stepper(lambda q, v, forces: pin.aba(model, data, q, v, forces).copy(), model.nv)


def mujoco_stepper(robot: Robot, reduced: ReducedModel, gravity: float, mass: Array, inertia: Array) -> Stepper:
    """Return a step by MuJoCo's accelerations, of a robot whose bodies have other masses and inertias.

    ``mass, inertia`` (njoints,) are factors of the links that each joint of the reduced model carries.
    """
    mujoco = import_mujoco()
    model, order = mujoco_model(robot, reduced, gravity, 1e-3)
    coordinates = np.array(order)
    joint_of = {int(coordinate): joint + 1 for joint, coordinate in enumerate(coordinates)}
    for body in range(1, model.nbody):
        carrier = int(model.body_weldid[body])
        if carrier:
            last = int(model.body_jntadr[carrier] + model.body_jntnum[carrier] - 1)
            joint = joint_of[int(model.jnt_qposadr[last])]
            model.body_mass[body] *= mass[joint]
            model.body_inertia[body] *= inertia[joint]
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)

    def acceleration(q: Array, v: Array, forces: Array) -> Array:
        data.qpos[coordinates], data.qvel[coordinates], data.qfrc_applied[coordinates] = q, v, forces
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[coordinates])

    return _stepper(acceleration, reduced.model.nv)
