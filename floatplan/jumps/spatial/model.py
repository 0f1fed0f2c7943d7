"""CasADi expressions of a robot in space: places of points, the balance of forces and moments, torques of joints.

The coordinates are y = (c, e, q): centre of mass, m, three angles of the base about ``axes``, ``R = R_a R_b R_c``, and
planned joints, rad. Bodies move relative to the base's origin, in the world's axes;
with s = c'' - (the centre's acceleration relative to the origin) + g each body needs the force and the moment about its
own centre

``f_i = m_i (a_i + s)``, ``n_i = I_i alpha_i + w_i x I_i w_i``.

The six rows of the base are ``m (c'' + g) = sum F`` and ``sum_i n_i + (c_i - c) x m_i a_i = sum (p - c) x F``, F the
contacts' forces at points p; s drops out of the second. A joint with the axis z at p_j has the torque
``z . (M - p_j x f)``, M and f summed over all that it carries, less what the contacts on it take. Rotors' inertia is
added as Pinocchio adds it. A ball of radius r about C that rolls, on a body with angular velocity w, has
``C' = w x r e_z`` and its force at ``C - r e_z``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.model import casadi
from floatplan.jumps.spatial.standing import Foot
from floatplan.problem.ground_step import GroundStep
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import SolidCapsule, frame_position

BASE = 6  # coordinates of the base: centre of mass or origin, then three angles


@dataclass(frozen=True, eq=False)
class Body:
    """A body's motion in the world's axes, relative to the base's origin: expressions.

    Attributes
    ----------
    rotation : (3, 3)
    position, velocity, acceleration : (3,) of its joint's origin
    rate, rate_change : (3,) angular velocity and acceleration
    """

    rotation: Any
    position: Any
    velocity: Any
    acceleration: Any
    rate: Any
    rate_change: Any

    def point(self, local: Any) -> tuple[Any, Any, Any]:
        """Position, velocity and acceleration (3,) of a point (3,) of the body."""
        ca = casadi()
        arm = ca.mtimes(self.rotation, ca.DM(local))
        turning = ca.cross(self.rate, arm)
        position = self.position + arm
        velocity = self.velocity + turning
        acceleration = self.acceleration + ca.cross(self.rate_change, arm) + ca.cross(self.rate, turning)
        return position, velocity, acceleration


class SpatialModel:
    """Symbols of a robot's coordinates with their derivatives, and expressions of them.

    Attributes
    ----------
    robot : Robot
    axes : letters of the axes of the base's angles
    gravity : m/s^2
    points : of feet, by their names: joint of the robot's model that carries it, and position (3,) m in its frame
    radii : of feet, by their names: of the ball about the point that rolls, m; 0 of one that does not
    y, v, a : (6+n,) symbols; rows 0 to 2 are the centre of mass
    bodies : of the joints of the robot's model, the base's first
    """

    def __init__(self, robot: Robot, axes: str, gravity: float, feet: Sequence[Foot] = ()) -> None:
        self.robot = robot
        self.points = {foot.name: (foot.body, np.array(foot.local)) for foot in feet}
        self.radii = {foot.name: foot.radius for foot in feet}
        self.axes = axes
        self.gravity = gravity
        self.mass = robot.mass
        sx = casadi().SX
        self.size = BASE + len(robot.joints)
        self.y = sx.sym("y", self.size)
        self.v = sx.sym("v", self.size)
        self.a = sx.sym("a", self.size)
        self.bodies = self._bodies()
        self._momenta()

    def _bodies(self) -> list[Body]:
        """All bodies, in the order of the robot's model."""
        ca = casadi()
        model = self.robot.model
        chosen = ca.sparsify(ca.DM(self.robot.selection[BASE:]))
        joints = ca.DM(self.robot.reference[BASE + 1 :]) + ca.mtimes(chosen, self.y[BASE:])
        rates = ca.mtimes(chosen, self.v[BASE:])
        self.joint_accelerations = ca.mtimes(chosen, self.a[BASE:])
        zero = ca.SX.zeros(3)
        rotation, rate, rate_change = rotation_with_rates(self.axes, self.y[3:6], self.v[3:6], self.a[3:6])
        bodies = [Body(rotation, zero, zero, zero, rate, rate_change)]
        self.joint_axes: list[Any] = [None]
        for number in range(2, model.njoints):
            parent = bodies[model.parents[number] - 1]
            placement = model.jointPlacements[number]
            index = model.joints[number].idx_v - BASE
            subspace = np.asarray(model.joints[number].createData().S).ravel()
            if np.abs(subspace[:3]).max() > 0:
                reason = f"{model.names[number]!r} slides; jumps in space are of robots whose joints rotate, so far"
                raise InputError(reason, element="robot", advice="make it a fixed joint of the file")
            origin, velocity, acceleration = parent.point(placement.translation)
            local = subspace[3:]
            carried = ca.mtimes(parent.rotation, ca.sparsify(ca.DM(placement.rotation)))
            axis = ca.mtimes(carried, ca.sparsify(ca.DM(local)))
            spin = axis * rates[index]
            bodies.append(
                Body(
                    rotation=ca.mtimes(carried, about(local, joints[index])),
                    position=origin,
                    velocity=velocity,
                    acceleration=acceleration,
                    rate=parent.rate + spin,
                    rate_change=parent.rate_change
                    + axis * self.joint_accelerations[index]
                    + ca.cross(parent.rate, spin),
                )
            )
            self.joint_axes.append(axis)
        return bodies

    def _momenta(self) -> None:
        """Centre of mass relative to the base's origin with derivatives, and what each body needs."""
        ca = casadi()
        model = self.robot.model
        centres = []
        centre = [ca.SX.zeros(3) for _ in range(3)]
        for body, inertia in zip(self.bodies, list(model.inertias)[1:], strict=True):
            of_body = body.point(inertia.lever)
            centres.append(of_body)
            for order in range(3):
                centre[order] += inertia.mass / self.mass * of_body[order]
        self.centre = centre
        self.forces = []  # f_i
        self.moments = []  # about the base's origin
        moment_about_com = ca.SX.zeros(3)
        angular_momentum = ca.SX.zeros(3)
        lift = self.a[:3] - centre[2] + ca.DM([0.0, 0.0, self.gravity])
        for body, (position, velocity, acceleration), inertia in zip(
            self.bodies, centres, list(model.inertias)[1:], strict=True
        ):
            own = ca.mtimes([body.rotation, ca.DM(np.asarray(inertia.inertia)), body.rotation.T])
            spin = ca.mtimes(own, body.rate)
            spin_change = ca.mtimes(own, body.rate_change) + ca.cross(body.rate, spin)
            force = inertia.mass * (acceleration + lift)
            self.forces.append(force)
            self.moments.append(spin_change + ca.cross(position, force))
            lever = position - centre[0]
            moment_about_com += spin_change + ca.cross(lever, inertia.mass * acceleration)
            angular_momentum += spin + ca.cross(lever, inertia.mass * velocity)
        self.moment_about_com = moment_about_com
        self.angular_momentum = angular_momentum

    def foot(self, name: str) -> tuple[int, tuple[Any, Any, Any]]:
        """Number of the body that carries a foot or frame; position, velocity and acceleration (3,) of its point.

        Of a foot that rolls, a ball of radius r about C, they are C and what of its motion is no rolling,
        ``C' - w x r e_z`` and ``C'' - w' x r e_z``: the first is the velocity of the ball's lowest point.
        """
        body, local = self.points.get(name) or frame_position(self.robot.model, self.robot.joint_tree, name)
        position, velocity, acceleration = self.in_world(self.bodies[body - 1].point(local))
        above = self._above_ground(name)
        if above is not None:
            ca = casadi()
            velocity -= ca.cross(self.bodies[body - 1].rate, above)
            acceleration -= ca.cross(self.bodies[body - 1].rate_change, above)
        return body - 1, (position, velocity, acceleration)

    def _above_ground(self, name: str) -> Any:
        """From a ball's point on the ground to its centre (3,), m; None of a foot that does not roll."""
        radius = self.radii.get(name, 0.0)
        return casadi().DM([0.0, 0.0, radius]) if radius else None

    def contact(self, name: str) -> tuple[int, Any]:
        """Number of the body that carries a foot, and where the ground's force on it acts (3,)."""
        number, (position, _, _) = self.foot(name)
        above = self._above_ground(name)
        return number, position if above is None else position - above

    def leverage(self, name: str) -> Any:
        """Determinant of the derivative of a foot's contact by the joints of its leg, m^3; None unless they are three.

        It vanishes where the leg is straight, or the foot on the axis of the first joint.
        """
        ca = casadi()
        number, _ = self.foot(name)
        foot = self.bodies[number].point(self.points[name][1])[0]
        above = self._above_ground(name)
        if above is not None:
            foot -= above
        columns = []
        while number > 0:
            columns.append(ca.cross(self.joint_axes[number], foot - self.bodies[number].position))
            number = self.robot.model.parents[number + 1] - 1
        return ca.det(ca.horzcat(*columns)) if len(columns) == 3 else None

    def step_rows(
        self, step: GroundStep, height: float, standing: Array, stands: bool
    ) -> list[tuple[Any, float, float, str]]:
        """Rows that keep each capsule of a link above higher ground or beyond its edge, as the flight has it.

        Each has an expression, m over ``height``, its bounds, and a label.

        Parameters
        ----------
        standing : (6+n,) coordinates y in which the robot stands on ground of height 0
        stands : whether any foot stands
        """
        apart = 2 * step.margin  # [m] half of which the flight keeps, whose motion is not the program's between nodes
        with_feet = {body for body, _ in self.points.values()}
        rows = []
        for capsule in self.robot.solid_capsules:
            if not capsule.radius and (capsule.start == capsule.end).all():
                continue  # a point inside of other links
            # Capsules around feet reach into the ground on which these stand, but not as far as an obstacle of it.
            below = 0.0
            if capsule.body in with_feet:
                below = apart + (step.depth if stands else self._dip(capsule, standing))
            distance = self._distance_from_step(capsule, step, below)
            label = f"distance of {capsule.link} from the edge of the ground"
            rows.append(((distance - apart) / height, 0.0, np.inf, label))
        return rows

    def _dip(self, capsule: SolidCapsule, standing: Array) -> float:
        """By how much a capsule reaches into the ground where the robot stands, 2 mm at least, m."""
        body = self.bodies[capsule.body - 1]
        heights = [self.in_world(body.point(end))[0][2] for end in (capsule.start, capsule.end)]
        lowest = casadi().Function("lowest", [self.y], heights)(standing)
        return max(2e-3, capsule.radius - min(map(float, lowest)))

    def _distance_from_step(self, capsule: SolidCapsule, step: GroundStep, below: float) -> Any:
        """How far a capsule is above the higher ground less ``below``, or beyond its edge, what is more, m.

        Minimum, of the capsule's ends, and maximum are smooth: less than the minimum, and more than the maximum, by
        half of the smoothing where both are equal.
        """
        ca = casadi()
        smoothing = 0.01  # [m]
        body = self.bodies[capsule.body - 1]
        ends = [self.in_world(body.point(end))[0] for end in (capsule.start, capsule.end)]
        beyond, other_beyond = (step.inwards * (step.edge - end[step.axis]) for end in ends)
        above, other_above = (end[2] - step.high + below for end in ends)
        if (capsule.start != capsule.end).any():
            beyond = (beyond + other_beyond - ca.sqrt((beyond - other_beyond) ** 2 + smoothing**2)) / 2
            above = (above + other_above - ca.sqrt((above - other_above) ** 2 + smoothing**2)) / 2
        return (beyond + above + ca.sqrt((beyond - above) ** 2 + smoothing**2)) / 2 - capsule.radius

    def in_world(self, relative: Sequence[Any]) -> tuple[Any, Any, Any]:
        """A point with derivatives in the world, from the same relative to the base's origin."""
        orders = (self.y[:3], self.v[:3], self.a[:3])
        position, velocity, acceleration = (
            com + point - centre for com, point, centre in zip(orders, relative, self.centre, strict=True)
        )
        return position, velocity, acceleration

    def balance(self, forces: Mapping[str, Any]) -> Any:
        """Six rows that vanish where forces (3,), by the feet's names, are what it takes: N, N m about the centre."""
        ca = casadi()
        total = self.mass * (self.a[:3] + ca.DM([0.0, 0.0, self.gravity]))
        moment = self.moment_about_com
        for name, force in forces.items():
            _, position = self.contact(name)
            total -= force
            moment -= ca.cross(position - self.y[:3], force)
        return ca.vertcat(total, moment)

    def torques(self, forces: Mapping[str, Any]) -> Any:
        """Torques of all joints of the robot's model, N m, with forces (3,) by the feet's names."""
        ca = casadi()
        model = self.robot.model
        sums = [(force, moment) for force, moment in zip(self.forces, self.moments, strict=True)]
        origin = self.y[:3] - self.centre[0]
        for name, force in forces.items():
            number, position = self.contact(name)
            total, moment = sums[number]
            sums[number] = (total - force, moment - ca.cross(position - origin, force))
        torques = ca.SX.zeros(model.nv - BASE)
        for number in range(model.njoints - 1, 1, -1):
            total, moment = sums[number - 1]
            parent = model.parents[number] - 1
            index = model.joints[number].idx_v - BASE
            arm = self.bodies[number - 1].position
            torques[index] = ca.dot(self.joint_axes[number - 1], moment - ca.cross(arm, total))
            sums[parent] = (sums[parent][0] + total, sums[parent][1] + moment)
        return torques + ca.DM(model.armature[BASE:]) * self.joint_accelerations


