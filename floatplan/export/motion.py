"""Motions for exporters: a plan or a whole jump, at the instants of a file, and the gains of a controller."""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.export.model_names import ModelNames, own_names
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.flight import FullMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import MotionSample, Trajectory, phase_of, sampled
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.robot import Robot
from floatplan.simulation.gains import BANDWIDTH, Gain, gains_of_jump, joint_inertia, requested_gains


@dataclass(frozen=True, eq=False)
class Exported:
    """A motion for exporters, of whatever kind.

    Attributes
    ----------
    motion : Trajectory
    gains : (2, J), optional
        Stiffness and damping, N m/rad and N m s/rad, of all joints that move.
    model : ModelNames, optional
        Of the model of the reading program.
    """

    motion: Trajectory
    gains: Array | None = None
    model: ModelNames | None = None

    @property
    def robot(self) -> Robot:
        """The robot that moves."""
        return self.motion.problem.robot

    @property
    def duration(self) -> float:
        """Of the motion, s."""
        return self.motion.duration

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the J joints that move, in Pinocchio's order."""
        return self.robot.model_joints

    @property
    def names(self) -> ModelNames:
        """Joints and bodies in the order of the model of the reading program, or else of the robot's own file."""
        return own_names(self.robot) if self.model is None else self.model

    @cached_property
    def gravity(self) -> Array:
        """The acceleration of gravity (3,), m/s^2, in the world."""
        return np.asarray(-self.motion.problem.flight.gravity * self.robot.up)

    @property
    def about(self) -> dict[str, str]:
        """Properties of the whole motion, by name; ``phases`` as JSON, if there are any."""
        motion = self.motion
        about = {"problem": motion.problem.name, "robot": self.robot.name, "duration": repr(motion.duration)}
        if isinstance(motion, Plan):
            momenta = np.atleast_1d(motion.angular_momentum).tolist()
            about["angular_momentum"] = " ".join(map(repr, momenta))
        about["gravity"] = " ".join(repr(float(value) + 0.0) for value in self.gravity)
        if motion.phases:
            about["phases"] = json.dumps(list(map(vars, motion.phases)))
        return about

    def sample(self, times: Array) -> MotionSample:
        """Return the motion at times (N,), s, in Pinocchio's coordinates; InputError where they are no numbers."""
        sample = sampled(self.motion, times)
        self._check(sample.q, sample.v, sample.a, sample.tau)
        return sample

    def at(self, times: Array) -> FullMotion:
        """Return base and all joints at times (N,), s; errors as of :meth:`sample`."""
        motion = self.motion.full_motion(np.minimum(times, self.duration))
        self._check(motion.positions, motion.velocities, motion.accelerations, motion.torques, motion.base_position)
        return motion

    def _check(self, *arrays: Array) -> None:
        if not all(np.isfinite(values).all() for values in arrays):
            reason = "is not a motion at all times: it holds what is no number"
            raise InputError(reason, source=self.motion.problem.name)

    def contacts(self, times: Array) -> dict[str, Any]:
        """Return the contacts at times (N,), s, at a change of them those before; nothing of a motion without phases.

        ``phase`` (N,) counts from 0, ``phase_begin`` (P,) s; ``contact_names`` (C,) of all points that stand at some
        time; ``contacts`` (N, C), whether each stands; ``forces`` (N, C, 3), N, on the robot, in the world, and
        ``contact_points``, m, where they act, NaN of what does not stand.
        """
        motion = self.motion
        phases = self.motion.phases
        if not phases:
            return {}
        times = np.minimum(times, motion.duration)
        phase = phase_of(motion, times)
        forces = motion.forces(times)
        points = motion.contact_points(times)
        stands = np.empty((len(phases), len(forces)), np.bool_)
        for number, one in enumerate(phases):
            stands[number] = [name in one.contacts for name in forces]
        return {
            "phase": phase,
            "phase_begin": np.array([one.begin for one in phases]),
            "contact_names": np.array([*forces]),
            "contacts": stands[phase],
            "forces": np.stack([forces[name] for name in forces], axis=1),
            "contact_points": np.stack([points[name] for name in forces], axis=1),
        }


def exported(
    motion: Trajectory, kp: Gain | None = None, kd: Gain | None = None, model: ModelNames | None = None
) -> Exported:
    """Return a motion as exporters read it.

    There are gains where there is one, or where the motion is a jump, which no motor tracks without. Defaults of a
    jump are those with which :func:`floatplan.replay_jump` begins to search,
    :func:`floatplan.simulation.gains.gains_of_jump`. Of a plan the default stiffness of a joint is ``BANDWIDTH**2``
    times the inertia that it moves at the start while the robot floats, as that of :func:`floatplan.closed_loop`, and
    its default damping the critical one, ``2 sqrt(kp inertia)``.

    Parameters
    ----------
    motion : Plan or Jump
    kp, kd : float or mapping, optional
        Stiffness, N m/rad, and damping, N m s/rad (N/m and N s/m of a joint that slides), of all joints or of some by
        name; others have their defaults.
    model : ModelNames, optional, as of :class:`Exported`

    Raises
    ------
    InputError
        The jump has no flight, or its check does not hold; or a gain is wrong.
    """
    if isinstance(motion, JumpMotion):
        motion.refuse_unless_ok("export")
    result = Exported(motion, model=model)
    if isinstance(motion, JumpMotion):
        return replace(result, gains=read_only(gains_of_jump(motion, (kp, kd))))
    if kp is None and kd is None:
        return result
    posture = np.zeros(motion.problem.robot.model.nv)
    posture[BASE:] = result.at(np.zeros(1)).positions[0]
    inertia = joint_inertia(result.robot.model, posture)
    stiffness = requested_gains(result.joints, kp, "kp", BANDWIDTH**2 * inertia)
    damping = requested_gains(result.joints, kd, "kd", 2.0 * np.sqrt(stiffness * inertia))
    return replace(result, gains=read_only([stiffness, damping]))
