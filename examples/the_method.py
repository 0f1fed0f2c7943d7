"""The method, whole: a planner for a chain of links in flight, about as short as the paper that it comes from.

The chain has left the ground. Its centre of mass (CM) flies a parabola that nobody can change, and its angular momentum
h about the CM stays what it was. Motors turn the joints, q_1 to q_n. No motor turns the base, whose angle is theta0;
yet these n motors are to bring n+1 angles to a goal, all at one instant. They can, because the base answers to the
joints, and how far it turns depends on the way they take.

E. Papadopoulos, I. Fragkos and I. Tortopidis, "On Robot Gymnastics Planning with Non-zero Angular Momentum" (ICRA 2007)
say how. Numbers in brackets are their equations, with the corrections that docs/theory/paper.md lists. floatplan itself
is not needed here: it does the same for any robot in a plane, faster, and proves what it finds.

Units are SI and radians. The chain moves in the plane xz; positive angles turn x, horizontal, towards z, upwards. Run
as a script, this plans the paper's two examples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import pi
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.linalg import null_space
from scipy.optimize import NonlinearConstraint, minimize

Array = npt.NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
NORMAL = np.array([0.0, -1.0, 0.0])  # of the plane: what the base and all joints turn about
PLANE = [0, 2]  # x and z of three coordinates
gauss_legendre = lru_cache(np.polynomial.legendre.leggauss)  # nodes and weights over [-1, 1]


class Chain:
    """Links in a row, from a URDF file with the frames foot and hand at their ends.

    To Pinocchio the base is a body that floats. Momentum and torques are the same wherever it is and however it is
    turned, so it stays at the origin, at angle 0, and only its rate counts.
    """

    def __init__(self, urdf: Path) -> None:
        self.model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        self.model.gravity.setZero()  # what falls freely does not feel it
        self.data = self.model.createData()
        self.joints = self.model.nv - 6
        self.ends = [self.model.getFrameId(name) for name in ("foot", *list(self.model.names)[2:], "hand")]

    def inertias(self, q: Array) -> Array:
        """D_0, ..., D_n of (4), kg m^2: the momentum that a unit rate of theta0, q_1, ..., q_n makes on its own."""
        by_rate = NORMAL @ pin.computeCentroidalMap(self.model, self.data, _configuration(q))[3:]
        return np.array([by_rate[3:6] @ NORMAL, *by_rate[6:]])

    def momentum_by_q(self, q: Array, theta0_rate: float, rates: Array) -> Array:
        """Derivatives (n,) of the left side of (4) by q_1, ..., q_n at constant rates."""
        state = _configuration(q), _velocity(theta0_rate, rates), np.zeros(self.model.nv)
        by_position = pin.computeCentroidalDynamicsDerivatives(self.model, self.data, *state)[0]
        return np.asarray(NORMAL @ by_position[3:, 6:])

    def base_rate(self, q: Array, rates: Array, h: float) -> tuple[float, Array, Array]:
        """theta0' from (4): what (14) integrates, with the g_i of (15). And its derivatives by q and by the rates."""
        D = self.inertias(q)
        rate = float((h - D[1:] @ rates) / D[0])
        return rate, -self.momentum_by_q(q, rate, rates) / D[0], -D[1:] / D[0]

    def torques(self, q: Array, rates: Array, accelerations: Array, h: float) -> Array:
        """Torques (n,) of (A.1), N m: the rows of the base, which no motor drives, give its acceleration."""
        state = _configuration(q), _velocity(self.base_rate(q, rates, h)[0], rates)
        M = pin.crba(self.model, self.data, state[0])
        rest = M[:, 6:] @ accelerations + pin.nonLinearEffects(self.model, self.data, *state)
        return np.asarray(rest[6:] - M[6:, :6] @ np.linalg.solve(M[:6, :6], rest[:6]))

    def places(self, q: Array) -> tuple[Array, Array]:
        """Foot, joints and hand (n+2, 2) as seen from the CM at theta0 = 0, (20), and their derivatives (n+2, 2, n)."""
        cm_by_rate = pin.jacobianCenterOfMass(self.model, self.data, _configuration(q))
        pin.computeJointJacobians(self.model, self.data, _configuration(q))
        pin.updateFramePlacements(self.model, self.data)
        axes = pin.LOCAL_WORLD_ALIGNED
        by_rate = [pin.getFrameJacobian(self.model, self.data, end, axes)[:3] - cm_by_rate for end in self.ends]
        places = [self.data.oMf[end].translation - self.data.com[0] for end in self.ends]
        return np.array(places)[:, PLANE], np.array(by_rate)[:, PLANE, 6:]


