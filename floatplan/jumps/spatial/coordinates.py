"""From base, angles and joints to Pinocchio's coordinates, and back; and what the motion of a robot asks of its feet.

A ``motion`` is an array (3, 6+n, N): the base's origin, m, its angles about ``axes`` and planned joints, rad, at N
instants, with their first and second derivatives. A ``com_motion`` has the centre of mass instead of the origin.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.spatial.model import BASE, skew
from floatplan.jumps.spatial.standing import Foot
from floatplan.motion.spatial.rotations import unwrapped_angles
from floatplan.robot.robot import Robot


def rotations_about(axes: str, angles: Array) -> Array:
    """Rotations (N, 3, 3) by angles (3, N) about axes."""
    rotation = np.broadcast_to(np.eye(3), (angles.shape[1], 3, 3))
    for letter, angle in zip(axes, angles, strict=True):
        rotation = rotation @ _about(letter, angle)
    return np.asarray(rotation)


def _about(letter: str, angles: Array) -> Array:
    """Rotations (N, 3, 3) by angles (N,) about one axis."""
    cross = skew(np.eye(3)["xyz".index(letter)])
    sines = np.sin(angles)[:, None, None]
    cosines = np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sines * cross + (1 - cosines) * (cross @ cross))


def rotation_with_rates(axes: str, angles: Array) -> tuple[Array, Array, Array]:
    """Rotations (N, 3, 3), angular velocities and accelerations (N, 3), in the world, of angles (3, 3, N) about axes.

    The angles have two derivatives: the first axis of their array is the order of these.
    """
    rotation = np.broadcast_to(np.eye(3), (angles.shape[2], 3, 3))
    directions = np.empty((3, angles.shape[2], 3))  # of the axes, in the world
    for index, letter in enumerate(axes):
        local = np.eye(3)["xyz".index(letter)]
        directions[index] = rotation @ local
        rotation = rotation @ _about(letter, angles[0, index])
    spins = directions * angles[1][:, :, None]
    rates = np.cumsum(spins, axis=0)
    changes = directions * angles[2][:, :, None]
    changes[1:] += np.cross(rates[:-1], spins[1:])  # an axis turns with all angles before it
    return np.asarray(rotation), rates[-1], changes.sum(axis=0)


def angles_of(axes: str, rotations: Array, rates: Array, rate_changes: Array, near: Array) -> Array:
    """Angles with two derivatives (3, 3, N) about axes, those that are nearest to the angles ``near`` (3, N).

    The inverse of :func:`rotation_with_rates`, by Newton's steps, which need the middle angle to be away from where the
    other two are one.
    """
    angles = near.copy()
    for _ in range(20):
        own = rotations_about(axes, angles)
        offset = np.array([pin.log3(goal @ now.T) for goal, now in zip(rotations, own, strict=True)])
        step = np.linalg.solve(_rate_map(axes, angles), offset[:, :, None])[:, :, 0].T
        angles += step
        if np.abs(step).max() < 1e-14:
            break
    rate_map = _rate_map(axes, angles)
    angle_rates = np.linalg.solve(rate_map, rates[:, :, None])[:, :, 0].T
    zero = np.zeros_like(angles)
    bias = rotation_with_rates(axes, np.stack((angles, angle_rates, zero)))[2]
    accelerations = np.linalg.solve(rate_map, (rate_changes - bias)[:, :, None])[:, :, 0].T
    return np.stack((angles, angle_rates, accelerations))


def _rate_map(axes: str, angles: Array) -> Array:
    """Matrices (N, 3, 3) from rates of angles (3, N) to angular velocities in the world."""
    columns = []
    for index in range(3):
        local = np.eye(3)["xyz".index(axes[index])]
        before = rotations_about(axes[:index], angles[:index]) if index else np.eye(3)[None]
        columns.append(np.broadcast_to(before @ local, (angles.shape[1], 3)))
    return np.stack(columns, axis=2)


def best_axes(attitudes: Array) -> str:
    """Return the order of angles about axes whose middle one stays smallest in attitudes (K, 3, 3)."""
    orders = ("zyx", "yxz", "xyz", "yzx", "xzy", "zxy")
    return min(orders, key=lambda axes: float(np.abs(unwrapped_angles(axes, attitudes)[:, 1]).max()))


def of_contact(jacobian: Array, radius: float) -> Array:
    """Jacobian (3, k) of a ball's lowest point, from that of its centre (6, k), linear and angular, in the world."""
    if not radius:
        return np.asarray(jacobian[:3])
    return np.asarray(jacobian[:3] + radius * skew([0.0, 0.0, 1.0]) @ jacobian[3:])


