"""A robot in space at single instants with 200 bits: sums over its links, Newton's and Euler's equations, own reading.

Vectors are columns ``flint.arb_mat``, in the base's axes; every joint that turns is planned.
"""

from typing import Any
from xml.etree import ElementTree

import flint
from flint import arb, arb_mat

BITS = 200


def column(text):
    return arb_mat(3, 1, [arb(float(word)) for word in text.split()])


def cross(a, b):
    (ax, ay, az), (bx, by, bz) = a.entries(), b.entries()
    return arb_mat(3, 1, [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def dot(a, b):
    return (a.transpose() * b)[0, 0]


def about(axis, angle):
    """Rotation about an axis of any length, by its unit quaternion."""
    length = dot(axis, axis).sqrt()
    sine, cosine = (angle / 2).sin_cos()
    return turned([*(axis * (sine / length)).entries(), cosine])


def turned(quaternion):
    """Rotation of a quaternion x, y, z, w of any length."""
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return arb_mat([[entry / square for entry in row] for row in rows])


def placement(element):
    """Rotation and translation of an element's origin."""
    origin = element.find("origin") if element is not None else None
    zero = "0 0 0"
    if origin is None:
        return arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), column(zero)
    roll, pitch, yaw = column(origin.get("rpy", zero)).entries()
    x, y, z = (column(text) for text in ("1 0 0", "0 1 0", "0 0 1"))
    return about(z, yaw) * about(y, pitch) * about(x, roll), column(origin.get("xyz", zero))


class SharpRobot:
    """The links and joints of a file. To be made and asked with the precision set."""

    def __init__(self, urdf, joints):
        root: Any = ElementTree.parse(urdf).getroot()
        self.names = list(joints)
        self.joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
        self.links = {link.get("name"): link.find("inertial") for link in root.findall("link")}
        (self.root,) = set(self.links) - set(self.joints)

    def _motions(self, q, dq, ddq, omega, alpha):
        """Of each link: rotation, place, rate, acceleration of its turning and of its origin; the base's is at rest."""
        still = column("0 0 0")
        found = {self.root: (arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), still, omega, alpha, still)}
        waiting = list(self.joints)
        while waiting:
            child = waiting.pop(0)
            joint = self.joints[child]
            parent = joint.find("parent").get("link")
            if parent not in found:
                waiting.append(child)
                continue
            rotation, place, rate, push, pull = found[parent]
            by, at = placement(joint)
            arm = rotation * at
            rotation, place = rotation * by, place + arm
            pull = pull + cross(push, arm) + cross(rate, cross(rate, arm))
            if joint.get("type") != "fixed":
                k = self.names.index(joint.get("name"))
                axis = joint.find("axis")
                axis = column("1 0 0" if axis is None else axis.get("xyz"))
                unit = rotation * axis * (1 / dot(axis, axis).sqrt())
                push = push + unit * ddq[k] + cross(rate, unit * dq[k])
                rate = rate + unit * dq[k]
                rotation = rotation * about(axis, q[k])
            found[child] = rotation, place, rate, push, pull
        return found

    def _bodies(self, motions):
        """Of each link with mass: mass, centre, inertia about it, rate, accelerations of its turning and its centre."""
        for name, inertial in self.links.items():
            if inertial is None:
                continue
            rotation, place, rate, push, pull = motions[name]
            by, at = placement(inertial)
            arm, axes = rotation * at, rotation * by
            read = inertial.find("inertia").get
            xx, yy, zz, xy, xz, yz = (arb(float(read(key))) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
            inertia = axes * arb_mat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * axes.transpose()
            pull = pull + cross(push, arm) + cross(rate, cross(rate, arm))
            yield name, arb(float(inertial.find("mass").get("value"))), place + arm, inertia, rate, push, pull

    def _center(self, bodies, index):
        total = sum((body[1] for body in bodies), arb(0))
        return sum((body[index] * body[1] for body in bodies), column("0 0 0")) * (1 / total)

    def _loads(self, bodies):
        """Of each link what free fall does not do: the moment about its centre, the force on it, and that place."""
        pulled = self._center(bodies, 6)
        loads = {}
        for name, mass, place, inertia, rate, push, pull in bodies:
            loads[name] = inertia * push + cross(rate, inertia * rate), (pull - pulled) * mass, place
        return loads

    def momentum(self, q, dq, omega):
        """Angular momentum about the centre of mass."""
        zero = [arb(0)] * len(q)
        still = column("0 0 0")
        slow = list(self._bodies(self._motions(q, dq, zero, omega, still)))
        middle = self._center(slow, 2)
        total = still
        for _, _, _, inertia, rate, _, _ in slow:
            total = total + inertia * rate
        velocities = self._velocities(q, dq, omega)
        mean = sum((velocities[b[0]] * b[1] for b in slow), still) * (1 / sum((b[1] for b in slow), arb(0)))
        for name, mass, place, *_ in slow:
            total = total + cross(place - middle, (velocities[name] - mean) * mass)
        return total

    def _velocities(self, q, dq, omega):
        """Velocities of the links' centres of mass, the base's origin at rest."""
        zero = [arb(0)] * len(q)
        motions = self._motions(q, dq, zero, omega, column("0 0 0"))
        origins = {self.root: column("0 0 0")}
        while len(origins) < len(motions):
            for child, joint in self.joints.items():
                parent = joint.find("parent").get("link")
                if parent in origins:
                    origins[child] = origins[parent] + cross(motions[parent][2], motions[child][1] - motions[parent][1])
        found = {}
        for name, inertial in self.links.items():
            rotation, _, rate, _, _ = motions[name]
            found[name] = origins[name] + cross(rate, rotation * placement(inertial)[1])
        return found

    def inertia(self, q):
        """About the centre of mass (3, 3)."""
        zero = [arb(0)] * len(q)
        columns = [self.momentum(q, zero, column(text)).entries() for text in ("1 0 0", "0 1 0", "0 0 1")]
        return arb_mat(columns).transpose()

    def torques(self, q, dq, ddq, omega):
        """Of the joints, in free flight."""
        held = self._moment(list(self._bodies(self._motions(q, dq, ddq, omega, column("0 0 0")))))
        alpha = self.inertia(q).solve(held * -1)
        motions = self._motions(q, dq, ddq, omega, alpha)
        loads = self._loads(list(self._bodies(motions)))
        found: list[Any] = [None] * len(q)
        for child, joint in self.joints.items():
            if joint.get("type") == "fixed":
                continue
            axis = joint.find("axis")
            axis = column("1 0 0" if axis is None else axis.get("xyz"))
            unit = motions[child][0] * axis * (1 / dot(axis, axis).sqrt())
            moment = column("0 0 0")
            for name in self._below(child):
                if name in loads:
                    turning, force, place = loads[name]
                    moment = moment + turning + cross(place - motions[child][1], force)
            found[self.names.index(joint.get("name"))] = dot(unit, moment)
        return found

    def _moment(self, bodies):
        middle = self._center(bodies, 2)
        loads = self._loads(bodies)
        return sum((turn + cross(place - middle, force) for turn, force, place in loads.values()), column("0 0 0"))

    def _below(self, link):
        found = [link]
        for child, joint in self.joints.items():
            if joint.find("parent").get("link") == link:
                found += self._below(child)
        return found


def joints(record, t):
    """Positions, velocities and accelerations of (12): three lists of n."""
    states: list[list[Any]] = [[], [], []]
    for row, centre, amplitude in zip(record.coefficients, record.centre, record.amplitude, strict=True):
        polynomial = flint.arb_poly(row.tolist())
        first = polynomial.derivative()
        p, dp, ddp = polynomial(t), first(t), first.derivative()(t)
        sine, cosine = p.sin_cos()
        centre, amplitude = arb(float(centre)), arb(float(amplitude))
        states[0].append(centre + amplitude * sine)
        states[1].append(amplitude * cosine * dp)
        states[2].append(amplitude * (cosine * ddp - sine * dp * dp))
    return states
