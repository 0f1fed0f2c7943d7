"""What an update is to compute, written a second time: the filter's equations, and a step by finite differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from sampled_flight import PlanarBaseMotion

import floatplan as fp
from floatplan.arrays import Array, IntArray
from floatplan.inflight import estimate, update
from floatplan.inflight.prediction import LimitRows, Views
from floatplan.inflight.remaining_motion import RemainingMotion
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.planar.clearance import Segments, obstacle_distances, pair_distances
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight
from floatplan.motion.sine_polynomial import SinePolynomials
from floatplan.planning.kernel_input.rows import DistanceRows
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Shares


def filtered(replanner: fp.Replanner, t: float, orientation: float, rate: float, *joints: Array) -> tuple[Array, Array]:
    """Return state and covariance after a measurement, a Kalman filter's of ``h = D . (theta0', q')``, D by masses.

    The joints' positions and velocities (n,) are those measured. The motion is one since the last measurement.
    """
    inertial, began, tree = replanner._estimate.inertial, replanner._estimate.time, replanner.plan.robot.tree
    dynamics = estimate.adapted(tree, inertial.state[2:])
    state, bodies, nodes = (
        inertial.state.copy(),
        len(replanner.plan.robot.tree.mass),
        np.polynomial.legendre.leggauss(40),
    )
    times = began + (t - began) * (nodes[0] + 1) / 2
    positions, velocities, _ = replanner.motion.at(times)
    state[0] += (t - began) / 2 * (nodes[1] @ dynamics.base_rate(positions, velocities, state[1]))
    (here,), (there,), _ = replanner.motion.at(t)
    inertia = dynamics.momentum_map(here[None])[0]
    maps = [estimate.adapted(tree, errors) for errors in np.vstack((np.zeros(2 * bodies), np.eye(2 * bodies)))]

    def momenta(positions: Array, velocities: Array, rate: float) -> Array:
        """Of the plan's masses, then of each of them doubled."""
        return np.array([dynamics.momentum_map(positions[None])[0] @ np.append(rate, velocities) for dynamics in maps])

    expected = momenta(here, there, (state[1] - inertia[1:] @ there) / inertia[0])
    row = np.concatenate(([0.0, 1.0], expected[0] - expected[1:]))
    dt, noise = t - began, float(inertia @ inertia)
    turn = np.eye(len(state))
    turn[0] += row * dt / inertia[0]
    covariance = turn @ (inertial.covariance + dt * np.diag(inertial.wander)) @ turn.T
    aside = inertia[1:] @ (joints[0] - here) / inertia[0]
    angle = np.eye(len(state))[0]
    for h, value, variance in (
        (angle, orientation + aside, replanner._update.gains.angle_noise**2 * noise / inertia[0] ** 2),
        (row, momenta(joints[0], joints[1], rate)[0], replanner._update.gains.rate_noise**2 * noise),
    ):
        gain = covariance @ h / (h @ covariance @ h + variance)
        state += gain * (value - h @ state)
        covariance = covariance - np.outer(gain, h @ covariance)
    state[2:] = np.clip(state[2:], -replanner._update.gains.largest_error, replanner._update.gains.largest_error)
    return state, covariance


def step(replanner: fp.Replanner, begun: Reference, sigma: float, acceleration: float, landed: bool) -> Array:
    """Return the first Gauss-Newton step y (m, n) of the law from a motion on, its derivatives by central differences.

    With ``landed``, distances are those of a base that turns to the goal: the miss is taken off, by time.
    """
    motion, views = begun.motion, replanner.views
    shape = (len(motion.coefficients) - CONDITIONS, len(motion.amplitude))

    def looked_at(y: Array) -> Reference:
        coefficients = motion.coefficients.copy()
        coefficients[CONDITIONS:] += views.whitening @ y.reshape(shape) / motion.amplitude
        kind = Landed if landed else Reference
        return kind(views, replace(motion, coefficients=coefficients), begun.present)

    size, difference = shape[0] * shape[1], 1e-6
    ends = [[looked_at(sign * difference * unit) for sign in (1, -1)] for unit in np.eye(size)]

    def slopes(value: Callable[[Reference], Array]) -> Array:
        return np.array([(value(ahead) - value(back)) / (2 * difference) for ahead, back in ends]).T

    now = looked_at(np.zeros(size))
    tolerance = max(sigma, abs(now.miss) / replanner._update.gains.weighed) if views.rows else sigma
    jacobian, residual = [slopes(lambda each: np.array([each.miss]))], [np.array([now.miss])]
    scale = [np.array([tolerance])]
    for index, (block, values) in enumerate(zip(views.rows, now.values, strict=True)):
        worst = np.argsort(values, axis=None)[: min(replanner._update.gains.most_rows, int((values < block.aim).sum()))]
        residual.append(values.ravel()[worst] - block.aim)
        jacobian.append(slopes(partial(_chosen, index, worst)))
        scale.append(np.full(len(worst), block.softness))
    weighed = np.concatenate(jacobian) / np.concatenate(scale)[:, None]
    stiffness = 1 / (acceleration * motion.remaining**2) ** 2
    hessian = weighed.T @ weighed + stiffness * np.eye(size)
    y = -np.linalg.solve(hessian, weighed.T @ (np.concatenate(residual) / np.concatenate(scale)))
    return np.asarray(y.reshape(shape))