class Mechanics:
    """A robot's places, velocities and forces at single instants, by Pinocchio, with gravity.

    Feet are named by their points; each method takes and returns motions of the base's origin, but for
    :meth:`from_centre`.

    Attributes
    ----------
    robot : Robot
    axes : of the base's angles
    model : pinocchio.Model, the robot's with gravity and a frame for each foot
    frame_numbers : of the feet, by their names: numbers of their frames in the model
    radii : of the feet, by their names: of the balls that roll, m; 0 of feet that do not
    legs : of the feet, by their names: indices of the planned joints that carry them
    """

    def __init__(self, robot: Robot, axes: str, gravity: float, feet: Sequence[Foot]) -> None:
        self.robot = robot
        self.axes = axes
        self.gravity = gravity
        self.model = robot.model.copy()
        self.model.gravity.linear = np.array([0.0, 0.0, -gravity])
        self.frame_numbers: dict[str, int] = {}
        for foot in feet:
            if foot.name not in self.frame_numbers:
                placement = pin.SE3(np.eye(3), np.array(foot.local))
                frame = pin.Frame(f"contact of {foot.name}", foot.body, 0, placement, pin.FrameType.OP_FRAME)
                self.frame_numbers[foot.name] = self.model.addFrame(frame)
        self.radii = {foot.name: foot.radius for foot in feet}
        self.data = self.model.createData()
        self.legs = {foot.name: tuple(self._leg(foot)) for foot in feet}

    def _leg(self, foot: Foot) -> list[int]:
        """Indices of the planned joints that carry a foot."""
        carrying = set()
        joint = foot.body
        while joint > 1:
            carrying.add(self.model.joints[joint].idx_v)
            joint = self.model.parents[joint]
        selection = self.robot.selection
        return [index for index in range(selection.shape[1]) if carrying & set(np.flatnonzero(selection[:, index]))]

    def coordinates(self, motion: Array) -> tuple[Array, Array, Array]:
        """Pinocchio's q (N, nq), v and a (N, nv) of a motion (3, 6+n, N)."""
        robot = self.robot
        rotation, rate, rate_change = rotation_with_rates(self.axes, motion[:, 3:BASE])
        base = motion[:, :3].transpose(0, 2, 1)
        joints = motion[:, BASE:].transpose(0, 2, 1) @ robot.selection[BASE:].T
        back = rotation.transpose(0, 2, 1)
        linear = np.einsum("nij,nj->ni", back, base[1])
        angular = np.einsum("nij,nj->ni", back, rate)
        linear_change = np.einsum("nij,nj->ni", back, base[2]) - np.cross(angular, linear)
        angular_change = np.einsum("nij,nj->ni", back, rate_change)
        quaternions = np.array([pin.Quaternion(one).coeffs() for one in rotation])
        q = np.hstack((base[0], quaternions, robot.reference[BASE + 1 :] + joints[0]))
        v = np.hstack((linear, angular, joints[1]))
        a = np.hstack((linear_change, angular_change, joints[2]))
        return q, v, a

    def from_coordinates(self, q: Array, v: Array, a: Array, near: Array) -> Array:
        """The motion (3, 6+n, N) of Pinocchio's q (N, nq), v and a (N, nv), its angles nearest to ``near`` (3, N)."""
        rotation = np.array([pin.Quaternion(*one[[6, 3, 4, 5]]).matrix() for one in q])
        linear, angular = v[:, :3], v[:, 3:BASE]
        base_velocity = np.einsum("nij,nj->ni", rotation, linear)
        base_acceleration = np.einsum("nij,nj->ni", rotation, a[:, :3] + np.cross(angular, linear))
        rate = np.einsum("nij,nj->ni", rotation, angular)
        rate_change = np.einsum("nij,nj->ni", rotation, a[:, 3:BASE])
        joints = np.linalg.pinv(self.robot.selection[BASE:])
        motion = np.empty((3, BASE + len(joints), len(q)))
        motion[:, :3] = np.stack((q[:, :3], base_velocity, base_acceleration)).transpose(0, 2, 1)
        motion[:, 3:BASE] = angles_of(self.axes, rotation, rate, rate_change, near)
        positions = q[:, BASE + 1 :] - self.robot.reference[BASE + 1 :]
        motion[:, BASE:] = np.stack([joints @ order.T for order in (positions, v[:, BASE:], a[:, BASE:])])
        return motion

    def wrench(self, motion: Array) -> Array:
        """Forces (N, nv) on all coordinates that a motion takes, by RNEA, gravity's included."""
        return self.wrench_of(self.coordinates(motion))

    def wrench_of(self, coordinates: tuple[Array, Array, Array]) -> Array:
        """As :meth:`wrench`, of Pinocchio's q, v and a."""
        return np.array([pin.rnea(self.model, self.data, *row) for row in zip(*coordinates, strict=True)])

    def base_wrench(self, motion: Array) -> Array:
        """Force, N, and moment about the base's origin, N m, in the world's axes (N, 6), that a motion takes."""
        return self._base_wrench(motion, self.coordinates(motion))

    def _base_wrench(self, motion: Array, coordinates: tuple[Array, Array, Array]) -> Array:
        rotation = rotations_about(self.axes, motion[0, 3:BASE])
        wrench = self.wrench_of(coordinates)
        force = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
        moment = np.einsum("nij,nj->ni", rotation, wrench[:, 3:BASE])
        return np.hstack((force, moment))

    def centre(self, motion: Array) -> tuple[Array, Array]:
        """Centre of mass of a motion with two derivatives (3, 3, N), and angular momentum about it (3, N)."""
        centres = np.empty((3, 3, motion.shape[2]))
        momenta = np.empty((3, motion.shape[2]))
        for index, (q, v, a) in enumerate(zip(*self.coordinates(motion), strict=True)):
            pin.centerOfMass(self.model, self.data, q, v, a)
            centres[:, :, index] = self.data.com[0], self.data.vcom[0], self.data.acom[0]
            pin.computeCentroidalMomentum(self.model, self.data, q, v)
            momenta[:, index] = self.data.hg.angular
        return centres, momenta

    def from_centre(self, com_motion: Array) -> Array:
        """The motion (3, 6+n, N), whose first rows are the base's origin, of one whose are the centre of mass."""
        at_origin = com_motion.copy()
        at_origin[:, :3] = 0.0
        centres, _ = self.centre(at_origin)
        motion = com_motion.copy()
        motion[:, :3] -= centres
        return motion

    def feet(self, motion: Array, names: Sequence[str]) -> Array:
        """Places of feet in a motion with two derivatives (3, N, F, 3), m.

        Of feet that roll, balls of radius r about C, they are C and what of its motion is no rolling,
        ``C' - w x r e_z`` and ``C'' - w' x r e_z``.
        """
        coordinates = self.coordinates(motion)
        places, _ = self.places_and_jacobians(coordinates[0], names, of_slip=False)
        velocities = self._derivative(1, coordinates, names)
        accelerations = self._derivative(2, coordinates, names)
        return np.stack((places, velocities, accelerations))

    def places_and_jacobians(self, q: Array, names: Sequence[str], of_slip: bool) -> tuple[Array, Array]:
        """Places of feet (N, F, 3), m, at Pinocchio's q (N, nq), and Jacobians (N, F, 3, n) by planned joints.

        The Jacobians are those of the places, or ``of_slip``: of what is no rolling in the feet's velocities, which of
        balls is the velocity of their lowest points.
        """
        places = np.empty((len(q), len(names), 3))
        jacobians = np.empty((*places.shape, self.robot.selection.shape[1]))
        for index, configuration in enumerate(q):
            pin.computeJointJacobians(self.model, self.data, configuration)
            pin.updateFramePlacements(self.model, self.data)
            for column, name in enumerate(names):
                number = self.frame_numbers[name]
                places[index, column] = self.data.oMf[number].translation
                jacobian = pin.getFrameJacobian(self.model, self.data, number, pin.LOCAL_WORLD_ALIGNED)
                radius = self.radii[name] if of_slip else 0.0
                jacobians[index, column] = of_contact(jacobian, radius) @ self.robot.selection
        return places, jacobians

    def _derivative(self, order: int, coordinates: tuple[Array, ...], names: Sequence[str]) -> Array:
        """First or second derivatives (N, F, 3) of feet by Pinocchio's q, v and a, less what is rolling."""
        rows = coordinates[: order + 1]
        of_frame = pin.getFrameVelocity if order == 1 else pin.getFrameClassicalAcceleration
        derivatives = np.empty((len(rows[0]), len(names), 3))
        spins = np.empty_like(derivatives)
        for index, of_time in enumerate(zip(*rows, strict=True)):
            pin.forwardKinematics(self.model, self.data, *of_time)
            for column, name in enumerate(names):
                moves = of_frame(self.model, self.data, self.frame_numbers[name], pin.LOCAL_WORLD_ALIGNED)
                derivatives[index, column] = moves.linear
                spins[index, column] = moves.angular
        above = np.array([[0.0, 0.0, self.radii[name]] for name in names])
        return np.asarray(derivatives - np.cross(spins, above))

    def close(self, motion: Array, places: dict[str, Array]) -> Array:
        """The motion with legs whose feet, by name, stand at places (3,), with the least changes of their joints.

        Of feet that roll they are places of the centres, which such feet have at single instants.
        """
        names = list(places)
        targets = np.array([places[name] for name in names])
        closed = motion.copy()
        if not names:
            return closed
        coordinates = self.coordinates(closed)
        for _ in range(12):
            now, jacobians = self.places_and_jacobians(coordinates[0], names, of_slip=False)
            gaps = targets - now
            self._move(closed, coordinates, 0, self._inverses(names, jacobians), gaps)
            if np.abs(gaps).max() < 1e-12:
                break
        self._hold_feet(closed, coordinates, names, (1, 2))
        return closed

    def unaccelerated(self, motion: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """The motion with legs whose feet, which do not move, have no acceleration; its :meth:`base_wrench`."""
        still = motion.copy()
        coordinates = self.coordinates(still)
        self._hold_feet(still, coordinates, names, (2,))
        return still, self._base_wrench(still, coordinates)

    def hold_feet(self, motion: Array, names: Sequence[str], *orders: int) -> None:
        """Change derivatives of these orders, 1 or 2, of a motion's joints, so that its feet have none, but roll."""
        self._hold_feet(motion, self.coordinates(motion), names, orders)

    def _hold_feet(
        self, motion: Array, coordinates: tuple[Array, Array, Array], names: Sequence[str], orders: Sequence[int]
    ) -> None:
        """As :meth:`hold_feet`, with the motion's coordinates, which change with it."""
        _, jacobians = self.places_and_jacobians(coordinates[0], names, of_slip=True)
        inverses = self._inverses(names, jacobians)
        for order in orders:
            self._move(motion, coordinates, order, inverses, -self._derivative(order, coordinates, names))

    def _inverses(self, names: Sequence[str], jacobians: Array) -> list[tuple[list[int], list[int], Array]]:
        """Feet and joints of legs, with the inverses (N, joints, 3 feet) that move all points of a leg at once."""
        inverses = []
        for leg in {self.legs[name] for name in names}:
            columns = [column for column, name in enumerate(names) if self.legs[name] == leg]
            of_leg = jacobians[:, columns][:, :, :, list(leg)].reshape(len(jacobians), 3 * len(columns), len(leg))
            # Three points of a sole are nine rows of a pose's six: what is left of the others is rounding.
            inverse = np.asarray(np.linalg.pinv(of_leg, rcond=1e-9), np.float64)
            inverses.append((columns, list(leg), inverse))
        return inverses

    def _move(
        self,
        motion: Array,
        coordinates: tuple[Array, Array, Array],
        order: int,
        inverses: list[tuple[list[int], list[int], Array]],
        gaps: Array,
    ) -> None:
        """Add to a derivative of a motion's joints, and of its coordinates, what moves feet by gaps (N, F, 3)."""
        for columns, leg, inverse in inverses:
            changes = np.einsum("nij,nj->ni", inverse, gaps[:, columns].reshape(len(gaps), -1))
            motion[order, [BASE + joint for joint in leg]] += changes.T
            of_model = self.robot.selection[BASE:, leg]  # all joints of the model by those of the leg
            coordinates[order][:, -len(of_model) :] += changes @ of_model.T  # a view: each joint has one coordinate
