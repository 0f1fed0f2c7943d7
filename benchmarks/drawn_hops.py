"""True motions of robots that hop, drawn by seed: a stance, a flight that conserves momentum, a stance; and spoiled ones.

The flight is planned; feet are at rest as it begins and as it ends. In the stances the feet stay where they are while
the base comes to rest, joints by inverse kinematics. Frames are taken at any rate, with noise where that is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.clips.clip import Clip, FileLayout
from floatplan.clips.curve import body_poses
from floatplan.clips.flights import lowest_point
from floatplan.clips.formats import continuous_signs

Array = NDArray[np.float64]
STANCE = 0.12  # [s] from rest to takeoff, and from landing to rest
STILL = 0.3  # [s] before and after that
ROBOTS = {
    "go2": "example-robot-data:go2_description/urdf/go2.urdf",
    "solo12": "example-robot-data:solo_description/robots/solo12.urdf",
    "g1": "example-robot-data:g1_description/urdf/g1_29dof_rev_1_0.urdf",
}
FEET = {
    "go2": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
    "solo12": ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
    "g1": ("left_ankle_roll_link", "right_ankle_roll_link"),
}
POSTURES = {
    "go2": {"thigh": 1.0, "calf": -2.0},
    "solo12": {"F": (1.0, -2.0), "H": (-1.0, 2.0)},
    "g1": {"hip_pitch": -0.6, "knee": 1.2, "ankle_pitch": -0.6},
}


@dataclass(frozen=True, eq=False)
class Hop:
    """A true motion: stance, flight, stance; ``configurations(times)`` (K, 7 + J) of the robot's model."""

    robot: fp.Robot
    plan: fp.Plan
    feet: tuple[str, ...]
    before: Array  # configurations of the stance before, at STEPS instants
    after: Array

    @property
    def takeoff(self) -> float:
        """When the flight begins, s from the first frame."""
        return STILL + STANCE

    @property
    def duration(self) -> float:
        """Of all, s."""
        return 2 * self.takeoff + self.plan.duration

    def configurations(self, times: Array) -> Array:
        """Configurations (K, 7 + J): place, quaternion, joints."""
        begin, end = self.takeoff, self.takeoff + self.plan.duration
        found = np.empty((len(times), self.robot.model.nq))
        in_flight = (times >= begin) & (times <= end)
        if in_flight.any():
            found[in_flight] = self.plan.q(np.clip(times[in_flight] - begin, 0.0, self.plan.duration))
        for chosen, known, first in ((times < begin, self.before, STILL), (times > end, self.after, end)):
            grid = first + np.linspace(0.0, STANCE, len(known))
            at = np.clip(times[chosen], grid[0], grid[-1])
            for column in range(known.shape[1]):
                found[chosen, column] = np.interp(at, grid, known[:, column])
        return found


@cache
def robot_of(name: str) -> fp.Robot:
    """Return one of the robots, with a free base."""
    return fp.Robot.from_urdf(ROBOTS[name], base="free-flyer")


def posture_of(name: str) -> Array:
    """Return joints (J,), rad, in which a robot stands."""
    robot, found = robot_of(name), []
    for joint in robot.model_joints:
        value = 0.0
        if name == "solo12":
            leg = POSTURES[name][joint[0]]
            value = leg[0] if joint.endswith("HFE") else leg[1] if joint.endswith("KFE") else 0.0
        else:
            for word, angle in POSTURES[name].items():
                value = float(angle) if word in joint else value
        found.append(value)
    return np.array(found)


