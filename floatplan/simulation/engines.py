"""What computes a flight: accelerations by Pinocchio or by MuJoCo, under torques that are functions of time."""

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arguments import one_of
from floatplan.arrays import Array
from floatplan.robot.robot import Robot
from floatplan.simulation.integration import Dynamics, State
from floatplan.simulation.mujoco_model import MujocoRobot, MujocoSpec
from floatplan.simulation.perturbation import Sample
from floatplan.simulation.plan_motion import PlanFileMotion
from floatplan.simulation.reduced_model import ReducedModel
from floatplan.simulation.spatial_motion import quaternion_rate, rotation_matrix
from floatplan.tables import CHOICES, Engine


class PinocchioRobot:
    """A robot in free flight by Pinocchio's articulated-body algorithm; its members are those of ``MujocoRobot``."""

    def __init__(self, reduced: ReducedModel, sample: Sample) -> None:
        self.model = sample.perturbed(reduced.model)
        self.data = self.model.createData()
        self.positions, self.velocities = reduced.of_joints
        self.balanced: dict[str, float] = {}

    def accelerations(self, q: Array, v: Array, forces: Array) -> Array:
        """Return accelerations (nv,) under forces (nv,)."""
        return np.array(pin.aba(self.model, self.data, q, v, forces))

    def moved(self, q: Array, v: Array, duration: float) -> Array:
        """Return the configuration after a duration, s, at a velocity, in space along the geodesic."""
        if len(q) == len(v):
            return np.asarray(q + duration * v)
        return np.asarray(pin.integrate(self.model, q, duration * v))

    def rate(self, q: Array, v: Array) -> Array:
        """Return the derivative of a configuration by time."""
        if len(q) == len(v):
            return v
        return np.concatenate((rotation_matrix(q[3:7]) @ v[:3], quaternion_rate(q[3:7], v[3:6]), v[6:]))

    def own_state(self, q: Array, v: Array) -> State:
        """Return the same."""
        return q, v

    reduced_state = own_state


FlyingRobot: TypeAlias = PinocchioRobot | MujocoRobot  # a robot in free flight, in coordinates of its engine


def check_engine(name: str) -> Engine:
    """Return the engine of that name; InputError where there is none."""
    engine: Engine = one_of(*CHOICES["simulator"])(name, "engine")
    return engine


def flying_robot(engine: Engine, robot: Robot, reduced: ReducedModel, sample: Sample) -> FlyingRobot:
    """Return a perturbed robot on the base that its reduced model has; errors as of :class:`MujocoSpec`."""
    if engine == "pinocchio":
        return PinocchioRobot(reduced, sample)
    return MujocoRobot(MujocoSpec(robot, reduced, sample, free=reduced.is_spatial))


class JointTorques:
    """Torques (m,) by time, s, and the joints' positions and velocities (m,): the plan's, and feedback's.

    ``strength`` (m,) says how strong each motor is; without gains (2, m) of feedback the torques are open loop. Motors
    compensate what joints that move as planned lose by damping and friction; what joints lose is subtracted.
    """

    def __init__(self, motion: PlanFileMotion, strength: Array, gains: Array | None) -> None:
        self.reduced = motion.reduced
        self.strength = strength
        self.gains = gains
        self.loses = bool(motion.reduced.losses.any())
        # a Runge-Kutta method evaluates some instants twice
        self._planned = lru_cache(maxsize=4)(motion.torques)
        self._target = lru_cache(maxsize=4)(motion.joints)

    def __call__(self, time: float, positions: Array, velocities: Array) -> Array:
        """Torques (m,), N m."""
        torques = self._planned(time)
        of_positions, of_velocities = self.reduced.of_joints
        if self.loses:
            torques = torques + self.reduced.lost(self._target(time).velocities[of_velocities])
        if self.gains is not None:
            target = self._target(time)
            torques = torques + (
                self.gains[0] * (target.positions[of_positions] - positions)
                + self.gains[1] * (target.velocities[of_velocities] - velocities)
            )
        torques = self.strength * torques
        return np.asarray(torques - self.reduced.lost(velocities) if self.loses else torques)

    def dynamics(self, robot: FlyingRobot) -> Dynamics:
        """Return the accelerations of a robot under these torques, by time."""

        def accelerations(time: float, q: Array, v: Array) -> Array:
            forces = np.zeros_like(v)
            forces[robot.velocities] = self(time, q[robot.positions], v[robot.velocities])
            return robot.accelerations(q, v, forces)

        return accelerations
