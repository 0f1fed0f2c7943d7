"""Controls of the actuators of an MJCF by which its joints get the torques of a motion."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import CompiledMjcf
from floatplan.robot.mjcf.motors import actuator_torques, actuators_of, joint_losses

TORQUE_ROUNDING = 1e-6  # [N m] and share of a torque: smaller differences of actuators' torques get no note


@dataclass(frozen=True, eq=False)
class JointDrive:
    """The actuators of one joint.

    An actuator without a state of its own, whose gain does not change, gives the joint the torque
    ``gear (gain ctrl + b_0 + b_1 gear q + b_2 gear q')``: a ``<motor>`` where all of ``b`` are zero, a ``<position>``
    or ``<velocity>`` servo where they are not. It is solved for ``ctrl``.
    """

    model: CompiledMjcf
    name: str
    joint: int
    actuators: Sequence[int]

    def controls(self, torques: Array, positions: Array, rates: Array) -> dict[int, Array]:
        """Return the control (N,) of each actuator that gives torques (N,), N m, at positions and rates (N,)."""
        controls = {}
        for number, share in zip(self.actuators, self._shares(torques).T, strict=True):
            gear, gain, bias = self._coefficients(number)
            force = share / gear
            controls[number] = (force - bias[0] - gear * (bias[1] * positions + bias[2] * rates)) / gain
        return controls

    def torques(self, controls: Mapping[int, Array], positions: Array, rates: Array) -> Array:
        """Return the torques (N,), N m, that MuJoCo's actuators give, whose controls and forces it clips."""
        model = self.model
        torques = np.zeros(len(positions))
        for number in self.actuators:
            gear, gain, bias = self._coefficients(number)
            control = controls[number]
            if model.actuator_ctrllimited[number]:
                control = np.clip(control, *model.actuator_ctrlrange[number])
            force = gain * control + bias[0] + gear * (bias[1] * positions + bias[2] * rates)
            if model.actuator_forcelimited[number]:
                force = np.clip(force, *model.actuator_forcerange[number])
            torques += gear * force
        if model.jnt_actfrclimited[self.joint]:
            torques = np.clip(torques, *model.jnt_actfrcrange[self.joint])
        return torques

    def check(self) -> None:
        """Refuse actuators whose control cannot be computed from a torque.

        Raises
        ------
        InputError
            One has a state, as muscles and filters do, or a gain that changes, as dampers have, or none at all.
        """
        model = self.model
        constants = self.model.constants
        for number in self.actuators:
            reason = ""
            gear, gain, _ = self._coefficients(number)
            if model.actuator_dyntype[number] != constants["mjDYN_NONE"]:
                kind = model.constant(int(model.actuator_dyntype[number]), "mjDYN_").removeprefix("mjDYN_").lower()
                reason = f"has a state of its own, of dynamics {kind!r}"
            elif model.actuator_gaintype[number] != constants["mjGAIN_FIXED"]:
                reason = "is a muscle, a damper or another actuator whose gain changes with the motion"
            elif model.actuator_biastype[number] not in (constants["mjBIAS_NONE"], constants["mjBIAS_AFFINE"]):
                reason = "is a muscle or another actuator whose force does not follow from position and rate alone"
            elif not gear * gain:
                reason = "has a gain or gear of zero"
            if reason:
                name = model.names["actuator"][number] or f"number {number + 1}"
                advice = (
                    "give a --model whose actuators are motors or servos, or take another format, such as pinocchio"
                )
                reason = f"{reason}: no ctrl of it gives {self.name} the torques of a motion"
                raise InputError(reason, element=f'actuator "{name}"', advice=advice)

    def _coefficients(self, number: int) -> tuple[float, float, Array]:
        """Gear, gain, and the three numbers of the bias."""
        model = self.model
        gear = float(model.actuator_gear[number, 0])
        gain = float(model.actuator_gainprm[number, 0])
        has_bias = model.actuator_biastype[number] != model.constants["mjBIAS_NONE"]
        return gear, gain, model.actuator_biasprm[number, :3] * float(has_bias)

    def _shares(self, torques: Array) -> Array:
        """Torque (N, a) of each actuator: by their largest torques in that direction, equal ones without limits."""
        limits = np.array([actuator_torques(self.model, number) for number in self.actuators])
        backwards = _fractions(np.maximum(-limits[:, 0], 0.0))
        forwards = _fractions(np.maximum(limits[:, 1], 0.0))
        return np.where(torques[:, None] < 0.0, backwards, forwards) * torques[:, None]


def _fractions(most: Array) -> Array:
    """Fractions (a,) of one, as the largest torques (a,) are to one another."""
    if np.isinf(most).any():
        return np.asarray(np.isinf(most) / np.isinf(most).sum())
    if not most.any():  # in a direction in which none acts: the first, whose note then tells that it cannot
        return np.asarray(np.eye(len(most))[0])
    return np.asarray(most / most.sum())


@dataclass(frozen=True, eq=False)
class Controls:
    """``ctrl`` (N, actuators) of a model, and sentences about what its actuators cannot do."""

    ctrl: Array
    notes: tuple[str, ...]


def controls(model: CompiledMjcf, joints: Mapping[str, int], times: Array, motion: Mapping[str, Array]) -> Controls:
    """Return the controls of the actuators of a model.

    Parameters
    ----------
    model : CompiledMjcf
    joints : numbers of the J joints in the model, by name
    times : (N,) s
    motion : "positions", "velocities", "torques", (N, J) each
        Losses of a joint of the model by damping and friction, and its spring, are added to the torques.

    Raises
    ------
    InputError
        As of :meth:`JointDrive.check`.
    """
    ctrl = np.zeros((len(times), len(model.names["actuator"])))
    notes: list[str] = []
    idle: list[str] = []
    for column, (name, joint) in enumerate(joints.items()):
        positions = motion["positions"][:, column]
        rates = motion["velocities"][:, column]
        torques = motion["torques"][:, column] + _passive(model, joint, positions, rates)
        drive = JointDrive(model, name, joint, actuators_of(model, joint))
        if not drive.actuators:
            if np.abs(torques).max() > TORQUE_ROUNDING:
                idle.append(f"{name} ({np.abs(torques).max():.4g})")
            continue
        drive.check()
        of_joint = drive.controls(torques, positions, rates)
        for number, values in of_joint.items():
            ctrl[:, number] = values
        notes += _clipped(name, times, torques, drive.torques(of_joint, positions, rates))
    if idle:
        notes.append(f"no actuator gives these joints the torque that they take, N m: {', '.join(idle)}")
    others = []
    driving = set[int]()
    for joint in joints.values():
        driving |= set(actuators_of(model, joint))
    for number, name in enumerate(model.names["actuator"]):
        if number not in driving:
            others.append(name or f"number {number + 1}")
    if others:
        notes.append(f"ctrl is zero for actuators that act on none of the robot's joints: {', '.join(others)}")
    return Controls(ctrl, tuple(notes))


def _passive(model: CompiledMjcf, joint: int, positions: Array, rates: Array) -> Array:
    """Torque (N,) that a joint's damping, friction and spring take."""
    losses = joint_losses(model, joint, actuators_of(model, joint))
    spring = model.jnt_stiffness[joint] * (positions - model.qpos_spring[model.jnt_qposadr[joint]])
    return np.asarray(losses["damping"] * rates + losses["friction"] * np.sign(rates) + spring)


def _clipped(name: str, times: Array, torques: Array, available: Array) -> Iterator[str]:
    missing = np.abs(torques - available) - TORQUE_ROUNDING * (1.0 + np.abs(torques))
    row = int(np.argmax(missing))
    if missing[row] > 0.0:
        yield (
            f"{name} takes {torques[row]:.4g} N m at {times[row]:.3g} s, and the ranges of its actuators let them give "
            f"{available[row]:.4g}: MuJoCo clips ctrl or force, and the motion is not followed"
        )