def draw_hop(name: str, rng: np.random.Generator) -> Hop | None:
    """Draw a hop; None where the planner finds no flight for the numbers that were drawn."""
    robot, feet = robot_of(name), FEET[name]
    duration = rng.uniform(0.34, 0.5)
    legs = _leg_columns(robot, feet)
    start_turn = Rotation.from_rotvec(np.deg2rad([3.0, 3.0, 0.0]) * rng.normal(size=3))
    yaw = Rotation.from_rotvec(np.deg2rad([0.0, 0.0, 15.0]) * rng.normal(size=3))
    goal_turn = yaw * Rotation.from_rotvec(np.deg2rad([3.0, 3.0, 0.0]) * rng.normal(size=3))
    across = 0.25 * rng.normal(size=2)
    begin = _standing(robot, feet, legs, name, rng, start_turn, Rotation.identity())
    end = _standing(robot, feet, legs, name, rng, goal_turn, yaw)
    if begin is None or end is None:
        return None
    com = [_com(robot, each) for each in (begin, end)]
    rise = com[1][2] - com[0][2]
    up = rise / duration + 9.81 * duration / 2
    momentum = _inertia(robot, begin) @ ((goal_turn * start_turn.inv()).as_rotvec() / duration)
    rates = []
    for configuration, vertical in ((begin, up), (end, up - 9.81 * duration)):
        velocity = _foot_rest_velocity(robot, feet, legs, configuration, np.array([*across, vertical]), momentum)
        if velocity is None:
            return None
        rates.append(velocity)
    names = robot.joints
    columns = [robot.model_joints.index(joint) for joint in names]
    problem = fp.Problem(
        robot,
        start=_state(names, begin, rates[0], columns),
        goal=_state(names, end, rates[1], columns),
        flight=fp.Flight(
            duration=duration,
            angular_momentum="free",
            takeoff=fp.Takeoff(frame=robot.joint_tree.root, position=(0.0, 0.0, float(begin[2]))),
            landing=fp.Landing(frame=robot.joint_tree.root, height=float(end[2])),
            horizontal_velocity=tuple(across.tolist()),
        ),
        motion=fp.Motion(degree=9),
    )
    plan = fp.plan(problem, budget=3.0)
    if not plan.ok:
        return None
    q, v = plan.q(np.array([0.0, duration])), plan.v(np.array([0.0, duration]))
    before = _stance(robot, feet, legs, q[0], v[0], forwards=False)
    after = _stance(robot, feet, legs, q[1], v[1], forwards=True)
    if before is None or after is None:
        return None
    return Hop(robot=robot, plan=plan, feet=feet, before=before, after=after)


def _leg_columns(robot: fp.Robot, feet: Sequence[str]) -> list[int]:
    """Velocities of the model that move a foot."""
    model = robot.model
    found = set()
    for foot in feet:
        joint = model.frames[model.getFrameId(foot, pin.FrameType.BODY)].parentJoint
        while joint > 1:
            if "waist" not in model.names[joint]:
                found.add(model.joints[joint].idx_v)
            joint = model.parents[joint]
    return sorted(found)


def _state(names: Sequence[str], configuration: Array, velocity: Array, columns: Sequence[int]) -> fp.Posture:
    joints, rates = configuration[7:], velocity[6:]
    return fp.Posture(
        orientation=fp.Attitude(quaternion_xyzw=tuple(configuration[3:7].tolist())),
        positions={name: float(joints[column]) for name, column in zip(names, columns, strict=True)},
        velocities={name: float(rates[column]) for name, column in zip(names, columns, strict=True)},
    )


def _standing(
    robot: fp.Robot,
    feet: Sequence[str],
    legs: Sequence[int],
    name: str,
    rng: np.random.Generator,
    turn: Rotation,
    yaw: Rotation,
) -> Array | None:
    """A configuration that stands on the usual footholds, turned by a yaw, with its base tilted; None where it cannot."""
    model, data = robot.model, robot.model.createData()
    usual = np.concatenate(([0.0, 0.0, 0.0], yaw.as_quat(), posture_of(name)))
    bodies = {model.frames[model.getFrameId(foot, pin.FrameType.BODY)].parentJoint for foot in feet}
    poses = body_poses(model, np.zeros((1, 3)), yaw.as_matrix()[None], usual[None, 7:])
    lowest = min(lowest_point(poses, [solid for solid in robot.solids if solid.body == body])[0, 2] for body in bodies)
    usual[2] = -lowest
    frames = [model.getFrameId(foot, pin.FrameType.BODY) for foot in feet]
    pin.framesForwardKinematics(model, data, usual)
    targets = [pin.SE3(data.oMf[frame]) for frame in frames]
    drawn = usual.copy()
    drawn[:3] += np.array([0.01, 0.01, 0.015]) * rng.normal(size=3)
    drawn[3:7] = turn.as_quat()
    others = [column for column in range(6, model.nv) if column not in legs]
    drawn[[column + 1 for column in others]] += 0.15 * rng.normal(size=len(others))
    found, missed = _with_feet_at(robot, feet, legs, drawn, targets)
    return found if missed < 1e-8 else None


