"""Flights in space by Pinocchio and DOP853, which share nothing with the proof: plans that are true."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
from proof_plans import blank_record
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from floatplan.arrays import read_only
from floatplan.plans.record import FORMAT_IN_SPACE, PlanRecord
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import urdf_path

BASE = 6
RTOL, ATOL = 2.3e-14, 1e-15  # the least that DOP853 takes


def joints_at(record, times):
    """Positions, velocities and accelerations (N, n) of (12)."""
    b = record.coefficients
    k = np.arange(b.shape[1])
    powers = np.asarray(times)[:, None] ** k
    p = powers @ b.T
    dp = powers[:, :-1] @ (k * b)[:, 1:].T
    ddp = powers[:, :-2] @ (k * (k - 1) * b)[:, 2:].T
    sine, cosine = np.sin(p), np.cos(p)
    return (
        record.centre + record.amplitude * sine,
        record.amplitude * cosine * dp,
        record.amplitude * (cosine * ddp - sine * dp**2),
    )


class FreeRobot:
    """Pinocchio's model of a file on a free base, with one coordinate for each joint that is planned."""

    def __init__(self, urdf: str, joints: tuple[str, ...]):
        self.model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        self.model.gravity.linear[:] = 0.0
        self.data = self.model.createData()
        self.columns = np.array([self.model.joints[self.model.getJointId(name)].idx_v for name in joints])
        assert len(joints) == self.model.nv - BASE

    def configuration(self, q):
        full = pin.neutral(self.model)
        full[self.columns + 1] = q
        return full

    def maps(self, q):
        """I and A, with the base at the identity."""
        ag = pin.computeCentroidalMap(self.model, self.data, self.configuration(q))
        return ag[3:, 3:6].copy(), ag[3:][:, self.columns].copy()

    def rate(self, attitude, h, q, dq):
        inertia, by_joints = self.maps(q)
        return np.linalg.solve(inertia, attitude.T @ h - by_joints @ dq)

    def torques(self, omega, q, dq, ddq):
        full, v, a = self.configuration(q), np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[3:6], v[self.columns], a[self.columns] = omega, dq, ddq
        wrench = pin.rnea(self.model, self.data, full, v, a)[:BASE].copy()
        mass = pin.crba(self.model, self.data, full)
        a[:BASE] = -np.linalg.solve(mass[:BASE, :BASE], wrench)
        return pin.rnea(self.model, self.data, full, v, a)[self.columns].copy()

    def frame(self, name, attitude, com, q):
        """Place of a frame in the world, the centre of mass being at ``com``."""
        full = self.configuration(q)
        middle = pin.centerOfMass(self.model, self.data, full).copy()
        pin.framesForwardKinematics(self.model, self.data, full)
        return com + attitude @ (self.data.oMf[self.model.getFrameId(name)].translation - middle)


@cache
def free_robot(urdf, joints):
    return FreeRobot(urdf, joints)


@dataclass(frozen=True)
class Flown:
    """The motion at times (N,): attitudes (N, 3, 3), rates (N, 3), joints and torques (N, n)."""

    times: np.ndarray
    attitudes: np.ndarray
    rates: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    torques: np.ndarray


def flown(record, times, with_torques=True):
    """Fly a record's motion by DOP853."""
    body = free_robot(urdf_path(record.robot.file), record.robot.joints)
    h = np.array(record.angular_momentum, dtype=float)
    start = np.array(record.orientation["start"]["quaternion_xyzw"], dtype=float)

    def slope(t, y):
        q, dq, _ = (each[0] for each in joints_at(record, [t]))
        x, y_, z, w = y
        a, b, c = body.rate(pin.Quaternion(y / np.sqrt(y @ y)).matrix(), h, q, dq)
        return 0.5 * np.array(
            [w * a + y_ * c - z * b, w * b + z * a - x * c, w * c + x * b - y_ * a, -x * a - y_ * b - z * c]
        )

    end = record.duration
    found = solve_ivp(slope, (0.0, end), start / np.linalg.norm(start), "DOP853", t_eval=times, rtol=RTOL, atol=ATOL)
    attitudes = Rotation.from_quat(found.y.T).as_matrix()
    joints = joints_at(record, times)
    rates = np.array([body.rate(r, h, q, dq) for r, q, dq in zip(attitudes, *joints[:2], strict=True)])
    torques = np.zeros_like(joints[0])
    if with_torques:
        torques = np.array([body.torques(*each) for each in zip(rates, *joints, strict=True)])
    return Flown(np.asarray(times), attitudes, rates, joints[0], joints[1], joints[2], torques)


