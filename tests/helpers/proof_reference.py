"""The flight evaluated densely in plain floating point, independently of ``floatplan.proof``.

Geometry comes from the robot room's planar tree, torques from Newton's and Euler's equations of the bodies, the
orientation from Gauss-Legendre quadrature between neighbouring instants.
"""

from dataclasses import dataclass

import numpy as np

from floatplan.plans.record import PlanRecord
from floatplan.robot.robot import Robot


@dataclass(frozen=True)
class Dense:
    """Values at instants (N,): positions, velocities, accelerations, torques (N, n), orientation, rate (N,)."""

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    torques: np.ndarray
    orientation: np.ndarray
    rate: np.ndarray


def joints(record: PlanRecord, t):
    """Positions, velocities and accelerations (N, n) of (12)."""
    q, dq, ddq = [], [], []
    for row, centre, amplitude in zip(record.coefficients, record.centre, record.amplitude, strict=True):
        polynomial = np.polynomial.Polynomial(row)
        p, dp, ddp = polynomial(t), polynomial.deriv()(t), polynomial.deriv(2)(t)
        q.append(centre + amplitude * np.sin(p))
        dq.append(amplitude * np.cos(p) * dp)
        ddq.append(amplitude * (np.cos(p) * ddp - np.sin(p) * dp**2))
    return np.stack(q, -1), np.stack(dq, -1), np.stack(ddq, -1)


class Bodies:
    """Places, rates and accelerations of the bodies about the centre of mass, for angles phi (N, m)."""

    def __init__(self, robot: Robot):
        self.tree = robot.tree
        m = len(self.tree.mass)
        self.weights = self.tree.point_weights(np.arange(m), self.tree.center)
        self.anchors = self.tree.point_weights(np.arange(m), np.zeros(m, dtype=complex))

    def momentum(self, phi, dphi):
        turn = 1j * self.tree.turn
        z = self.tree.rotations(phi)
        r, v = z @ self.weights.T, (turn * dphi * z) @ self.weights.T
        return ((self.tree.mass * (r.conj() * v).imag * self.tree.turn) + self.tree.inertia * dphi).sum(-1)

    def moments(self, phi, dphi, ddphi):
        """Rate of change of each subtree-free body's momentum about the origin, and forces: (N, m) each."""
        turn = 1j * self.tree.turn
        z = self.tree.rotations(phi)
        r = z @ self.weights.T
        a = ((turn * ddphi - dphi**2) * z) @ self.weights.T
        force = self.tree.mass * a
        return self.tree.turn * (r.conj() * force).imag + self.tree.inertia * ddphi, force, z @ self.anchors.T

    def joint_torques(self, phi, dphi, ddphi):
        moment, force, anchor = self.moments(phi, dphi, ddphi)
        moment, force = moment.copy(), force.copy()
        torque = np.zeros_like(moment)
        for b in range(len(self.tree.mass) - 1, -1, -1):
            torque[:, b] = moment[:, b] - self.tree.turn * (anchor[:, b].conj() * force[:, b]).imag
            if self.tree.parent[b] >= 0:
                moment[:, self.tree.parent[b]] += moment[:, b]
                force[:, self.tree.parent[b]] += force[:, b]
        return torque, moment[:, 0]


def orientation_rate(robot, record, t):
    tree, bodies = robot.tree, Bodies(robot)
    q, dq, _ = joints(record, t)
    phi = q @ tree.turns.T + tree.offsets
    one = np.ones_like(phi)
    return (record.angular_momentum - bodies.momentum(phi, dq @ tree.turns.T)) / bodies.momentum(phi, one)


