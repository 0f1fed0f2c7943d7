"""CasADi expressions of a planar robot: positions of its points, and inverse dynamics with contact forces.

The coordinates are y = (theta_0, q): orientation of the base and planned joints, rad; the base's position follows from
the point that does not move, or from the centre of mass. With the rotations e_k = exp(i sigma phi_k) of the bodies a
point is at ``sum_k W_k e_k`` from a reference point, W from :meth:`floatplan.robot.PlanarTree.point_weights`. Positions
are pairs (horizontal, vertical). Virtual work with body k's angle gives

``Q_k = sum_b m_b <i sigma W_bk e_k, c_b'' + i g> + I_k phi_k'' - sum_f <i sigma W_fk e_k + rho_fk, F_f>``,

W from the base's origin, c_b the bodies' centres, F_f forces at points f. Motors' torques are ``motor_turns^T Q``,
and ``sum_k Q_k = 0`` is the balance of moments about the base's origin. The inertia of rotors is part of Q.

A foot's circle of radius r about the point C of body b rolls on level ground where ``C' = -sigma r phi_b'``: then
``C + sigma r phi_b = sum_k W_k e_k + rho_k phi_k``, with ``rho_b = sigma r``, does not move, as C does not for a foot
that is a point, r = 0. Its derivatives by the angles are those of the point of the foot that is on the ground,
``P = C - i r``, where the force acts: one form for positions, rates, closures and moments. P itself moves as C does,
and the angular momentum about it by ``L' = -sigma m (g (c - P)_x + P_x' c_z')``, c the centre of mass.
"""

import os
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import import_optional
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.phases import Phase
from floatplan.robot import Robot
from floatplan.robot.standing import Spot, spot_weights
from floatplan.tables import GRAVITY

Pair: TypeAlias = tuple[Any, Any]  # horizontal and vertical component, CasADi expressions


def casadi() -> Any:
    """The module CasADi, with its solver loaded.

    Raises
    ------
    InputError
        It is not installed.
    """
    module = import_optional("casadi", name="CasADi", element="jump", extra="jump")
    _load_solver(module)
    return module


@lru_cache(maxsize=1)
def _load_solver(module: Any) -> None:
    """Load IPOPT with one thread for its BLAS: shared sums have other last bits, and processes would find other jumps.

    That BLAS is a library of CasADi's own, which :func:`~floatplan.pool.one_thread` does not reach.
    """
    name = "OPENBLAS_NUM_THREADS"  # which it reads where it is loaded, and never again
    before = os.environ.get(name)
    os.environ[name] = "1"
    try:
        module.load_nlpsol("ipopt")
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