def _configuration(q: Array) -> Array:
    return np.concatenate(([0, 0, 0, 0, 0, 0, 1], q))


def _velocity(theta0_rate: float, rates: Array) -> Array:
    return np.concatenate((np.zeros(3), theta0_rate * NORMAL, rates))


@dataclass(frozen=True)
class Posture:
    """The chain at one end of the flight: its angles, and the rates and accelerations of its joints."""

    theta0: float
    q: Array
    rates: Array | float = 0.0
    accelerations: Array | float = 0.0


@dataclass(frozen=True)
class Flight:
    """What is asked: from start to goal in ``duration``, s, with momentum h; past a circle if that has a radius.

    The foot leaves the ground at the origin; foot (``landing`` 0) or hand (-1) comes down at height 0.
    """

    chain: Chain
    start: Posture
    goal: Posture
    duration: float
    h: float
    degree: int = 7
    landing: int = -1
    speed: float = 0.0  # m/s, horizontal, of the CM
    center: tuple[float, float] = (0.0, 0.0)  # m
    radius: float = 0.0  # m
    nodes: int = 32  # of quadrature; plan() doubles them where they are too few


def extreme(chain: Chain, i: int, sign: int) -> float:
    """Least (sign 1) or largest (sign -1) D_i of all joint angles, by descents from the best of many random ones."""
    theta0_rate, *rates = np.eye(chain.joints + 1)[i]

    def value(q: Array) -> tuple[float, Array]:
        return sign * float(chain.inertias(q)[i]), sign * chain.momentum_by_q(q, theta0_rate, np.array(rates))

    drawn = np.random.default_rng(0).uniform(-pi, pi, (300, chain.joints))
    promising = sorted(drawn, key=lambda q: value(q)[0])[:4]
    return sign * min(float(minimize(value, q, jac=True).fun) for q in promising)


def suitable_momentum(chain: Chain, start: Posture, goal: Posture, duration: float) -> float:
    """The h of (10), kg m^2/s: the middle of (9), where h lies if no angle turns back on its way."""
    changes = [goal.theta0 - start.theta0, *(goal.q - start.q)]
    bounds = [change * extreme(chain, i, sign) for i, change in enumerate(changes) for sign in (1, -1)]  # (7), (8)
    return float(sum(bounds) / 2 / duration)


def powers(t: float, degree: int) -> Array:
    """1, t, ..., t^k and their first and second derivatives by t: (3, k+1)."""
    k = np.arange(degree + 1)
    return np.array([t**k, k * t ** np.maximum(k - 1, 0), k * (k - 1) * t ** np.maximum(k - 2, 0)])


def joint_motion(b: Array, t: float) -> tuple[Array, Array, Array]:
    """q, q', q'' (n,) at time t of the sine polynomials (12). Whatever b (n, k+1), no joint leaves [-pi, pi]."""
    p, p1, p2 = powers(t, b.shape[1] - 1) @ b.T
    return pi * np.sin(p), pi * np.cos(p) * p1, pi * (np.cos(p) * p2 - np.sin(p) * p1**2)


def arguments(end: Posture, branch: Array) -> Array:
    """p, p', p'' (3, n) for which (12) meets (13) at one end. Each branch of the arcsine has a p."""
    p = pi * branch + np.cos(pi * branch) * np.arcsin(end.q / pi)
    p1 = end.rates / (pi * np.cos(p))
    return np.array([p, p1, end.accelerations / (pi * np.cos(p)) + np.tan(p) * p1**2])