def _chosen(block: int, chosen: IntArray, prediction: Reference) -> Array:
    return np.asarray(prediction.values[block].ravel()[chosen])


@dataclass(eq=False)
class Present:
    """The robot at a time, s since takeoff: orientation rad, h kg m^2/s, path of the CM from then on, its dynamics."""

    time: float
    orientation: float
    angular_momentum: float
    com: Ballistics
    dynamics: Dynamics

    @classmethod
    def of(cls, replanner: fp.Replanner, now: float) -> Present:
        """As a replanner knows it, not before the last measurement."""
        known = replanner._estimate
        path = Ballistics(*known.com_at(now), known.gravity)
        orientation = known.inertial.orientation + replanner._update.turned
        dynamics = estimate.adapted(replanner.plan.robot.tree, known.inertial.state[2:])
        return cls(now, orientation, known.inertial.angular_momentum, path, dynamics)


class Reference:
    """The rest of a flight under a motion, in NumPy."""

    landed = False

    def __init__(self, views: Views, motion: RemainingMotion, present: Present) -> None:
        self._views, self.motion, self.present = views, motion, present
        self._instants: GaussGrid = views.between(motion.begin, motion.end)
        goal = views.flight.final_orientation
        self._flight: PlanarFlight = replace(
            views.flight,
            other_equations=present.dynamics,
            ballistics=present.com,
            initial_orientation=present.orientation,
            duration=motion.remaining,
            change=goal - present.orientation,
        )
        values = views.functions.values(self._instants.s)
        width, joint_count = motion.coefficients[CONDITIONS:].shape
        polynomials = SinePolynomials(
            centre=motion.centre,
            amplitude=motion.amplitude,
            duration=motion.remaining,
            boundary=motion.coefficients[:CONDITIONS].T,
            free=(width,) * joint_count,
        )
        joints = polynomials.motion(motion.coefficients[CONDITIONS:].T, values)
        momentum = np.array([present.angular_momentum])
        self.flown = PlanarBaseMotion(self._flight, self._instants, joints, momentum)
        self.miss = float(self.flown.residual[0])
        self.torque_peak = np.abs(self.flown.motor_torques).max(axis=0)

    @property
    def watched(self) -> Array:
        """Times (W,), s since takeoff, at which distances are looked at."""
        return self.motion.begin + self.motion.remaining * self._instants.s[self._instants.nodes :]

    @cached_property
    def shapes(self) -> Segments:
        """The links' shapes at these."""
        motion, flight = self.motion, self._flight
        joints, share = motion.at(self.watched)[0], (self.watched - motion.begin) / motion.remaining
        grid = self._instants
        turned = motion.remaining * (grid.integrals[grid.nodes :] @ self.flown.node_rates)
        turned -= self.landed * self.miss * share
        com = flight.ballistics.positions(self.watched - motion.begin)
        angles = flight.tree.absolute_angles(flight.initial_orientation + turned, joints)
        return flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], angles)

    @cached_property
    def values(self) -> list[Array]:
        """Values (K, r) or (W, r) of each block of rows."""
        return list(map(self._values, self._views.rows))

    @property
    def worst(self) -> Array:
        """Least value of each block."""
        return np.array([values.min() for values in self.values])

    def _values(self, rows: LimitRows) -> Array:
        block, times = rows.block, self.watched
        if isinstance(block, Shares):
            return np.asarray(1 - np.abs(self._sum(block.used)) - np.abs(self._sum(block.also)))
        assert isinstance(block, DistanceRows), "the blocks that there are"
        if isinstance(block.between, Obstacle):
            pieces = [obstacle_distances(self.shapes, piece, times) for piece in block.between.pieces]
            distances = np.concatenate(pieces, axis=1)
        else:
            first, second = map(np.array, block.between)
            distances = pair_distances(self.shapes.of(first), self.shapes.of(second))
        values = (distances - block.least) / block.scale
        low, high = rows.window
        values[(times < low - update.ROUNDING) | (times > high + update.ROUNDING)] = np.inf
        return np.asarray(values)

    def _sum(self, weighted: Mapping[str, Array]) -> Array:
        flown, joints = self.flown, self.flown.joints
        quantities = {
            "velocities": joints.velocities,
            "accelerations": joints.accelerations,
            "torques": flown.torques,
            "motor_torques": flown.motor_torques,
            "orientation_rate": flown.rate,
        }
        return np.asarray(sum((quantities[name] @ weights.T for name, weights in weighted.items()), np.zeros(1)))


class Landed(Reference):
    """One whose distances are those of a base that turns to the goal."""

    landed = True