def _with_feet_at(
    robot: fp.Robot, feet: Sequence[str], legs: Sequence[int], configuration: Array, targets: Sequence[Any]
) -> tuple[Array, float]:
    """The configuration with the legs moved until the feet are at targets, and by how much they still miss."""
    model, data = robot.model, robot.model.createData()
    frames = [model.getFrameId(foot, pin.FrameType.BODY) for foot in feet]
    columns = list(legs)
    for _ in range(12):
        pin.computeJointJacobians(model, data, configuration)
        pin.updateFramePlacements(model, data)
        misses = []
        for frame, target in zip(frames, targets, strict=True):
            misses.append(target.translation - data.oMf[frame].translation)
            if len(feet) == 2:
                misses.append(pin.log3(target.rotation @ data.oMf[frame].rotation.T))
        miss = np.concatenate(misses)
        if np.abs(miss).max() < 1e-10:
            break
        jacobian = _foot_rows(robot, data, feet)[:, columns]
        change = np.zeros(model.nv)
        change[columns] = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-8 * np.eye(len(miss)), miss)
        configuration = pin.integrate(model, configuration, change)
    return configuration, float(np.abs(miss).max())


def _com(robot: fp.Robot, configuration: Array) -> Array:
    data = robot.model.createData()
    return np.array(pin.centerOfMass(robot.model, data, configuration))


def _inertia(robot: fp.Robot, configuration: Array) -> Array:
    """The inertia of the whole robot about its centre of mass, in the world's axes, kg m^2."""
    data = robot.model.createData()
    pin.ccrba(robot.model, data, configuration, np.zeros(robot.model.nv))
    return np.array(data.Ig.inertia)


def _foot_rows(robot: fp.Robot, data: Any, feet: Sequence[str]) -> Array:
    """Jacobian of the feet: of their origins, of two feet their attitudes too."""
    rows = []
    for foot in feet:
        frame = robot.model.getFrameId(foot, pin.FrameType.BODY)
        jacobian = pin.getFrameJacobian(robot.model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        rows.append(jacobian if len(feet) == 2 else jacobian[:3])
    return np.concatenate(rows)


def _foot_rest_velocity(
    robot: fp.Robot, feet: Sequence[str], legs: Sequence[int], configuration: Array, com: Array, momentum: Array
) -> Array | None:
    """The velocity (nv,) with which the feet are at rest, the centre of mass and the momentum are as given."""
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, configuration)
    pin.updateFramePlacements(model, data)
    feet_rows = _foot_rows(robot, data, feet)
    centroidal = np.array(pin.computeCentroidalMap(model, data, configuration))
    free = [*range(6), *legs]
    wanted = np.concatenate((np.zeros(len(feet_rows)), robot.mass * com, momentum))
    matrix = np.concatenate((feet_rows, centroidal))[:, free]
    found, *_ = np.linalg.lstsq(matrix, wanted, rcond=1e-9)
    if np.abs(matrix @ found - wanted).max() > 1e-6 or np.abs(found[6:]).max() > 20.0:
        return None
    velocity = np.zeros(model.nv)
    velocity[free] = found
    return velocity


STEPS = 41  # [-] configurations of a stance


