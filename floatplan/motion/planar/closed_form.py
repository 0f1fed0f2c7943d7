"""Flight of a planar tree in closed form, over many instants at once.

The centre of mass flies along a parabola that takeoff, landing and duration determine: (2), (3) and (6).

With E_k = exp(i sigma phi_k) for the absolute angles phi of the bodies, and K_kj = conj(E_k) C_kj E_j, the momentum is
``h = sum_kj Re(K_kj) phi_j' + sum_k I_k phi_k'`` and the moment that turns body k
``F_k = sum_j Re(K_kj (phi_j'' + i sigma phi_j'^2)) + I_k phi_k''``: the Appendix of the paper, (A.1), (A.4) and (A.5),
as corrected, for any tree. Joint torques gather F over the joint's subtree; the sum over all bodies vanishes in flight.
Where motors have rotors, what turns those (:attr:`~floatplan.robot.PlanarTree.rotors`) is part of F, and so of torques.
Gravity, the path of the centre of mass and the orientation do not enter. Derivatives are the kernel's, ``tree.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.motion.dynamics import Ballistics
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Frame, Robot


@dataclass(frozen=True, eq=False)
class TurningBodies:
    """The g bodies of a tree that turn differently.

    Bodies whose angles differ by a constant, as the legs of a quadruped that is coupled left to right, are one here.

    ``turns`` (g, n) as of the tree; ``coupling`` (g, g) kg m^2, C for angles that are 0 at planned positions 0, with
    the moments of inertia on its diagonal; ``turn`` the tree's; ``rates`` (g, n+1) derivatives of the absolute angles
    by orientation and planned positions.
    """

    turns: Array
    coupling: ComplexArray
    turn: float
    rates: Array

    @classmethod
    def of(cls, tree: PlanarTree, coupling: ComplexArray | None = None, inertia: Array | None = None) -> TurningBodies:
        """Put together what turns alike: rotations are the same there but for a constant; as of :class:`Dynamics`."""
        turns, group = tree.distinct_turns
        rotations = tree.rotations(tree.offsets)[:, None] * np.eye(len(turns))[group]
        each = (tree.coupling if coupling is None else coupling) + np.diag(tree.inertia if inertia is None else inertia)
        rates = np.concatenate((np.ones((len(turns), 1)), turns), axis=1)
        return cls(turns, np.asarray(rotations.conj().T @ each @ rotations), tree.turn, rates)


class Dynamics:
    """A tree's dynamics, vectorised over instants; C (m, m) and inertias (m,), kg m^2, may be those of other masses."""

    def __init__(self, tree: PlanarTree, coupling: ComplexArray | None = None, inertia: Array | None = None) -> None:
        self._tree, self._turn = tree, tree.turn
        self._turns = np.array(tree.turns)
        self._turns_transposed = self._turns.T.copy()
        self._of_bodies, self._of_joints = map(np.ones, self._turns.shape)  # products with them are faster than sums
        self._distinct = TurningBodies.of(tree, coupling, inertia)
        self._distinct_turns_transposed = self._distinct.turns.T.copy()
        self._rates = self._distinct.rates
        self._inertia = np.array(tree.inertia if inertia is None else inertia)
        self._coupling_transposed = (tree.coupling if coupling is None else coupling).T.copy()

    def momentum_map(self, positions: Array) -> Array:
        """D of (4): rows (D_0, D_1, ..., D_n), (N, n+1) kg m^2, at positions (N, n)."""
        rotations = self._tree.rotations(positions @ self._distinct_turns_transposed)
        gathered = (rotations.conj() @ self._distinct.coupling) * rotations
        return np.asarray(gathered.real @ self._rates)

    def base_rate(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> Array:
        """theta0' (N,) rad/s of (4), corrected (15), at positions and velocities (N, n)."""
        rows = self.momentum_map(positions)
        by_momentum = 1 / rows[:, 0]
        by_velocity = rows[:, 1:] * -by_momentum[:, None]
        return np.asarray(angular_momentum * by_momentum + (by_velocity * velocities) @ self._of_joints)

    def torques(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Joint torques (N, n) N m: generalised, of a leader and its followers together."""
        return np.asarray(self.moments(positions, velocities, accelerations, base_rate) @ self._turns)

    def moments(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Moments F (N, m) that turn the bodies, N m.

        The base's acceleration follows from the vanishing sum of the moments. Orientation 0 is as good as any.
        """
        rotations = self._tree.rotations(positions @ self._turns_transposed + self._tree.offsets)
        body_rates = velocities @ self._turns_transposed + base_rate[:, None]
        relative = accelerations @ self._turns_transposed
        back, turning = rotations.conj(), relative + (1j * self._turn) * (body_rates * body_rates)
        gathered = back * ((rotations * turning) @ self._coupling_transposed)
        by_base = back * (rotations @ self._coupling_transposed)
        locked_inertia = (by_base.real + self._inertia) @ self._of_bodies
        base_acceleration = -((gathered.real + self._inertia * relative) @ self._of_bodies) / locked_inertia
        gathered += base_acceleration[:, None] * by_base
        moments = np.asarray(gathered.real + self._inertia * (relative + base_acceleration[:, None]))
        return moments if self._tree.rotors is None else moments + accelerations @ self._tree.rotors.T


@lru_cache(maxsize=64)
def tree_dynamics(tree: PlanarTree) -> Dynamics:
    """Return a tree's dynamics, prepared once."""
    return Dynamics(tree)


@lru_cache(maxsize=64)
def frame_weights(robot: Robot, frame: Frame) -> ComplexArray:
    """Weights (m,) of a frame's place relative to the centre of mass; see ``PlanarTree.point_weights``."""
    weights: ComplexArray = robot.tree.point_weights(np.array([frame.body]), np.array([frame.local]))[0]
    weights.setflags(write=False)
    return weights


def frame_from_com(robot: Robot, frame: Frame, state: JointState) -> complex:
    """Place of a frame relative to the centre of mass, (6), m, as a complex number."""
    weights = frame_weights(robot, frame)
    return complex(places_from_com(robot.tree, weights, np.array(state.orientation), state.positions))


def places_from_com(tree: PlanarTree, weights: ComplexArray, orientation: Array, positions: Array) -> ComplexArray:
    """Places (..) of points by their weights (m,) or (.., m), for orientations (..) and positions (.., n), rad.

    Each is computed as if it were alone: to the same bits.
    """
    angles = orientation[..., None] + (positions[..., None, :] * tree.turns).sum(axis=-1) + tree.offsets
    return np.asarray((tree.rotations(angles) * weights).sum(axis=-1))


def rising(takeoff: Any, landing: Any, height: Any, gravity: Any, duration: Any) -> Any:
    """Vertical velocity of the centre of mass at takeoff, m/s, by (2), (3) and (6), of one flight or of many.

    ``takeoff`` is where it takes off, ``landing`` where the landing frame is relative to it at landing, as complex
    numbers, m; ``height`` is that frame's, m.
    """
    return (height - landing.imag - takeoff.imag) / duration + gravity * duration / 2


@lru_cache(maxsize=8)
def ballistics(problem: Problem) -> Ballistics:
    """CM path of a problem: (2), (3) integrated, with boundary conditions from (6) at takeoff and at landing."""
    robot, flight = problem.robot, problem.flight
    ends = (problem.initial, problem.final)
    by_name = robot.layout.frames
    frames = (by_name[problem.takeoff.frame], by_name[problem.landing.frame])
    weights = np.array([frame_weights(robot, frame) for frame in frames])
    orientations = np.array([state.orientation for state in ends])
    positions = np.array([state.positions for state in ends])
    foot, landing = places_from_com(robot.tree, weights, orientations, positions).tolist()
    horizontal, vertical = problem.takeoff.position[:2]
    takeoff = complex(horizontal, vertical) - foot
    vertical_velocity = rising(takeoff, landing, problem.landing_height, flight.gravity, flight.duration)
    return Ballistics(
        position0=read_only([takeoff.real, takeoff.imag]),
        velocity0=read_only(np.array([flight.horizontal_velocity, vertical_velocity])),
        gravity=float(flight.gravity),
    )
