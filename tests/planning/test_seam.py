"""The seam between search and dynamics, :mod:`floatplan.motion.dynamics`, holds more than flight in a plane.

A second module stands behind it here: one rigid body in space that reaction wheels turn, e = 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from floatplan.motion.dynamics import MomentumSet, Partials
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.sine_polynomial import Form, SinePolynomials, boundary_arguments
from floatplan.planning.transcription.exchange import solve
from floatplan.planning.transcription.program import CoefficientNorm, FlightProgram, scaled
from floatplan.planning.transcription.trajectory import FlightModel, trajectory
from floatplan.planning.transcription.variables import DecisionVariables, whitened_variables

DURATION = 1.5
COUNTS = (16, 24, 32, 48, 64)
INERTIA = np.array([[2.0, 0.1, 0.0], [0.1, 1.5, -0.2], [0.0, -0.2, 1.0]])
WHEELS = 0.2 * np.eye(3)  # kg m^2, one per column
SWEEPS = 80


def cross(vectors):
    """Matrices (..., 3, 3) of cross products with vectors (..., 3)."""
    return np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2)


def quaternion_rates(quaternions, rates):
    """Derivatives (..., 4) of quaternions x, y, z, w for angular velocities (..., 3) in the body's frame."""
    vector, scalar = quaternions[..., :3], quaternions[..., 3:]
    turned = scalar * rates + np.cross(vector, rates)
    return 0.5 * np.concatenate((turned, -(vector * rates).sum(axis=-1, keepdims=True)), axis=-1)


@dataclass(frozen=True, eq=False)
class WheeledBody:
    """``omega = inertia^-1 (R^T h - wheels q')`` in the body's frame, and ``R' = R [omega]x`` from rest attitude."""

    goal: Rotation
    wheels: np.ndarray
    inertia: np.ndarray
    tangent: int = 3
    bodies: int = 1
    links: tuple[str, ...] = ()
    node_counts: tuple[int, ...] = COUNTS

    def grid(self, level):
        return gauss_grid(COUNTS[level])

    def fly(self, grid, joints, angular_momentum):
        return Turned(self, grid, joints, angular_momentum[None])