def angle(one, other):
    """Angle, rad, between two rotations, sharp where it is small."""
    return float(np.linalg.norm(Rotation.from_matrix(one.T @ other).as_rotvec()))


def make_record(
    robot: Robot,
    coefficients,
    duration,
    momentum,
    frames,
    *,
    axes=None,
    slack=1.05,
    instants=1001,
    start=None,
    velocity=(0.3, -0.2, 2.0),
) -> PlanRecord:
    """A plan that is true: limits are ``slack`` times the peaks; with ``axes`` the goal is given as angles."""
    n = len(robot.joints)
    low, high = np.array(robot.position_limits).T
    start = [0.0, 0.0, 0.0, 1.0] if start is None else start
    blank = blank_record(
        robot,
        duration,
        coefficients,
        angular_momentum=read_only(momentum),
        angular_momentum_bounds=None,
        centre=read_only((low + high) / 2),
        amplitude=read_only((high - low) / 2),
        orientation={"start": {"quaternion_xyzw": start}},
        com={},
        format=FORMAT_IN_SPACE,
    )
    dense = flown(blank, np.linspace(0.0, duration, instants))
    end = Rotation.from_matrix(dense.attitudes[-1])
    goal = {"quaternion_xyzw": end.as_quat(canonical=True).tolist()}
    asked_start, asked_goal = {"quaternion_xyzw": start}, goal
    if axes:
        turned = Rotation.from_matrix(dense.attitudes).as_euler(axes.upper())
        turned[:, [0, 2]] = np.unwrap(turned[:, [0, 2]], axis=0)
        asked_start, asked_goal = ({"angles": turned[k].tolist(), "axes": axes} for k in (0, -1))
        goal = {"quaternion_xyzw": Rotation.from_euler(axes.upper(), turned[-1]).as_quat(canonical=True).tolist()}
    takeoff, landing = frames
    body = free_robot(urdf_path(blank.robot.file), blank.robot.joints)
    position = -body.frame(takeoff, dense.attitudes[0], np.zeros(3), dense.positions[0])
    velocity = np.array(velocity)
    com_end = position + velocity * duration - np.array([0.0, 0.0, 9.81 / 2 * duration**2])
    height = body.frame(landing, dense.attitudes[-1], com_end, dense.positions[-1])[2]
    torque, speed = np.abs(dense.torques).max(0), np.abs(dense.velocities).max(0)
    push = np.abs(dense.accelerations).max(0)

    def posture(index, orientation):
        names = ("positions", "velocities", "accelerations")
        return {"orientation": orientation, **{name: getattr(dense, name)[index].tolist() for name in names}}

    problem = {
        "name": "drawn",
        "start": posture(0, asked_start),
        "goal": posture(-1, asked_goal),
        "flight": {
            "duration": duration,
            "angular_momentum": list(momentum),
            "takeoff": {"frame": takeoff, "position": [0.0, 0.0, 0.0]},
            "landing": {"frame": landing, "height": float(height)},
            "horizontal_velocity": velocity[:2].tolist(),
            "gravity": 9.81,
        },
        "motion": {"degree": [np.shape(coefficients)[1] - 1] * n, "objective": "coefficients"},
        "limits": {
            "position": np.stack([low, high], axis=1).tolist(),
            "velocity": (slack * speed).tolist(),
            "acceleration": (slack * push).tolist(),
            "torque": (slack * torque).tolist(),
            "motor": {},
            "orientation_rate": slack * float(np.linalg.norm(dense.rates, axis=1).max()),
        },
        "obstacles": [],
        "self_clearance": [],
    }
    return replace(
        blank,
        problem=problem,
        orientation={
            "start": {"quaternion_xyzw": start},
            "end": {"quaternion_xyzw": end.as_quat(canonical=True).tolist()},
            "goal": goal,
        },
        com={"position0": position.tolist(), "velocity0": velocity.tolist(), "gravity": 9.81},
        torque_peak=read_only(torque),
        velocity_peak=read_only(speed),
    )


def draw_coefficients(rng, n, duration, swing, degree=7):
    """Polynomials p that swing by about ``swing`` rad and are smooth in time."""
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    values = swing * rng.normal(size=(n, 3)) @ np.array([np.sin(np.pi * (k + 1) * (nodes + 1) / 2) for k in range(3)])
    values += swing * rng.normal(size=(n, 1))
    return np.polynomial.polynomial.polyfit((nodes + 1) / 2 * duration, values.T, degree).T