def motions_between(flight: Flight, branch: Array) -> tuple[Array, Array]:
    """All b that meet (13): b = b0 + z N^T for any z (n, k-5). Returns b0 (n, k+1) and N (k+1, k-5).

    In the arguments p, (13) is six linear equations for the b of each joint. b0 is their shortest solution, and the
    columns of N are orthonormal and orthogonal to it, so that |b|^2 = |b0|^2 + |z|^2.
    """
    equations = np.concatenate((powers(0.0, flight.degree), powers(flight.duration, flight.degree)))
    wanted = np.concatenate((arguments(flight.start, 0 * branch), arguments(flight.goal, branch)))
    return (np.linalg.pinv(equations) @ wanted).T, null_space(equations)


def base_turn(flight: Flight, b: Array, until: float) -> tuple[float, Array]:
    """By how much the base has turned at time ``until``, (18), and the derivatives (n, k+1) of that by b."""
    turn, by_b = 0.0, np.zeros(b.shape)
    nodes, weights = gauss_legendre(flight.nodes)
    for t, dt in zip((nodes + 1) / 2 * until, weights / 2 * until, strict=True):
        value, slope, _ = powers(t, flight.degree)
        p, p1 = b @ value, b @ slope
        q, q_by_p = pi * np.sin(p), pi * np.cos(p)
        rate, by_q, by_rates = flight.chain.base_rate(q, q_by_p * p1, flight.h)
        turn += dt * rate
        by_b += dt * np.outer(by_q * q_by_p - by_rates * q * p1, value)  # q' = q_by_p p', and q_by_p changes by -q
        by_b += dt * np.outer(by_rates * q_by_p, slope)
    return turn, by_b


def missed(flight: Flight, b: Array) -> tuple[Array, Array]:
    """By how much (14) fails (1,), and the derivatives (1, n, k+1) of that by b."""
    turn, by_b = base_turn(flight, b, flight.duration)
    return np.array([turn - (flight.goal.theta0 - flight.start.theta0)]), by_b[None]


def turned(theta0: float) -> Array:
    """R_Z of (20), in the plane."""
    return np.array([[np.cos(theta0), -np.sin(theta0)], [np.sin(theta0), np.cos(theta0)]])


def flight_of_cm(flight: Flight) -> Callable[[float], Array]:
    """The CM (2,) at a time t: (2) and (3) integrated, between its places above the foot and above what lands, (6)."""
    ends = ((flight.start, 0), (flight.goal, flight.landing))
    first, last = (turned(end.theta0) @ -flight.chain.places(end.q)[0][contact] for end, contact in ends)
    velocity = np.array([flight.speed, (last - first)[1] / flight.duration + GRAVITY * flight.duration / 2])
    return lambda t: np.asarray(first + velocity * t - [0.0, GRAVITY * t**2 / 2])


def clearances(flight: Flight, t: float, b: Array) -> tuple[Array, Array]:
    """Distances (n+1,) of the links from the circle at time t, (23), and their derivatives (n+1, n, k+1) by b.

    An eye that moves with the CM and turns with the base sees the circle's centre move. The u of (22) that is nearest
    to it is known, so u needs no grid; and there a small change of u changes no distance.
    """
    turn, turn_by_b = base_turn(flight, b, t)
    value = powers(t, flight.degree)[0]
    places, places_by_q = flight.chain.places(pi * np.sin(b @ value))
    center = turned(flight.start.theta0 + turn).T @ (flight.center - flight_of_cm(flight)(t))
    begin, link = places[:-1], np.diff(places, axis=0)
    u = np.clip(((center - begin) * link).sum(axis=1) / (link**2).sum(axis=1), 0, 1)
    away = begin + u[:, None] * link - center
    distance = np.linalg.norm(away, axis=1)
    point_by_q = places_by_q[:-1] + u[:, None, None] * np.diff(places_by_q, axis=0)
    by_p = np.einsum("ld,ldj->lj", away, point_by_q) / distance[:, None] * pi * np.cos(b @ value)
    by_turn = away @ [-center[1], center[0]] / distance
    return distance - flight.radius, by_p[:, :, None] * value + by_turn[:, None, None] * turn_by_b


