"""The robot as seen in its plane: bodies that turn as one, and where their points are.

With the absolute angle of body b written as ``phi_b = orientation + turns_b @ positions + offsets_b`` (radians about
the plane's normal), every point of the robot relative to the centre of mass is a fixed linear combination of the
rotated unit vectors ``exp(i sigma phi_b)``; that is (6), (20) and (21) of the paper for any tree. Points of the plane
are complex numbers, horizontal + i vertical; sigma is the plane's ``turn``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray


@dataclass(frozen=True, eq=False)
class PlanarTree:
    """Bodies 0..m-1 of a planar tree, parents before children; body 0 carries the base.

    Attributes
    ----------
    names : tuple of str
        Name of each body: the link at its root.
    parent : (m,) int
        Index of the parent body, -1 for body 0.
    anchor : (m,) complex
        Place of the body's joint in its parent's frame, m; 0 for body 0.
    mass : (m,) kg
    center : (m,) complex
        Centre of mass in the body's frame, m.
    inertia : (m,) kg m^2
        About the body's own centre of mass and the plane's normal.
    turns : (m, n)
        Derivative of each body's absolute angle by the planned positions: entries 0, +-1, or coupling ratios.
    motor_turns : (m, motors)
        Derivative of each body's absolute angle by the positions of the robot's motors, each of them on its own.
    offsets : (m,) rad
        Absolute angle of each body at orientation 0 and planned positions 0.
    turn : float
        +1 where a positive angle about the normal turns the horizontal axis towards the vertical one, else -1.
    """

    names: tuple[str, ...]
    parent: IntArray
    anchor: ComplexArray
    mass: Array
    center: ComplexArray
    inertia: Array
    turns: Array
    motor_turns: Array
    offsets: Array
    turn: float

    def absolute_angles(self, orientation: Array, positions: Array) -> Array:
        """Angles phi (..., m) of the bodies, from orientation (...) and positions (..., n), rad."""
        return orientation[..., None] + positions @ self.turns.T + self.offsets

    def rotations(self, angles: Array) -> ComplexArray:
        """Rotations exp(i sigma phi), from angles phi (..., m)."""
        return rotations_of(angles, self.turn)

    def point_weights(self, body: IntArray, local: ComplexArray) -> ComplexArray:
        """Weights W (points, m): a point's place relative to the centre of mass is ``rotations @ W.T``.

        Parameters
        ----------
        body : (points,) int
            The body that each point is fixed to.
        local : (points,) complex
            Its place in that body's frame, m.
        """
        from_base = self._weights_from_base(body, local)
        centers = self._weights_from_base(np.arange(len(self.mass)), self.center)
        return np.asarray(from_base - self.mass @ centers / self.mass.sum(), dtype=np.complex128)

    def _weights_from_base(self, body: IntArray, local: ComplexArray) -> ComplexArray:
        origins = np.zeros((len(self.mass), len(self.mass)), dtype=np.complex128)
        for b in range(1, len(self.mass)):
            origins[b] = origins[self.parent[b]]
            origins[b, self.parent[b]] += self.anchor[b]
        weights = origins[body]
        weights[np.arange(len(body)), body] += local
        return np.asarray(weights, dtype=np.complex128)


def rotations_of(angles: Array, turn: float) -> ComplexArray:
    """Rotations exp(i turn phi), from angles phi of any shape, rad."""
    rotations = np.empty(np.shape(angles), dtype=np.complex128)
    np.cos(angles, out=rotations.real)  # much cheaper than the complex exponential
    np.multiply(turn, np.sin(angles), out=rotations.imag)
    return rotations
