"""The flight at single instants with 50 digits, in code of its own: Newton's and Euler's equations of the bodies.

The robot's constants are the doubles of the robot room's planar tree; everything after them is 176-bit arithmetic.
"""

from typing import Any

import flint
import numpy as np
from flint import acb, arb

BITS = 176
PIECES, NODES = 4, 40  # Gauss-Legendre quadrature of the orientation: exact to 30 digits for the flights of the tests


class Sharp:
    """A robot and its flight. Complex numbers are horizontal + i vertical."""

    def __init__(self, robot, record):
        self.robot, self.record, self.tree = robot, record, robot.tree
        m = len(self.tree.mass)
        self.centers = _complex(self.tree.point_weights(np.arange(m), self.tree.center))
        self.anchors = _complex(self.tree.point_weights(np.arange(m), np.zeros(m, dtype=complex)))
        self.sigma = int(self.tree.turn)
        self._orientations = {}

    def joints(self, t):
        """Positions, velocities and accelerations: three lists of n."""
        states: list[list[Any]] = [[], [], []]
        rows = zip(self.record.coefficients, self.record.centre, self.record.amplitude, strict=True)
        for row, centre, amplitude in rows:
            polynomial = flint.arb_poly(row.tolist())
            p, dp = polynomial(t), polynomial.derivative()(t)
            ddp = polynomial.derivative().derivative()(t)
            sine, cosine = p.sin_cos()
            states[0].append(arb(float(centre)) + arb(float(amplitude)) * sine)
            states[1].append(arb(float(amplitude)) * cosine * dp)
            states[2].append(arb(float(amplitude)) * (cosine * ddp - sine * dp * dp))
        return states

    def bodies(self, t):
        """Turned unit vectors z (m), rates and accelerations of the bodies relative to the base (m)."""
        q, dq, ddq = self.joints(t)
        angles = [_dot(row, q) + arb(float(off)) for row, off in zip(self.tree.turns, self.tree.offsets, strict=True)]
        return [_unit(self.sigma * a) for a in angles], self._turned(dq), self._turned(ddq)

    def _turned(self, values):
        return [_dot(row, values) for row in self.tree.turns]

    def places(self, weights, factors):
        return [sum((w * f for w, f in zip(row, factors, strict=True)), acb(0)) for row in weights]

    def momentum(self, z, rates):
        """About the centre of mass, for absolute rates of the bodies."""
        r = self.places(self.centers, z)
        v = self.places(self.centers, [acb(0, self.sigma) * w * unit for w, unit in zip(rates, z, strict=True)])
        parts = zip(self.tree.mass, self.tree.inertia, r, v, rates, strict=True)
        total = arb(0)
        for mass, inertia, place, velocity, rate in parts:
            total += self.sigma * float(mass) * (place.conjugate() * velocity).imag + float(inertia) * rate
        return total

    def rate(self, t):
        """Orientation rate by (4)."""
        z, dphi, _ = self.bodies(t)
        return (arb(self.record.angular_momentum) - self.momentum(z, dphi)) / self.momentum(z, [arb(1)] * len(z))

    def torques(self, t):
        """Joint torques (n), by recursion from the leaves."""
        z, dphi, ddphi = self.bodies(t)
        rate = self.rate(t)
        rates = [w + rate for w in dphi]
        moment, _ = self._loads(z, rates, ddphi)
        base = -sum(moment, arb(0)) / self.momentum(z, [arb(1)] * len(z))
        moment, force = self._loads(z, rates, [a + base for a in ddphi])
        anchor = self.places(self.anchors, z)
        relative = self.tree.turns.copy()
        torques = [arb(0)] * relative.shape[1]
        for b in range(len(z) - 1, -1, -1):
            parent = self.tree.parent[b]
            here = moment[b] - self.sigma * (anchor[b].conjugate() * force[b]).imag
            turns = self.tree.turns[b] - (self.tree.turns[parent] if parent >= 0 else 0.0)
            torques = [tau + float(turn) * here for tau, turn in zip(torques, turns, strict=True)]
            if parent >= 0:
                moment[parent] += moment[b]
                force[parent] += force[b]
        return torques

    def _loads(self, z, rates, accelerations):
        turned = [(acb(0, self.sigma) * a - w * w) * unit for a, w, unit in zip(accelerations, rates, z, strict=True)]
        r, a = self.places(self.centers, z), self.places(self.centers, turned)
        force = [float(mass) * each for mass, each in zip(self.tree.mass, a, strict=True)]
        parts = zip(r, force, self.tree.inertia, accelerations, strict=True)
        moment = [self.sigma * (p.conjugate() * f).imag + float(inertia) * b for p, f, inertia, b in parts]
        return moment, force

    def orientation(self, t):
        """Orientation at an instant."""
        if t not in self._orientations:
            total, width = arb(0), arb(t) / PIECES
            for node, weight in _rule():
                for piece in range(PIECES):
                    total += weight * self.rate(width * (piece + (node + 1) / 2)) * width / 2
            self._orientations[t] = arb(self.record.orientation["start"]) + total
        return self._orientations[t]

    def points(self, t, body, local):
        """Places of points of bodies, by body index (k,) and place in the body (k,) complex."""
        com, weights = self.record.com, _complex(self.tree.point_weights(np.asarray(body), np.asarray(local)))
        x, y = (arb(p) + arb(v) * arb(t) for p, v in zip(com["position0"], com["velocity0"], strict=True))
        center = acb(x, y - arb(com["gravity"]) * arb(t) * arb(t) / 2)
        turn = _unit(self.sigma * self.orientation(t))
        return [center + turn * place for place in self.places(weights, self.bodies(t)[0])]

    def clearance(self, t, obstacle):
        """Distance from the links' surfaces to an obstacle."""
        shapes = self.robot.shapes
        body = [shape.body for shape in shapes]
        starts = self.points(t, body, [shape.start for shape in shapes])
        ends = self.points(t, body, [shape.end for shape in shapes])
        shift = acb(*(arb(v) * arb(t) for v in obstacle.get("velocity") or (0.0, 0.0)))
        links = [(a, b) for a, b in zip(starts, ends, strict=True)]
        if obstacle["kind"] == "half-plane":
            normal = acb(*obstacle["normal"])
            found = [min(_height(p - acb(*obstacle["point"]) - shift, normal) for p in link) for link in links]
        elif obstacle["kind"] == "circle":
            found = [_to_segment(acb(*obstacle["center"]) + shift, *link) - arb(obstacle["radius"]) for link in links]
        else:
            bar = tuple(acb(*obstacle[end]) + shift for end in ("start", "end"))
            found = [_between(link, bar) - arb(obstacle["radius"]) for link in links]
        return min(d - arb(float(shape.radius)) for d, shape in zip(found, shapes, strict=True))


def _rule():
    return [arb.legendre_p_root(NODES, k, weight=True) for k in range(NODES)]


def _complex(weights):
    return [[acb(float(w.real), float(w.imag)) for w in row] for row in weights]


def _dot(row, values):
    return sum((float(a) * v for a, v in zip(row, values, strict=True)), arb(0))


def _unit(angle):
    sine, cosine = arb(angle).sin_cos()
    return acb(cosine, sine)


def _height(vector, normal):
    return (vector * normal.conjugate()).real / abs(normal)


def _to_segment(point, start, end):
    along = end - start
    share = ((point - start) * along.conjugate()).real / (abs(along) * abs(along)) if abs(along) > 0 else arb(0)
    return abs(point - start - min(max(share, arb(0)), arb(1)) * along)


def _between(link, bar):
    (a, b), (c, d) = link, bar

    def side(p, u, v):
        return ((v - u).conjugate() * (p - u)).imag

    if side(a, c, d) * side(b, c, d) < 0 and side(c, a, b) * side(d, a, b) < 0:
        return arb(0)
    return min(_to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b))