def least(flight: Flight, b0: Array, N: Array, b: Array, watched: list[float]) -> Array:
    """The b of least norm, (17), with (14), and with (23) at the times watched: where a search from ``b`` ends."""

    def b_of(z: Array) -> Array:
        return b0 + z.reshape(len(b0), -1) @ N.T

    def half_square(z: Array) -> tuple[float, Array]:
        return float(z @ z) / 2, z

    def constraint(rows: Callable[[Array], tuple[Array, Array]], most: float) -> NonlinearConstraint:
        return NonlinearConstraint(
            lambda z: rows(b_of(z))[0], 0.0, most, lambda z: (rows(b_of(z))[1] @ N).reshape(-1, z.size)
        )

    asked = [constraint(partial(missed, flight), 0.0)]
    asked += [constraint(partial(clearances, flight, t), np.inf) for t in watched]
    return b_of(minimize(half_square, (b @ N).ravel(), jac=True, method="SLSQP", constraints=asked, tol=1e-11).x)


def plan(flight: Flight) -> Array | None:
    """The b (n, k+1) of the first motion found, on one branch of the arcsine after another; None where none is found.

    (23) must hold at infinitely many times. Those where it fails worst are watched, one more each round.
    """
    times = np.linspace(0, flight.duration, 101)
    for branch in (np.zeros(flight.chain.joints), *np.eye(flight.chain.joints), *-np.eye(flight.chain.joints)):
        b, N = motions_between(flight, branch)
        b0, watched = b, list[float]()
        while len(watched) < 20:
            b = least(flight, b0, N, b, watched)
            if abs(missed(flight, b)[0]) > 1e-9:
                break
            nearest = [float(clearances(flight, t, b)[0].min()) for t in times] if flight.radius else [0.0]
            if min(nearest) > -1e-6:
                finer = replace(flight, nodes=2 * flight.nodes)
                if abs(missed(finer, b)[0]) < 1e-9:
                    return b
                return plan(finer) if finer.nodes <= 1024 else None
            watched.append(float(times[np.argmin(nearest)]))
    return None


def tell(name: str, flight: Flight) -> None:
    """Plan, and print what came of it."""
    b = plan(flight)
    if b is None:
        print(f"{name}: no motion found")
        return
    instants = np.linspace(0, flight.duration, 201)
    torques = np.abs([flight.chain.torques(*joint_motion(b, t), flight.h) for t in instants]).max(axis=0)
    print(f"{name}, h = {flight.h:.4f} kg m^2/s: |b| = {np.linalg.norm(b):.6f}, torques reach {torques.round(3)} N m")


def posture(*degrees: float) -> Posture:
    """At rest, from theta0, q_1, ..., q_n in degrees."""
    theta0, *q = np.radians(degrees)
    return Posture(float(theta0), np.array(q))


def main() -> None:
    """Plan the paper's examples: into a new configuration (A), and past an obstacle (B)."""
    chain = Chain(Path(__file__).resolve().parents[1] / "urdf" / "gymnast.urdf")  # Table I
    start, goal = posture(108.97, -108.97, 90), posture(20, 70, 56.73)
    tell("example A", Flight(chain, start, goal, 1.1, h=0.13, landing=0))  # the paper's h; (10) gives 0.0941

    start, goal = posture(72, 18, -45), posture(-90, 0, 0)
    h = suitable_momentum(chain, start, goal, 1.4)
    tell("example B", Flight(chain, start, goal, 1.4, h, speed=2.0, center=(1.485, 3.342), radius=0.2 + 0.02))


if __name__ == "__main__":
    main()
