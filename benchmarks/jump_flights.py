"""A jump flown in MuJoCo with contact: its torques, and springs with dampers on its joints, late and noisy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from contact_model import STEP, Surroundings, contact_model

import floatplan as fp
from floatplan.simulation.mujoco_model import import_mujoco
from floatplan.stance.jump import Jump
from floatplan.stance.motion import BASE

FOOT = 0.022  # [m] radius of the feet
CONTROL = 4  # [-] steps of the simulation in one of the controller: 500 Hz
LATE = 2  # [-] steps of the controller by which measurements are late: 4 ms
STIFFNESS, DAMPING = 40.0, 1.0  # [N m/rad, N m s/rad]
HEAVIER = 0.05  # [-] of all masses, more or less
GRIP = (0.7, 1.0)  # [-] friction
NOISE = np.deg2rad(0.1)  # [rad] of angles, and ten times that, rad/s, of rates
AFTER = 1.0  # [s] that it stands at the end
TIPPED = 0.5  # [rad] of the base: no more is standing
LOW = 0.6  # [-] of its height where it began: no less is standing


@dataclass(frozen=True)
class Landing:
    """How a jump went.

    Attributes
    ----------
    stands : whether it does a second after its end
    touched : links other than feet that touched the ground
    turned : error of the base's orientation where the flight should end, rad
    """

    stands: bool
    touched: tuple[str, ...]
    turned: float


def fly(jump: Jump, seed: int, armature: float) -> Landing:
    """Fly a jump, perturbed as ``seed`` draws it, with an armature of all joints, kg m^2."""
    mujoco, robot, rng = import_mujoco(), jump.problem.robot, np.random.default_rng(seed)
    factor, friction = 1.0 + float(rng.uniform(-HEAVIER, HEAVIER)), float(rng.uniform(*GRIP))
    feet = dict.fromkeys((name for phase in jump.phases for name in phase.contacts), FOOT)
    first = jump.before[0]
    surroundings = Surroundings(friction, factor, armature, first.gravity)
    built = contact_model(robot, feet, first.place.imag - FOOT, surroundings)
    model, data = built.model, mujoco.MjData(built.model)
    times = np.arange(int((jump.duration + AFTER) / (CONTROL * STEP)) + 1) * CONTROL * STEP
    wanted, full = jump.at(np.minimum(times, jump.duration)), jump.q(np.minimum(times, jump.duration))
    limits = np.where(robot.model.effortLimit[BASE:] > 0, robot.model.effortLimit[BASE:], np.inf)
    data.qpos[:3], data.qpos[3:7] = full[0, :3], full[0, [6, 3, 4, 5]]
    data.qpos[built.positions] = wanted.positions[0, BASE:]
    mujoco.mj_forward(model, data)
    errors = np.zeros((2, LATE + 1, robot.model.nv - BASE))  # of places and rates, the latest last
    touched: set[int] = set()
    lands, turned = int(np.searchsorted(times, jump.after[0].span[0])), 0.0
    for row in range(len(times)):
        errors = np.roll(errors, -1, axis=1)
        errors[0, -1] = wanted.positions[row, BASE:] - data.qpos[built.positions]
        errors[1, -1] = wanted.velocities[row, BASE:] - data.qvel[built.velocities]
        errors[:, -1] += NOISE * np.array([[1.0], [10.0]]) * rng.normal(size=errors[:, -1].shape)
        torque = wanted.torques[row, BASE:] + STIFFNESS * errors[0, 0] + DAMPING * errors[1, 0]
        data.qfrc_applied[built.velocities] = np.clip(torque, -limits, limits)
        if row == lands:
            turned = 2 * float(np.arccos(min(abs(data.qpos[3:7] @ full[row, [6, 3, 4, 5]]), 1.0)))
        for _ in range(CONTROL):
            mujoco.mj_step(model, data)
            touched.update(data.contact.geom[: data.ncon].ravel().tolist())
    names = tuple(sorted(model.geom(each).name for each in touched - built.feet - {built.floor}))
    return Landing(_stands(robot, data.qpos, full[0]), names, turned)


def _stands(robot: fp.Robot, now: np.ndarray, first: np.ndarray) -> bool:
    """Whether the base is level, and not far lower than where the jump began."""
    up, (w, *axis) = np.asarray(robot.plane.vertical, dtype=np.float64), now[3:7]
    top = up + 2 * np.cross(axis, np.cross(axis, up) + w * up)
    return bool(top @ up > np.cos(TIPPED) and now[:3] @ up > LOW * (first[:3] @ up))
