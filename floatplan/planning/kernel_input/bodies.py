"""A planar tree as the kernel sees it: bodies that turn alike merged, what is constant folded into the coupling.

With ``q_i = centre_i + amplitude_i sin p_i`` the angle of body a is a constant and ``sum_i turns_ai amplitude_i sin
p_i``. The constants go into C of :mod:`floatplan.motion.planar.closed_form`, and so do the senses of rotation and the
moments of inertia. Bodies whose angles differ by a constant, as the legs of a quadruped that is coupled left to right,
are then one.
"""

from bisect import bisect_left
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.kernel.structs import Struct, doubles, integers
from floatplan.robot.planar.tree import PlanarTree


class Bodies:
    """Bodies (m,) of a tree that turn differently, for joint ranges of the given centres and amplitudes (n,), rad.

    Left out, the bodies are by the joints' own positions, of any range.

    Body 0 does not turn against the base.

    Attributes
    ----------
    real, imaginary : (m, m) kg m^2
        C, with the moments of inertia on its diagonal.
    parent : (m,) int
        The body before it that each one's angle is built on.
    first : list of m+1 int
        Where the terms ``ratio[e] sin p`` of ``joint[e]`` of each body begin.
    joint, ratio : (E,) int, (E,) rad
    rotations : (m, M) complex
        What takes the tree's M bodies, its links, to these: ``rotations^* C rotations^T`` is theirs.
    group : (M,) int
        As which of these bodies each link turns.
    links : (M, m) complex, kg m^2
        Of each link alone, the row of C by these bodies.
    rotors : (M, n) kg m^2 rad
        Moments on the links that turn rotors, by the accelerations of sin p; None where there are none.
    is_mirrored : whether angles count the other way
    struct : Struct
        The same for the kernel.
    """

    def __init__(self, tree: PlanarTree, centre: Array | None = None, amplitude: Array | None = None) -> None:
        joints = tree.turns.shape[1]
        centre = np.zeros(joints) if centre is None else centre
        amplitude = np.ones(joints) if amplitude is None else amplitude
        constant = np.exp(1j * tree.turn * (tree.offsets + tree.turns @ centre))
        turns, self.group = tree.distinct_turns
        # Of each body's turns (m, n) the one before it that needs fewest terms to become it, and these terms.
        rows = np.arange(len(turns))
        differences = turns[:, None] - turns
        needed = (differences != 0).sum(axis=2)
        needed[rows[:, None] <= rows] = turns.shape[1] + 1  # those after it
        self.parent: IntArray = needed.argmin(axis=1)
        terms = differences[rows, self.parent]
        body, self.joint = terms.nonzero()
        rising = body.tolist()
        self.first = [bisect_left(rising, number) for number in range(len(turns) + 1)]
        self.ratio = terms[body, self.joint] * amplitude[self.joint]
        self.rotations = np.eye(len(turns))[self.group].T * constant
        coupling = self.rotations.conj() @ (tree.coupling + np.diag(tree.inertia)) @ self.rotations.T
        links = (constant.conj()[:, None] * tree.coupling) @ self.rotations.T
        links[np.arange(len(links)), self.group] += tree.inertia
        self.is_mirrored = tree.turn < 0
        if self.is_mirrored:
            coupling = coupling.conj()
            links = links.conj()
        self.real = np.ascontiguousarray(coupling.real)
        self.imaginary = np.ascontiguousarray(coupling.imag)
        self.links = links
        self.rotors = None if tree.rotors is None else tree.rotors * amplitude

        rounding = 1e-15  # [-] of the largest: imaginary parts of C that are none
        is_real = bool(np.abs(self.imaginary).max() <= rounding * np.abs(self.real).max())
        self.struct = Struct(
            "Robot",
            joints=joints,
            bodies=len(turns),
            real=self.real,
            imaginary=self.imaginary,
            is_real=is_real,
            parent=integers(self.parent),
            first=integers(self.first),
            joint=integers(self.joint),
            ratio=doubles(self.ratio),
            links=len(self.group),
            group=integers(self.group),
            link_real=doubles(links.real),
            link_imaginary=doubles(links.imag),
            has_rotors=self.rotors is not None,
            rotors=self.rotors,
        )

    def of_points(self, weights: ComplexArray) -> ComplexArray:
        """Weights (.., m) that give points by the rotations of these bodies, from those (.., M) by the tree's."""
        points = weights @ self.rotations.T
        return np.asarray(points.conj() if self.is_mirrored else points)


unscaled_bodies = lru_cache(maxsize=64)(Bodies)  # of a tree alone: they are made once