class PlanarModel:
    """Symbols of a robot's coordinates with their derivatives, and expressions of them.

    Attributes
    ----------
    robot : Robot
    gravity : m/s^2
    y, v, a : (n+1,) orientation and joints, rad, and their derivatives, rad/s, rad/s^2
    """

    def __init__(self, robot: Robot, gravity: float = GRAVITY) -> None:
        self.robot = robot
        self.gravity = gravity
        sx = casadi().SX
        size = 1 + len(robot.joints)
        self.y = sx.sym("y", size)
        self.v = sx.sym("v", size)
        self.a = sx.sym("a", size)
        rates = np.column_stack((np.ones(len(robot.tree.mass)), robot.tree.turns))
        _, first, same = np.unique(np.column_stack((rates, robot.tree.offsets)), True, True, axis=0)
        self._leading = first.tolist()  # bodies of which no two rotate alike
        self._alike = same.ravel()  # of each body the index among these of the one that rotates as it does
        self._rates = sx(rates)  # of bodies' angles, by y
        self._sigma = robot.tree.turn  # sign of angles: 1, or -1 where they are clockwise

    @cached_property
    def angles(self) -> tuple[Any, Any, Any]:
        """Angles phi of the bodies, phi' and phi''."""
        ca = casadi()
        phi = ca.mtimes(self._rates, self.y) + self.robot.tree.offsets
        return phi, ca.mtimes(self._rates, self.v), ca.mtimes(self._rates, self.a)

    @cached_property
    def rotations(self) -> tuple[Pair, Pair, Pair]:
        """Rotations e of the bodies, e' and e''."""
        ca = casadi()
        phi = self.angles[0]
        rate = self._sigma * self.angles[1]
        acceleration = self._sigma * self.angles[2]
        c = ca.cos(phi)
        s = self._sigma * ca.sin(phi)
        first = (-rate * s, rate * c)
        return (c, s), first, (-acceleration * s - rate * first[1], acceleration * c + rate * first[0])

    def weights(self, spots: Sequence[Spot], reference: Spot | None = None) -> ComplexArray:
        """Weights (points, 2 m) of positions relative to a reference; to the centre of mass where there is none."""
        weights = spot_weights(self.robot, spots)
        return weights if reference is None else weights - self.weights([reference])

    @cached_property
    def centers(self) -> list[Spot]:
        """Centres of mass of the bodies."""
        return [Spot(body, complex(center)) for body, center in enumerate(self.robot.tree.center)]

    def positions(self, weights: ComplexArray, derivative: int = 0) -> Pair:
        """Positions (points,) m of weights (points, 2 m), or their first or second derivatives."""
        ca = casadi()
        rotated, rolled = np.split(weights, 2, axis=1)
        rotated = self._summed(rotated)
        rolled = self._summed(rolled)
        real = self.constant(rotated.real)
        imaginary = self.constant(rotated.imag)
        c, s = self.rotations[derivative]
        c = c[self._leading]
        s = s[self._leading]
        angles = self.angles[derivative][self._leading]
        x = ca.mtimes(self.constant(rolled.real), angles)
        z = ca.mtimes(self.constant(rolled.imag), angles)
        return x + ca.mtimes(real, c) - ca.mtimes(imaginary, s), z + ca.mtimes(imaginary, c) + ca.mtimes(real, s)

    def _summed(self, weights: ComplexArray) -> ComplexArray:
        """Weights (.., m) of all bodies, summed over those that rotate alike, in the order of the leading ones."""
        return np.asarray(weights @ (self._alike[:, None] == np.arange(len(self._leading))))

    def _relative_rotations(self, derivative: int) -> Pair:
        """Derivatives of the leading bodies' rotations as each of them sees them, ``conj(e_k) e_l'`` at (k, l).

        They depend on the angle between two bodies alone, so that they have far fewer second derivatives than what is
        rotated into the plane and back.
        """
        ca = casadi()
        count = len(self._leading)
        phi, rate, acceleration = (angles[self._leading] for angles in self.angles)
        difference = ca.repmat(phi.T, count, 1) - ca.repmat(phi, 1, count)
        c = ca.cos(difference)
        s = self._sigma * ca.sin(difference)
        rate = self._sigma * ca.repmat(rate.T, count, 1)
        if derivative == 1:
            return -rate * s, rate * c
        acceleration = self._sigma * ca.repmat(acceleration.T, count, 1)
        return -acceleration * s - rate**2 * c, acceleration * c - rate**2 * s

    def constant(self, values: Any) -> Any:
        """A sparse constant, in which rounding is zero."""
        ca = casadi()
        return ca.sparsify(ca.DM(np.where(np.abs(values) > 1e-14, values, 0.0)))

    def com_from(self, reference: Spot, derivative: int = 0) -> Pair:
        """Position of the centre of mass relative to a point, or a derivative, m."""
        x, z = self.positions(-self.weights([reference]), derivative)
        return x, z

    def moments(self, reference: Spot | None, forces: Sequence[tuple[Spot, Pair]]) -> Any:
        """Q (m,) N m of the bodies' angles, where a reference point does not accelerate.

        Parameters
        ----------
        reference : a point of the robot on the ground; None in flight, where the centre of mass falls freely
        forces : points of the robot, and the forces that the ground exerts there, N
        """
        ca = casadi()
        tree = self.robot.tree
        moments = self.work(self.centers, tree.mass, Spot(0, 0j), reference)
        inertia = tree.inertia * ca.mtimes(self._rates, self.a)
        c, s = self.rotations[0]
        for spot, (horizontal, vertical) in forces:
            lever, rolled = np.split(self.weights([spot], Spot(0, 0j))[0], 2)
            real = self.constant(lever.real)
            imaginary = self.constant(lever.imag)
            across = real * horizontal + imaginary * vertical
            along = real * vertical - imaginary * horizontal
            moments -= self._sigma * (c * along - s * across) + self.constant(rolled.real) * horizontal
        moments += inertia
        return moments if tree.rotors is None else moments + ca.mtimes(self.constant(tree.rotors), self.a[1:])

    def work(
        self, spots: Sequence[Spot], mass: Array, hinge: Spot | None, reference: Spot | None, derivative: int = 2
    ) -> Any:
        """Virtual work (m,) with the bodies' angles of masses times accelerations less gravity, at points.

        Parameters
        ----------
        spots, mass : where, and (points,) kg
        hinge : is fixed in the virtual motion; the centre of mass where there is none
        reference : as of :meth:`moments`
        derivative : 2, or 1 for velocities in place of accelerations
        """
        ca = casadi()
        c, s = self.rotations[0]
        levers = mass * self.weights(spots, hinge)[:, : len(self.robot.tree.mass)].conj().T
        rotated, rolled = np.split(levers @ self.weights(spots, reference), 2, axis=1)
        rotated = self._summed(rotated)
        rolled = self._summed(rolled)
        x, z = (component[self._alike.tolist(), :] for component in self._relative_rotations(derivative))
        by_rotations = ca.sum2(self.constant(rotated.real) * z + self.constant(rotated.imag) * x)
        # What rolls, and the weight, act along axes of the plane.
        angles = self.angles[derivative][self._leading]
        weight = (0.0 if reference is None else self.gravity) * levers.sum(axis=1)
        across = ca.mtimes(self.constant(rolled.real), angles) - weight.imag
        up = ca.mtimes(self.constant(rolled.imag), angles) + weight.real
        return self._sigma * (by_rotations + c * up - s * across)

    def motor_torques(self, moments: Any) -> Any:
        """Torques (motors,) N m, each motor's own, of moments Q."""
        return casadi().mtimes(self.constant(self.robot.tree.motor_turns.T), moments)

    def momentum(self) -> Any:
        """Angular momentum about the centre of mass and the plane's normal, kg m^2/s."""
        ca = casadi()
        tree = self.robot.tree
        orbital = ca.sum1(self.work(self.centers, tree.mass, None, None, 1))
        return orbital + ca.dot(ca.DM(tree.inertia), ca.mtimes(self._rates, self.v))

    def momentum_about(self, spot: Spot) -> tuple[Any, Any, Any]:
        """Angular momentum L about the one contact on the ground, kg m^2/s; L' and L'' where moments balance."""
        sigma = self._sigma
        mass = self.robot.mass
        weight = mass * self.gravity
        x, z = self.com_from(spot)
        vx, vz = self.com_from(spot, 1)
        _, az = self.com_from(spot, 2)
        # Horizontal position, speed and acceleration of P, the point on the ground.
        ground, speed, acceleration = (-sigma * spot.radius * angles[spot.body] for angles in self.angles)
        x = x - ground
        z = z + spot.radius
        first = weight * x + mass * speed * vz
        second = weight * (vx - speed) + mass * (acceleration * vz + speed * az)
        return self.momentum() + sigma * mass * (x * vz - z * vx), -sigma * first, -sigma * second

    def function(self, name: str, outputs: Sequence[Any], *more: Any) -> Any:
        """A CasADi function of y, v, a and ``more`` symbols; arrays (size, N) are N evaluations."""
        return casadi().Function(name, [self.y, self.v, self.a, *more], list(outputs))


def anchor_force(model: PlanarModel, phase: Phase, forces: Any) -> tuple[Pair, list[Pair]]:
    """The anchor's force, by the balance of forces, and those of the others (2 others,), as pairs, N."""
    pairs = [(forces[2 * k], forces[2 * k + 1]) for k in range(len(phase.others))]
    x, z = model.com_from(phase.anchor.spots[0], 2)
    mass = model.robot.mass
    horizontal = mass * x
    vertical = mass * (z + model.gravity)
    for pair in pairs:
        horizontal = horizontal - pair[0]
        vertical = vertical - pair[1]
    return (horizontal, vertical), pairs


def spread(contacts: Sequence[GroundContact], forces: Sequence[Pair]) -> list[tuple[Spot, Pair]]:
    """Forces of contacts shared evenly among the feet that are coupled: points, and the share of each."""
    shared: list[tuple[Spot, Pair]] = []
    for contact, (horizontal, vertical) in zip(contacts, forces, strict=True):
        count = len(contact.spots)
        share = (horizontal / count, vertical / count)
        shared += [(spot, share) for spot in contact.spots]
    return shared
