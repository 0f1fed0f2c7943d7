"""Flights in space planned by IPOPT, by way of CasADi: direct collocation of quaternion and joints, for the benchmark.

States are the base's quaternion, the joints' positions and rates, controls their accelerations; the base's angular
velocity follows from the angular momentum and the whole robot's inertia, as functions of CasADi. Joints stay in their
ranges, begin and end at rest, and the integral of squared accelerations is least. The guess turns the base evenly.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.spatial.rotations import of_angles
from floatplan.problem.attitude import required

CELLS, DEGREE = 16, 4
MOST_SECONDS = 60.0
BASE = 6


def turning_rate(robot: fp.Robot) -> ca.Function:
    """Return omega (3,) of positions and velocities (n,), a quaternion x, y, z, w, and h (3,)."""
    model, n = robot.model, len(robot.joints)
    positions, velocities, quaternion, h = (ca.SX.sym(*each) for each in (("p", n), ("v", n), ("r", 4), ("h", 3)))
    selection = ca.DM(robot.selection[BASE:])
    q, speed = ca.DM(robot.reference[BASE + 1 :]) + selection @ positions, selection @ velocities
    turned, place = {1: ca.SX.eye(3)}, {1: ca.SX.zeros(3)}
    swing, moved = {1: ca.SX.zeros(3)}, {1: ca.SX.zeros(3)}
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for joint in range(2, model.njoints):
        before, at, index = model.parents[joint], model.jointPlacements[joint], joint - 2
        axis = np.ravel(data.joints[joint].S)[3:]  # of joints that turn: the benchmark's robots have no others
        across = ca.DM(pin.skew(axis))
        turn = ca.DM.eye(3) + ca.sin(q[index]) * across + (1 - ca.cos(q[index])) * (across @ across)
        place[joint] = place[before] + turned[before] @ ca.DM(at.translation)
        turned[joint] = turned[before] @ ca.DM(at.rotation) @ turn
        swing[joint] = swing[before] + speed[index] * (turned[joint] @ ca.DM(axis))
        moved[joint] = moved[before] + ca.cross(swing[before], place[joint] - place[before])
    bodies = [(joint, model.inertias[joint]) for joint in range(1, model.njoints)]
    centers = {joint: place[joint] + turned[joint] @ ca.DM(body.lever) for joint, body in bodies}
    center = sum(body.mass * centers[joint] for joint, body in bodies) / sum(body.mass for _, body in bodies)
    inertia, momentum = ca.SX.zeros(3, 3), ca.SX.zeros(3)
    for joint, body in bodies:
        own, arm = turned[joint] @ ca.DM(body.inertia) @ turned[joint].T, centers[joint] - center
        velocity = moved[joint] + ca.cross(swing[joint], centers[joint] - place[joint])
        inertia += own + body.mass * (ca.dot(arm, arm) * ca.SX.eye(3) - arm @ arm.T)
        momentum += own @ swing[joint] + body.mass * ca.cross(arm, velocity)
    x, w = quaternion[:3], quaternion[3]
    seen = h + 2 * ca.cross(x, ca.cross(x, h) - w * h)  # h in the base's axes
    return ca.Function("omega", [positions, velocities, quaternion, h], [ca.solve(inertia, seen - momentum)])


def solve(problem: fp.Problem) -> tuple[bool, float]:
    """Whether a problem with given h is solved, and the seconds of the processor in IPOPT, functions made before."""
    robot, n, duration = problem.robot, len(problem.robot.joints), problem.flight.duration
    h, omega = ca.DM(flight_of(problem).momentum_set.centre), turning_rate(robot)
    state, control = ca.SX.sym("x", 4 + 2 * n), ca.SX.sym("u", n)
    quaternion, positions, velocities = state[:4], state[4 : 4 + n], state[4 + n :]
    rate = omega(positions, velocities, quaternion, h)
    vector, w = quaternion[:3], quaternion[3]
    spin = ca.vertcat(w * rate + ca.cross(vector, rate), -ca.dot(vector, rate)) / 2
    slope = ca.Function("slope", [state, control], [ca.vertcat(spin, velocities, control)])

    roots = ca.collocation_points(DEGREE, "legendre")
    derivative, at_end, _ = ca.collocation_coeff(roots)
    step = duration / CELLS
    way = guessed(problem, np.linspace(0, 1, CELLS + 1))
    low, high = problem.position_limits.T
    bounds_low = np.concatenate((np.full(4, -1.1), low, np.full(n, -np.inf)))
    bounds_high = np.concatenate((np.full(4, 1.1), high, np.full(n, np.inf)))
    variables: list[Any] = []
    guess, lower, upper, equations, cost = [], [], [], [], ca.MX(0)

    def variable(name: str, first: Any, least: Any, most: Any) -> ca.MX:
        made = ca.MX.sym(name, len(first))
        variables.append(made)
        guess.append(first)
        lower.append(least)
        upper.append(most)
        return made

    x = variable("x", way[0], way[0], way[0])
    for cell in range(CELLS):
        u = variable("u", np.zeros(n), np.full(n, -np.inf), np.full(n, np.inf))
        inner = [variable("c", way[cell], bounds_low, bounds_high) for _ in range(DEGREE)]
        stages = ca.horzcat(x, *inner)
        slopes = ca.horzcat(*(slope(each, u) for each in inner))
        equations.append(ca.vec(stages @ derivative - step * slopes))
        cost += step * ca.sumsqr(u) / n
        ends = stages @ at_end
        last = cell == CELLS - 1
        x = variable("x", way[cell + 1], way[-1] if last else bounds_low, way[-1] if last else bounds_high)
        largest = int(np.argmax(np.abs(way[-1][:4])))  # three numbers of a unit quaternion say where it points
        equations.append((ends - x)[[row for row in range(4 + 2 * n) if not last or row != largest]])
    program = {"x": ca.vertcat(*variables), "f": cost, "g": ca.vertcat(*equations)}
    options: dict[str, Any] = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-6}
    options |= {"ipopt.max_cpu_time": MOST_SECONDS, "ipopt.max_iter": 2000}
    solver = ca.nlpsol("solver", "ipopt", program, options)
    joined = [np.concatenate(each) for each in (guess, lower, upper)]
    began = time.process_time()
    solver(x0=joined[0], lbx=joined[1], ubx=joined[2], lbg=0, ubg=0)
    return bool(solver.stats()["success"]), time.process_time() - began


def guessed(problem: fp.Problem, s: np.ndarray) -> np.ndarray:
    """States (K, 4 + 2 n) at instants (K,) of [0, 1]: the base turns evenly, as often as is asked."""
    start, goal = required(problem.initial.attitude), required(problem.final.attitude)
    if goal.axes is None:
        turn = Rotation.from_matrix(goal.matrix @ start.matrix.T).as_rotvec()
        attitudes = Rotation.from_rotvec(s[:, None] * turn) * Rotation.from_matrix(start.matrix)
    else:
        first = start.angles_about(goal.axes)
        attitudes = Rotation.from_matrix(of_angles(goal.axes, first + s[:, None] * (np.array(goal.angles) - first)))
    quaternions = attitudes.as_quat()
    quaternions[1:] *= np.cumprod(np.sign((quaternions[1:] * quaternions[:-1]).sum(axis=1)))[:, None]
    first, last = (np.array(state.positions) for state in (problem.initial, problem.final))
    positions = first + s[:, None] * (last - first)
    return np.concatenate((quaternions, positions, np.zeros_like(positions)), axis=1)