def evaluate(robot: Robot, record: PlanRecord, times, gauss=4) -> Dense:
    """Evaluate everything at instants that begin with 0, with so many Gauss points between neighbours."""
    times = np.asarray(times, dtype=float)
    tree, bodies = robot.tree, Bodies(robot)
    middle, half = 0.5 * (times[1:] + times[:-1]), 0.5 * np.diff(times)
    points, weights = np.polynomial.legendre.leggauss(gauss)
    nodes = (middle[:, None] + half[:, None] * points).ravel()
    steps = half * (orientation_rate(robot, record, nodes).reshape(-1, gauss) @ weights)
    orientation = record.orientation["start"] + np.concatenate([[0.0], np.cumsum(steps)])
    q, dq, ddq = joints(record, times)
    phi, dphi, ddphi = q @ tree.turns.T + tree.offsets, dq @ tree.turns.T, ddq @ tree.turns.T
    rate = orientation_rate(robot, record, times)[:, None]
    still = bodies.joint_torques(phi, dphi + rate, ddphi)[1]
    unit = bodies.momentum(phi, np.ones_like(phi))
    base = (-still / unit)[:, None]
    per_body, _ = bodies.joint_torques(phi, dphi + rate, ddphi + base)
    relative = tree.turns.copy()
    for b in range(len(tree.mass)):
        if tree.parent[b] >= 0:
            relative[b] -= tree.turns[tree.parent[b]]
    rotors = np.zeros(len(robot.joints))
    for name, armature in record.robot.armature.items():
        coupling = record.robot.coupled.get(name, {"leader": name, "ratio": 1.0})
        rotors[robot.joints.index(coupling["leader"])] += armature * coupling["ratio"] ** 2
    return Dense(times, q, dq, ddq, per_body @ relative + rotors * ddq, orientation, rate[:, 0])


def com(record: PlanRecord, t):
    """Path of the centre of mass, complex (N,)."""
    x = record.com["position0"][0] + record.com["velocity0"][0] * t
    return x + 1j * (record.com["position0"][1] + record.com["velocity0"][1] * t - 0.5 * record.com["gravity"] * t * t)


def segments(robot: Robot, record: PlanRecord, dense: Dense, links=None):
    """Ends (N, shapes) of the links' segments, and their radii."""
    tree = robot.tree
    shapes = [shape for shape in robot.shapes if links is None or shape.link in links]
    z = tree.rotations(tree.absolute_angles(dense.orientation, dense.positions))
    body = np.array([shape.body for shape in shapes])
    ends = [
        com(record, dense.times)[:, None] + z @ tree.point_weights(body, np.array([getattr(s, end) for s in shapes])).T
        for end in ("start", "end")
    ]
    return *ends, np.array([shape.radius for shape in shapes])


def frame_place(robot, record, dense, name, index):
    tree, frame = robot.tree, robot.frames[name]
    z = tree.rotations(tree.absolute_angles(dense.orientation, dense.positions))
    weights = tree.point_weights(np.array([frame.body]), np.array([frame.local]))
    return (com(record, dense.times) + (z @ weights.T)[:, 0])[index]


def point_segment(point, start, end):
    along = end - start
    square = np.maximum(np.abs(along) ** 2, 1e-300)
    share = np.clip(((point - start) * along.conj()).real / square, 0.0, 1.0)
    return np.abs(point - start - share * along)


def segment_segment(a, b, c, d):
    nearest = np.minimum.reduce(
        [point_segment(a, c, d), point_segment(b, c, d), point_segment(c, a, b), point_segment(d, a, b)]
    )

    def side(p, u, v):
        return ((v - u).conj() * (p - u)).imag

    crossing = (side(a, c, d) * side(b, c, d) < 0) & (side(c, a, b) * side(d, a, b) < 0)
    return np.where(crossing, 0.0, nearest)


def clearance(robot, record, dense, obstacle):
    """Distance (N,) from the links' surfaces to an obstacle, infinite while it does not exist."""
    start, end, radius = segments(robot, record, dense)
    t = dense.times[:, None]
    shift = t * complex(*(obstacle.get("velocity") or (0.0, 0.0)))
    if obstacle["kind"] == "circle":
        distance = point_segment(complex(*obstacle["center"]) + shift, start, end) - obstacle["radius"]
    elif obstacle["kind"] == "capsule":
        c, d = complex(*obstacle["start"]) + shift, complex(*obstacle["end"]) + shift
        distance = segment_segment(start, end, c, d) - obstacle["radius"]
    else:
        normal = complex(*obstacle["normal"]) / abs(complex(*obstacle["normal"]))
        point = complex(*obstacle["point"]) + shift
        distance = np.minimum(*(((p - point) * normal.conjugate()).real for p in (start, end)))
    distance = (distance - radius).min(-1)
    if obstacle.get("window"):
        low, high = obstacle["window"]
        distance = np.where((dense.times >= low - 1e-12) & (dense.times <= high + 1e-12), distance, np.inf)
    return distance