@dataclass(frozen=True, eq=False)
class Turned:
    """By collocation of quaternions at all nodes, swept until they rest; turns by the variational equation."""

    body: WheeledBody
    grid: object
    joints: object
    angular_momentum: np.ndarray

    def _rates(self, rotations, velocities):
        """omega (S, K, 3) in the body's frame at rotations (S, K, 3, 3) and velocities (S, K, n)."""
        momentum = np.einsum("skji,sj->ski", rotations, self.angular_momentum) - velocities @ self.body.wheels.T
        return momentum @ np.linalg.inv(self.body.inertia).T

    @cached_property
    def _quaternion_rates(self):
        count, motions = self.grid.nodes, len(self.angular_momentum)
        velocities = self.joints.velocities.reshape(motions, len(self.grid.s), -1)[:, :count]
        start = np.array([0.0, 0.0, 0.0, 1.0])
        quaternions = np.tile(start, (motions, count, 1))
        for _ in range(SWEEPS):
            rotations = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix().reshape(motions, count, 3, 3)
            rates = quaternion_rates(quaternions, self._rates(rotations, velocities))
            new = start + DURATION * self.grid.integrals[:count] @ rates
            change, quaternions = np.abs(new - quaternions).max(), new
            if change < 1e-14:
                break
        return rates

    def _rotations(self, quaternions):
        return Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()

    @cached_property
    def attitude(self):
        quaternions = np.array([0.0, 0.0, 0.0, 1.0]) + DURATION * self.grid.integrals @ self._quaternion_rates
        return self._rotations(quaternions)

    @cached_property
    def residual(self):
        ends = np.array([0.0, 0.0, 0.0, 1.0]) + DURATION * np.einsum(
            "k,skq->sq", self.grid.weights, self._quaternion_rates
        )
        return (Rotation.from_quat(ends) * self.body.goal.inv()).as_rotvec()[0]

    @cached_property
    def _mobility(self):
        """M (N, 3, 3) in the world's axes."""
        rotations = self.attitude[: self.grid.nodes]
        return rotations @ np.linalg.inv(self.body.inertia) @ rotations.swapaxes(1, 2)

    @property
    def drift(self):
        count = self.grid.nodes
        by_velocity = -self.attitude[:count] @ np.linalg.inv(self.body.inertia) @ self.body.wheels
        return Partials(by_position=np.zeros_like(by_velocity), by_velocity=by_velocity, by_momentum=self._mobility)

    @cached_property
    def _response(self):
        """zeta at the nodes by g there, (3 N, 3 N); and M [h]x (3 N, 3 N), block by block."""
        count = self.grid.nodes
        growth = np.zeros((count, 3, count, 3))
        growth[np.arange(count), :, np.arange(count), :] = self._mobility @ cross(self.angular_momentum[0])
        growth = growth.reshape(3 * count, 3 * count)
        integrals = DURATION * np.kron(self.grid.integrals[:count], np.eye(3))
        return np.linalg.solve(np.eye(3 * count) - integrals @ growth, integrals), growth

    def transport(self, drift):
        count = self.grid.nodes
        response, growth = self._response
        flat = drift.reshape(3 * count, -1)
        rates = (flat + growth @ (response @ flat)).reshape(drift.shape)
        return DURATION * np.einsum("kn,nec->kec", self.grid.integrals, rates)

    @property
    def residual_partials(self):
        drift = self.drift
        return Partials(
            by_position=self._carried @ drift.by_position,
            by_velocity=self._carried @ drift.by_velocity,
            by_momentum=self._carried @ drift.by_momentum,
        )

    @property
    def _carried(self):
        """What drifts at the nodes become by landing (N, 3, 3), in the residual."""
        count, weights = self.grid.nodes, self.grid.weights
        response, growth = self._response
        ends = np.kron(weights, np.eye(3)) @ (np.eye(3 * count) + growth @ response)
        per_node = ends.reshape(3, count, 3).swapaxes(0, 1) / weights[:, None, None]
        angle = np.linalg.norm(self.residual)
        turn = cross(self.residual)
        factor = (1 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2 if angle > 1e-6 else 1 / 12
        return (np.eye(3) - turn / 2 + factor * turn @ turn) @ per_node

    @property
    def unresolved(self):
        tail = np.abs(self.grid.quadrature.transform[-3:] @ self._quaternion_rates[0]).max()
        return float(tail / max(np.abs(self._quaternion_rates).max(), 1e-300))

    def level_needed(self, error):
        count = self.grid.nodes * math.log(error) / math.log(min(max(self.unresolved, 1e-16), 0.9))
        return next((level for level, nodes in enumerate(COUNTS) if nodes >= count), len(COUNTS) - 1)


def variables_of(wheels, momentum):
    """Wheels from rest to rest, by half a turn each; degree 9."""
    n = wheels.shape[1]
    centre, amplitude = np.zeros(n), np.full(n, 40.0)
    ends, still = np.stack((np.zeros(n), np.full(n, np.pi))), np.zeros((2, n))
    p, rate, curvature = boundary_arguments(ends, still, still, centre, amplitude, np.zeros((2, n), dtype=np.int64))
    boundary = np.array([p, DURATION * rate, DURATION**2 * curvature]).T.reshape(n, 6)
    polynomials = SinePolynomials(centre, amplitude, DURATION, boundary, (4,) * n)
    return DecisionVariables(polynomials, *whitened_variables(polynomials)[:2], momentum)


GIVEN = MomentumSet(np.array([0.3, -0.5, 0.8]), np.empty((3, 0)))
FREE = MomentumSet(np.array([0.3, -0.5, 0.8]), np.array([[1.0, 0.0], [0.0, 0.5], [0.2, 0.0]]))
GOAL = Rotation.from_rotvec([0.7, -0.6, 0.9])


@pytest.fixture(params=[GIVEN, FREE], ids=["h given", "h free"])
def flight(request):
    return FlightModel(WheeledBody(GOAL, WHEELS, INERTIA)), variables_of(WHEELS, request.param)


@pytest.fixture
def x(flight):
    return np.random.default_rng(0).normal(scale=0.3, size=flight[1].size)


def differences(values, x):
    """Derivatives (..., size) by central differences of the fourth order."""
    columns = []
    for step in 1e-3 * np.eye(len(x)):
        ahead, behind, far_ahead, far_behind = (values(x + n * step) for n in (1, -1, 2, -2))
        columns.append((8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * 1e-3))
    return np.stack(columns, axis=-1)


def independent_end(variables, x):
    """Attitude at landing by an integrator of its own."""
    polynomials = variables.polynomials
    h = variables.angular_momentum(x)
    b = polynomials.powers_of_seconds(variables.free_coefficients(x))
    powers = np.arange(1, b.shape[1])

    def rates(time, matrix):
        rotation = matrix.reshape(3, 3)
        p, p_rate = b @ time ** np.arange(b.shape[1]), b[:, 1:] @ (powers * time ** (powers - 1))
        omega = np.linalg.solve(INERTIA, rotation.T @ h - WHEELS @ (polynomials.amplitude * np.cos(p) * p_rate))
        return (rotation @ cross(omega)).ravel()

    end = solve_ivp(rates, (0, DURATION), np.eye(3).ravel(), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return Rotation.from_matrix(end.reshape(3, 3))


class TestDerivatives:
    def test_of_the_residual(self, flight, x):
        model, variables = flight
        nodes = model.nodes(3, variables.polynomials.form)
        jacobian = trajectory(model, variables, nodes, x).residual_jacobian
        expected = differences(lambda at: trajectory(model, variables, nodes, at).residual, x)
        assert np.abs(expected).max() > 0.01
        assert jacobian == pytest.approx(expected, abs=1e-8)

    def test_of_attitudes(self, flight, x):
        """A small turn zeta turns R to (1 + [zeta]x) R."""
        model, variables = flight
        nodes = model.nodes(4, variables.polynomials.form)
        motion = trajectory(model, variables, nodes, x)
        slopes = differences(lambda at: trajectory(model, variables, nodes, at).flown.attitude, x)
        expected = np.einsum("kijx,klj->kxil", slopes, motion.flown.attitude)
        assert cross(motion.attitude_jacobian.swapaxes(1, 2)) == pytest.approx(expected, abs=1e-8)


def test_search_turns_the_body_to_its_goal(flight):
    model, variables = flight
    drawn = np.random.default_rng(1).normal(scale=0.5, size=(40, variables.size))
    nodes = model.nodes(2, variables.polynomials.form)
    start = min(drawn, key=lambda x: np.linalg.norm(trajectory(model, variables, nodes, x).residual))
    norm = CoefficientNorm(variables.coefficients)
    solution = solve(model, variables, lambda nodes: norm, (), start)
    assert solution.status == "optimal"
    assert solution.evaluation.objective < norm.value(solution.evaluation.detail, start)
    missed = independent_end(variables, solution.x) * GOAL.inv()
    assert missed.magnitude() < 1e-8


class TestPlanarFlightInSpace:
    """Of a body that can turn about one axis alone."""

    @pytest.fixture
    def program(self):
        wheels, still = WHEELS[:, 2:], MomentumSet(np.zeros(3), np.empty((3, 0)))
        body = WheeledBody(Rotation.from_rotvec([0.0, 0.0, 0.8]), wheels, np.diag([2.0, 1.5, 1.0]))
        model, variables = FlightModel(body), variables_of(wheels, still)
        return FlightProgram(model, variables, model.nodes(2, Form(4)), CoefficientNorm(4))

    def test_has_one_equality(self, program):
        evaluation = scaled(program, np.zeros(4)).evaluate(np.zeros(4))
        assert evaluation.equality_jacobian.shape == (1, 4)
        assert program.evaluate(np.zeros(4)).equality_jacobian.shape == (3, 4)

    def test_keeps_a_turn_that_nothing_can_make(self, program):
        tilted = replace(program.model.flight, goal=Rotation.from_rotvec([0.3, 0.0, 0.8]))
        other = scaled(replace(program, model=FlightModel(tilted)), np.zeros(4))
        assert other.combinations.shape[0] > 1