def _stance(
    robot: fp.Robot, feet: Sequence[str], legs: Sequence[int], configuration: Array, velocity: Array, forwards: bool
) -> Array | None:
    """Configurations of a stance in which the base comes to rest and the feet stay, in the order of time."""
    model, data = robot.model, robot.model.createData()
    frames = [model.getFrameId(foot, pin.FrameType.BODY) for foot in feet]
    pin.framesForwardKinematics(model, data, configuration)
    targets = [pin.SE3(data.oMf[frame]) for frame in frames]
    sign = 1.0 if forwards else -1.0
    rows = [configuration]
    now = configuration
    step = STANCE / (STEPS - 1)
    for k in range(1, STEPS):
        s = (k - 0.5) / (STEPS - 1)
        share = (1 - s) ** 2 * (1 + 2 * s)  # from the velocity at the flight to rest
        now = pin.integrate(model, now, sign * step * share * velocity)
        now, missed = _with_feet_at(robot, feet, legs, now, targets)
        if missed > 1e-6:
            return None
        rows.append(now)
    found = np.array(rows)
    return found if forwards else found[::-1]


def clip_of(hop: Hop, fps: float, configurations: Array | None = None) -> Clip:
    """Return a hop as a clip; of other configurations (N, 7 + J) where they are given."""
    times = np.arange(int(hop.duration * fps) + 1) / fps
    q = hop.configurations(times) if configurations is None else configurations
    robot = hop.robot
    return Clip(
        robot=robot,
        path=__import__("pathlib").Path("drawn.csv"),
        fps=fps,
        base_position=q[:, :3],
        base_quaternion=continuous_signs(q[:, 3:7]),
        positions=q[:, 7:],
        layout=FileLayout("unitree-csv", robot.model_joints),
    )


def noisy(clip: Clip, rng: np.random.Generator, degrees: float, metres: float) -> Clip:
    """The clip with independent noise in every frame."""
    angle = np.deg2rad(degrees)
    turned = Rotation.from_rotvec(angle / np.sqrt(3) * rng.normal(size=(clip.frames, 3))) * Rotation.from_quat(
        clip.base_quaternion
    )
    return replace(
        clip,
        base_position=clip.base_position + metres * rng.normal(size=clip.base_position.shape),
        base_quaternion=continuous_signs(turned.as_quat()),
        positions=clip.positions + angle * rng.normal(size=clip.positions.shape),
    )


def stretched(hop: Hop, fps: float, factor: float) -> Clip:
    """The hop with its flight slower by a factor in time."""
    begin, end = hop.takeoff, hop.takeoff + hop.plan.duration
    longer = (factor - 1) * hop.plan.duration
    times = np.arange(int((hop.duration + longer) * fps) + 1) / fps
    own = np.where(
        times < begin, times, np.where(times > end + longer, times - longer, begin + (times - begin) / factor)
    )
    return clip_of(hop, fps, hop.configurations(own))


def drifted(hop: Hop, fps: float, degrees: float, axis: Array) -> Clip:
    """The hop whose base turns farther and back in its flight, by so much at most."""
    times = np.arange(int(hop.duration * fps) + 1) / fps
    q = hop.configurations(times)
    s = np.clip((times - hop.takeoff) / hop.plan.duration, 0.0, 1.0)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * (np.sin(np.pi * s) ** 2)[:, None] * axis)
    q[:, 3:7] = (turn * Rotation.from_quat(q[:, 3:7])).as_quat()
    return clip_of(hop, fps, q)


def shifted(hop: Hop, fps: float, metres: float, axis: Array) -> Clip:
    """The hop whose base moves aside and back in its flight, by so much at most."""
    times = np.arange(int(hop.duration * fps) + 1) / fps
    q = hop.configurations(times)
    s = np.clip((times - hop.takeoff) / hop.plan.duration, 0.0, 1.0)
    q[:, :3] += metres * (np.sin(np.pi * s) ** 2)[:, None] * axis
    return clip_of(hop, fps, q)
