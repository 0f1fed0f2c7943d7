"""One flight of a whole jump in MuJoCo with contact, by torques and by springs with dampers on the joints.

500 times a second each motor gets the jump's torque at that time and joint feedback, held for the period, up to what it
can at its speed. Feedback compares what was measured, late, with what was wanted then. With corrections, a
:class:`~floatplan.inflight.replanner.Replanner` gets the same measurements while the robot is in the air. Nothing of
the planner is used: the ground pushes as MuJoCo's contacts do.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.inflight.replanner import Replanner
from floatplan.simulation.contact_model import STEP, ContactRobot, least_heights
from floatplan.simulation.jump_landings import AFTER, PERIOD, FlownJump
from floatplan.simulation.perturbation import Drawn, Perturbation
from floatplan.simulation.recorded_motion import SLOW
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import BASE, JumpState

STEPS = round(PERIOD / STEP)  # [-] of the simulation in it
CLEAR = 5e-3  # [m] of feet above the ground as planned: lower ones of a robot that is not as planned may touch it


@dataclass(frozen=True, eq=False)
class Flown:
    """One of :class:`floatplan.simulation.jump_landings.JumpLandings`, its corrections by status, and its motion.

    ``tilt`` is the trunk's largest, rad, from where it should be, from the landing on; ``balanced`` is as of
    :func:`floatplan.simulation.mujoco_model.inertial_spec`.
    """

    stands: bool
    touched: tuple[str, ...]
    pitch: float
    tilt: float
    torque: float
    slid: float
    statuses: Counter[str]
    balanced: dict[str, float]
    motion: FlownJump


class JumpControl:
    """A jump, and what follows it: gains (2, J) of all joints, and corrections in flight at a rate, Hz, if any."""

    def __init__(self, jump: JumpMotion, gains: Array, rate: float | None) -> None:
        assert jump.flight is not None
        self.jump, self.gains, self.robot = jump, gains, jump.problem.robot
        robot, problem = self.robot, jump.problem
        self.times = np.arange(int((jump.duration + AFTER) / PERIOD) + 1) * PERIOD
        self.wanted = jump.at(np.minimum(self.times, jump.duration))
        self.ends = jump.q(np.array([0.0, jump.duration]))[:, [0, 1, 2, 6, 3, 4, 5]]
        self.data, self.axes = robot.model.createData(), np.stack((robot.plane.horizontal, robot.plane.vertical))
        self.joints = tuple(robot.model.names)[BASE + 1 :]
        self.motors = [self.joints.index(name) for name in robot.motors]
        self.effort = np.array([robot.joint_tree.joint[name].effort for name in self.joints])
        self.stall, self.slope = np.full(len(self.joints), np.inf), np.zeros(len(self.joints))
        self.effort[self.motors] = problem.motor_torque_limits
        self.stall[self.motors], self.slope[self.motors] = problem.motor_stall, problem.motor_slope
        losses = [[each.get(name, 0.0) for name in self.joints] for each in (robot.damping, robot.friction)]
        rates = self.wanted.velocities[:, BASE:]
        lost = np.array(losses[0]) * rates + np.array(losses[1]) * np.tanh(rates / SLOW)
        self.torques = self.wanted.torques[:, BASE:] + lost
        self.motor_torques = self.wanted.torques @ robot.transmission
        self.to_planned = np.linalg.pinv(robot.selection[BASE:])
        self.flown = jump.takeoff_time, jump.takeoff_time + jump.flight.duration
        flying = (self.times >= self.flown[0]) & (self.times < self.flown[1])
        heights = least_heights(jump, self.wanted.positions[flying])
        clear = self.times[flying][heights > CLEAR]
        self.clear = (clear[0], self.flown[1] - clear[-1]) if len(clear) else (self.flown[0], 0.0)  # s, before landing
        self.goal = jump.flight.problem.final.orientation
        self.replanner = None if rate is None else Replanner(jump.flight, rate)
        self.every = 1 if rate is None else max(1, round(1 / (rate * PERIOD)))

    def fly(
        self,
        perturbation: Perturbation,
        friction: float,
        flight: tuple[int, int],
        correct: bool,
        record: bool = False,
        **chosen: Any,
    ) -> Flown:
        """Fly one robot, drawn by a seed and its number but for what is chosen of it, on a ground of some friction."""
        drawn = replace(perturbation.drawn(*flight, len(self.joints), self.robot.model.njoints), **chosen)
        robot = ContactRobot(self.jump, drawn.friction * friction, drawn)
        robot.begin(self.ends[0], self.wanted.positions[0])
        loop = _Loop(self, perturbation, drawn, self.replanner if correct else None)
        pitch, tilt, slid, rows = np.nan, 0.0, 0.0, []
        for tick, now in enumerate(self.times.tolist()):
            state = robot.state()
            if np.isnan(pitch) and now >= loop.landing:
                pitch = robot.pitch - self.goal
            if now >= loop.landing:
                tilt = max(tilt, abs(robot.pitch - float(self.wanted.positions[tick, BASE - 1])))
            torques = loop.torques(tick, np.stack(state[:2]))
            if not robot.move(torques, STEPS):
                tilt = np.inf
                break
            slid = slid + robot.slips * PERIOD * (now < self.jump.duration)
            if record:
                rows.append((*state, np.append(np.zeros(BASE), torques), robot.forces.copy(), robot.points.copy()))
        return Flown(
            stands=robot.stands(self.ends[1], self.wanted.positions[-1, BASE - 1]),
            touched=robot.links(),
            pitch=float(pitch),
            tilt=tilt,
            torque=loop.share,
            slid=float(np.max(slid)),
            statuses=loop.statuses,
            balanced=robot.balanced,
            motion=self._recorded(rows, tuple(robot.feet)),
        )

    def _recorded(self, rows: Sequence[tuple[Array, ...]], feet: tuple[str, ...]) -> FlownJump:
        jump = self.jump
        parts = jump.problem, jump.request, jump.flight, jump.before, jump.after
        if not rows:
            return FlownJump(*parts)
        positions, velocities, accelerations, torques, forces, points = map(read_only, zip(*rows, strict=True))
        of_feet = (dict(zip(feet, np.moveaxis(each, 1, 0), strict=True)) for each in (forces @ self.axes.T, points))
        in_plane, places = of_feet
        times = read_only(self.times[: len(rows)])
        state = JumpState(times, positions, velocities, accelerations, in_plane, torques, places)
        return FlownJump(*parts, recorded=state)


class _Loop:
    """The controller in one flight: what it measured, how far off that was, how it was corrected.

    ``share`` is the largest torque that was wanted of a motor over what it can at its speed.
    """

    def __init__(
        self, control: JumpControl, perturbation: Perturbation, drawn: Drawn, replanner: Replanner | None
    ) -> None:
        self.control, self.drawn, self.replanner = control, drawn, replanner
        self.noise = np.array([[perturbation.noise], [perturbation.noise_of_rates]])
        self.late = round(perturbation.delay / PERIOD)
        self.statuses, self.share = Counter[str](), 0.0
        self.measured: list[Array] = []
        self.errors: list[Array] = []
        if replanner is not None:
            replanner.reset()

    @property
    def landing(self) -> float:
        """When the flight should end, s from the jump's start: as corrections expect it, else as planned."""
        begin, end = self.control.flown
        return end if self.replanner is None else begin + self.replanner.landing

    def torques(self, tick: int, state: Array) -> Array:
        """Torques (J,) N m at a tick, from all coordinates with their rates (2, BASE + J) as they are."""
        control, known = self.control, state.copy()
        known[:, BASE - 1 :] += self.noise * self.drawn.noise.standard_normal((2, state.shape[1] - BASE + 1))
        self.measured.append(known)
        goal, torques = self._reference(tick)
        self.errors.append(goal - known[:, BASE:])
        if tick >= self.late:
            torques = torques + (control.gains * self.errors[tick - self.late]).sum(axis=0)
        slowed, size = control.slope * np.abs(state[1, BASE:]), np.abs(torques)
        shares = np.maximum(size / control.effort, (size + slowed) / control.stall)
        self.share = max(self.share, float(shares.max()))
        most = np.minimum(control.effort, np.maximum(control.stall - slowed, 0.0))
        return np.asarray(self.drawn.torque * np.clip(torques, -most, most))

    def _reference(self, tick: int) -> tuple[Array, Array]:
        """Places and rates (2, J) that are wanted of all joints, and feed-forward torques (J,)."""
        control, robot = self.control, self.control.robot
        begin, now, then = control.flown[0], float(control.times[tick]), tick - self.late
        if self.replanner is None or not begin <= now < self.landing:
            early = 0 if now < begin else round((control.flown[1] - self.landing) / PERIOD)
            row = min(tick + early, len(control.times) - 1)
            goal = np.stack((control.wanted.positions[row, BASE:], control.wanted.velocities[row, BASE:]))
            return goal, control.torques[row]
        resting = np.stack((robot.reference[BASE:], np.zeros(len(control.joints))))
        in_air = then >= 0 and control.times[then] >= control.clear[0] and now < self.landing - control.clear[1]
        if tick % control.every == 0 and in_air:
            places, rates = known = self.measured[then]
            angles, velocities = (known[:, BASE:] - resting) @ control.to_planned.T
            pin.centerOfMass(robot.model, control.data, places, rates)
            base, of_com = known[:, BASE - 1].tolist(), (control.data.com[0], control.data.vcom[0])
            joints = angles, velocities, now - begin, *(control.axes @ each for each in of_com)
            done = self.replanner.update(float(control.times[then]) - begin, base[0], base[1], *joints)
            self.statuses[done.status] += 1
        reference = self.replanner.reference(now - begin)
        torques = control.torques[tick].copy()
        torques[control.motors] += reference.motors - control.motor_torques[tick]
        return resting + np.stack((reference.positions, reference.velocities)) @ robot.selection[BASE:].T, torques