def about(axis: Any, angle: Any) -> Any:
    """Rotation (3, 3) by an angle about a unit vector (3,) of numbers."""
    ca = casadi()
    cross = ca.sparsify(ca.DM(skew(axis)))
    squared = ca.sparsify(ca.DM(skew(axis) @ skew(axis)))
    return ca.DM.eye(3) + ca.sin(angle) * cross + (1 - ca.cos(angle)) * squared


def skew(vector: Any) -> Any:
    """Matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_with_rates(axes: str, angles: Any, rates: Any, accelerations: Any) -> tuple[Any, Any, Any]:
    """Rotation (3, 3), angular velocity and acceleration (3,), in the world's axes, of three angles about axes."""
    ca = casadi()
    rotation: Any = ca.DM.eye(3)
    rate: Any = ca.SX.zeros(3)
    rate_change: Any = ca.SX.zeros(3)
    for letter, angle, angle_rate, acceleration in zip(
        axes, *(ca.vertsplit(of_order) for of_order in (angles, rates, accelerations)), strict=True
    ):
        local = np.eye(3)["xyz".index(letter)]
        axis = ca.mtimes(rotation, ca.sparsify(ca.DM(local)))
        rate_change += axis * acceleration + ca.cross(rate, axis) * angle_rate
        rate += axis * angle_rate
        rotation = ca.mtimes(rotation, about(local, angle))
    return rotation, rate, rate_change
