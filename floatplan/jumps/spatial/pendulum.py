"""A robot on few feet, next to a flight: the motion of its base that they bear.

On two feet it is turned as a whole about the line through them, so that the moment about it vanishes. With a motion of
base and joints at hand, its feet at a and b, n along b - a and Q(d) the rotation by d about n, the robot is where
``a + Q (x - a)`` is of its points x. Of its acceleration ``d''`` the moment about the line is affine: two evaluations
of the inverse dynamics give the differential equation of d, an inverted pendulum's.

On one sole, whose points are near one another, a motion that is interpolated between nodes takes negative forces,
next to the flight above all, where there is little force. Forces that are linear between nodes stay inside the friction
cones, and the centre of pressure inside the sole. So they are taken as they are, and the base's pose is integrated from
the flight's end on; the legs that stand follow from it.

Legs whose feet are balls that roll do not follow from where these stand: with a motion of the base their positions have
a differential equation, ``J q' + u = 0``, u what the ball's lowest point would move by with the leg's joints still. On
two such feet the base leaves the motion at hand in one direction, by d(t): that of a rotation about the line through
both. The moment about the line through their contacts is affine in ``d''``, as above.

All motions here have the base's origin in their first rows. A motion is integrated from its ``fixed_end``, 0 or -1, the
index of the end at which it is as it is, to the other one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.motion import quintic_spline, refined, values
from floatplan.jumps.spatial.coordinates import Mechanics, angles_of, of_contact, rotation_with_rates
from floatplan.jumps.spatial.model import BASE, skew

Slope: TypeAlias = Callable[[int, Array], Array]  # derivative of a state at one of some instants


@dataclass(frozen=True, eq=False)
class Line:
    """The line through two feet: a point (3,) of it, m, and its direction (3,)."""

    point: Array
    direction: Array

    @classmethod
    def through(cls, places: dict[str, Array]) -> "Line":
        """Through the places of two feet."""
        first, second = places.values()
        along = second - first
        return cls(first, along / np.linalg.norm(along))

    def rotated_robot(self, axes: str, motion: Array, angle: Array) -> Array:
        """A motion (3, 6+n, N) with the whole robot rotated about the line by an angle with two derivatives (3, N)."""
        n = self.direction
        rotation, rate, rate_change = rotation_with_rates(axes, motion[:, 3:BASE])
        own = np.array([pin.exp3(n * one) for one in angle[0]])
        of_time = angle[:, :, None]

        def by_own(vectors: Array) -> Array:
            return np.asarray(np.einsum("nij,nj->ni", own, vectors))

        arm = by_own(motion[0, :3].T - self.point)
        velocity = by_own(motion[1, :3].T)
        acceleration = by_own(motion[2, :3].T)
        across = np.cross(n, arm)
        result = motion.copy()
        result[0, :3] = (self.point + arm).T
        result[1, :3] = (velocity + of_time[1] * across).T
        inwards = np.cross(n, across)
        coriolis = 2 * of_time[1] * np.cross(n, velocity)
        result[2, :3] = (acceleration + coriolis + of_time[2] * across + of_time[1] ** 2 * inwards).T
        turning = by_own(rate)
        rates = turning + of_time[1] * n
        changes = by_own(rate_change) + of_time[2] * n + of_time[1] * np.cross(n, turning)
        result[:, 3:BASE] = angles_of(axes, own @ rotation, rates, changes, motion[0, 3:BASE])
        return result


class Pendulum:
    """The differential equation of the angle by which a motion (3, 6+n, N) is rotated, at its instants.

    ``d'' = f(d, d')``.

    It is that of the robot as it is, in a world that turns about the line with it: gravity turns the other way.
    """

    def __init__(self, mechanics: Mechanics, line: Line, motion: Array) -> None:
        self.mechanics = mechanics
        self.line = line
        self.gravity = np.array(mechanics.model.gravity.linear)
        self.model = mechanics.model.copy()
        self.data = self.model.createData()
        self.q, self.v, self.a = mechanics.coordinates(motion)
        rotations, self.rates, _ = rotation_with_rates(mechanics.axes, motion[:, 3:BASE])
        self.back = rotations.transpose(0, 2, 1)
        # Everything turns about one direction n: products n x .. are taken once, not at each evaluation.
        about_line = skew(line.direction).T
        self.across = (motion[0, :3].T - line.point) @ about_line
        self.inwards = self.across @ about_line
        self.sideways = motion[1, :3].T @ about_line
        self.tilting = self.rates @ about_line
        self.bias = np.cross(self.v[:, 3:BASE], self.v[:, :3])

    def acceleration(self, index: int, angle: float, rate: float) -> float:
        """The angle's acceleration at an instant."""
        self.model.gravity.linear = pin.exp3(-angle * self.line.direction) @ self.gravity
        moment = self._moment(index, rate, 0.0)
        return -moment / (self._moment(index, rate, 1.0) - moment)

    def _moment(self, index: int, rate: float, acceleration: float) -> float:
        """Moment about the line, N m, with the robot turning about it as well."""
        n = self.line.direction
        back = self.back[index]
        across = self.across[index]
        # Accelerations of the base's origin, and of its turning, in addition to those of the motion.
        pushed = 2 * rate * self.sideways[index] + acceleration * across + rate**2 * self.inwards[index]
        spun = acceleration * n + rate * self.tilting[index]
        v = self.v[index].copy()
        v[:3] += back @ (rate * across)
        v[3:BASE] += back @ (rate * n)
        # Pinocchio's acceleration of the base is the derivative of its velocity in its own axes.
        a = self.a[index].copy()
        a[:3] += back @ pushed - skew(v[3:BASE]) @ v[:3] + self.bias[index]
        a[3:BASE] += back @ spun
        wrench = pin.rnea(self.model, self.data, self.q[index], v, a)
        return float(wrench[3:BASE] @ (back @ n) + (back.T @ wrench[:3]) @ across)

    def slope(self, index: int, state: Array) -> Array:
        """Derivative (2,) of angle and rate at an instant."""
        return np.array([state[1], self.acceleration(index, state[0], state[1])])


def balanced_about(mechanics: Mechanics, line: Line, times: Array, motion: Array, fixed_end: int) -> Array:
    """The motion (3, 6+n, G) rotated about a line by an angle that is nothing at its fixed end, 0 or -1.

    Its moment about the line vanishes.
    """
    curve = quintic_spline(times, motion)
    count = 4  # [-] half steps of a step of the grid, of two Runge-Kutta steps
    fine = refined(times, count)[:: 1 if fixed_end == 0 else -1]
    pendulum = Pendulum(mechanics, line, values(curve, np.clip(fine, times[0], times[-1])))
    angle = np.zeros((3, len(times)))
    state = np.zeros(2)
    for index in range(len(times)):
        at = index * count
        angle[:2, index] = state
        slope = pendulum.slope(at, state)
        angle[2, index] = slope[1]
        if index < len(times) - 1:
            for begin in range(at, at + count, 2):
                first = slope if begin == at else pendulum.slope(begin, state)
                state = _runge_kutta(pendulum.slope, begin, state, first, fine[begin + 2] - fine[begin])
    return line.rotated_robot(mechanics.axes, motion, angle[:, :: 1 if fixed_end == 0 else -1])


def _runge_kutta(slope: Slope, begin: int, state: Array, first: Array, step: float) -> Array:
    """State after a step from the instant ``begin``, whose slope is ``first``, to the second one after it."""
    second = slope(begin + 1, state + step / 2 * first)
    third = slope(begin + 1, state + step / 2 * second)
    fourth = slope(begin + 2, state + step * third)
    return np.asarray(state + step / 6 * (first + 2 * second + 2 * third + fourth))


class PushedBase:
    """The differential equation of the base's pose at some instants.

    Attributes
    ----------
    mechanics : Mechanics
    motion : (3, 6+n, N) of the joints that do not stand
    forces : (N, F, 3) N on the feet
    places : of each foot, its name -> (3,) m
    """

    def __init__(self, mechanics: Mechanics, motion: Array, forces: Array, places: dict[str, Array]) -> None:
        self.mechanics = mechanics
        self.motion = motion
        self.forces = forces
        self.places = places

    def closed(self, index: int, pose: Array, rate: Array) -> Array:
        """The motion (3, 6+n, 1) at an instant, with a pose of the base (6,) and its rate, the feet standing."""
        at_instant = self.motion[:, :, [index]].copy()
        at_instant[0, :BASE, 0] = pose
        at_instant[1, :BASE, 0] = rate
        return self.mechanics.close(at_instant, self.places)

    def pushed(self, index: int, state: Array) -> Array:
        """The motion (3, 6+n, 1) at an instant with pose and rate (12,), whose feet bear what it takes."""
        pose, rate = np.split(state, 2)
        # The wrench is affine in the base's accelerations: one column without, and one for each of the six.
        varied = np.repeat(self.closed(index, pose, rate), 1 + BASE, axis=2)
        varied[2, :BASE, 1:] += np.eye(BASE)
        varied, wrenches = self.mechanics.unaccelerated(varied, list(self.places))
        forces = self.forces[index]
        arms = np.array(list(self.places.values())) - pose[:3]
        borne = np.concatenate((forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)))
        change = np.linalg.solve((wrenches[1:] - wrenches[0]).T, borne - wrenches[0])
        pushed = varied[:, :, :1].copy()
        pushed[2] += (varied[2, :, 1:] - varied[2, :, :1]) @ change[:, None]  # so are those of the legs
        return pushed

    def slope(self, index: int, state: Array) -> Array:
        """Derivative (12,) of pose and rate at an instant."""
        return self.slope_in(self.pushed(index, state))

    @staticmethod
    def slope_in(pushed: Array) -> Array:
        """Derivative (12,) of pose and rate in a motion (3, 6+n, 1)."""
        return np.asarray(pushed[1:, :BASE, 0].ravel())


def pushed_from(
    mechanics: Mechanics,
    times: Array,
    motion: Array,
    planned_forces: Array,
    places: dict[str, Array],
    fixed_end: int,
) -> Array:
    """The motion (3, 6+n, G) whose base is pushed by forces, from its fixed end to the other.

    Parameters
    ----------
    mechanics : Mechanics
    times : (G,) s
    motion : (3, 6+n, G)
    planned_forces : (3 F, G) of the feet, N, linear between these times
    places : of the F feet, name -> (3,) m
    fixed_end : 0 or -1
    """
    direction = 1 if fixed_end == 0 else -1
    fine = refined(times, 2)  # each Runge-Kutta step needs its middle
    forces = np.stack([np.interp(fine, times, row) for row in planned_forces]).T.reshape(len(fine), -1, 3)
    varied = values(quintic_spline(times, motion), np.clip(fine, times[0], times[-1]))
    base = PushedBase(mechanics, varied[:, :, ::direction], forces[::direction], places)
    steps = np.diff(fine[::direction][::2])
    state = np.concatenate((motion[0, :BASE, fixed_end], motion[1, :BASE, fixed_end]))
    columns = []
    for column in range(len(times)):
        at = 2 * column
        pushed = base.pushed(at, state)
        columns.append(pushed)
        if column < len(steps):
            state = _runge_kutta(base.slope, at, state, base.slope_in(pushed), float(steps[column]))
    return np.concatenate(columns[::direction], axis=2)


class RollingRobot:
    """The differential equation of legs whose feet roll, and of the base in a direction that nothing bears.

    Its state is d, d' and the positions of the legs' joints.

    Attributes
    ----------
    mechanics : Mechanics
    motion : (3, 6+n, N) of the base, but for d, and of joints that are in none of these legs
    direction : (6,) of the base's coordinates, by which d moves them; None where the feet bear any motion of the base
    joints : rows of the legs' joints in such a motion
    balls : the feet that roll
    """

    def __init__(self, mechanics: Mechanics, names: Sequence[str], motion: Array, direction: Array | None) -> None:
        self.mechanics = mechanics
        self.motion = motion
        self.direction = direction
        self.balls: list[_Ball] = []
        rows: list[int] = []
        for name in names:
            ball = _Ball(mechanics, name)
            self.balls.append(ball)
            rows += ball.rows
        self.joints = np.unique(rows)

    def slope(self, index: int, state: Array) -> Array:
        """Derivative of the state at an instant."""
        at_instant = self.motion_at(index, state)
        of_directions = np.repeat(at_instant, 2, axis=2)
        if self.direction is not None:
            of_directions[1, :, 1] = 0.0
            of_directions[1, :BASE, 1] = self.direction
        q, v, a = self.mechanics.coordinates(of_directions)
        pin.computeJointJacobians(self.mechanics.model, self.mechanics.data, q[0])
        rates = v[0].copy()
        for ball in self.balls:
            ball.locate()
            change = ball.joint_rates(v[0])
            at_instant[1, ball.rows, 0] -= change
            rates -= ball.columns @ change
        pushed = 0.0 if self.direction is None else self._acceleration(q[0], rates, a[0], v[1])
        return np.concatenate(([state[1], pushed], at_instant[1, self.joints, 0]))

    def motion_at(self, index: int, state: Array) -> Array:
        """The motion (3, 6+n, 1) at an instant in a state; of the legs it has only the positions."""
        at_instant = self.motion[:, :, [index]].copy()
        if self.direction is not None:
            at_instant[0, :BASE, 0] += state[0] * self.direction
            at_instant[1, :BASE, 0] += state[1] * self.direction
        at_instant[0, self.joints, 0] = state[2:]
        return at_instant

    def _acceleration(self, q: Array, v: Array, a: Array, along: Array) -> float:
        """The second derivative of d with which the moment about the line through both contacts vanishes.

        Parameters
        ----------
        q, v, a : Pinocchio's coordinates, with which the feet roll but for their accelerations
        along : (nv,) velocity of the base's coordinates where d' is 1
        """
        model = self.mechanics.model
        data = self.mechanics.data
        pin.forwardKinematics(model, data, q, v, a)
        changes = a.copy()
        more = along.copy()
        for ball in self.balls:
            changes -= ball.columns @ ball.joint_accelerations()
            more -= ball.columns @ ball.joint_rates(along)
        rotation = data.oMi[1].rotation
        first, second = (ball.contact for ball in self.balls)
        arm = skew(first - data.oMi[1].translation)
        moments = []
        for accelerations in (changes, changes + more):
            wrench = pin.rnea(model, data, q, v, accelerations)
            moment = rotation @ wrench[3:BASE] - arm @ (rotation @ wrench[:3])
            moments.append(float(moment @ (second - first)))
        return moments[0] / (moments[0] - moments[1])


class _Ball:
    """A foot that rolls, in the configuration that its mechanics' data have.

    Attributes
    ----------
    rows : of its leg's joints in motions
    columns : (nv, k) velocities of all coordinates by the rates of these joints
    contact : (3,) m, its lowest point
    jacobian : (3, nv) of the velocity of that point
    """

    def __init__(self, mechanics: Mechanics, name: str) -> None:
        self.mechanics = mechanics
        self.frame_number = mechanics.frame_numbers[name]
        self.above = np.array([0.0, 0.0, mechanics.radii[name]])
        leg = list(mechanics.legs[name])
        self.rows = [BASE + joint for joint in leg]
        self.columns = mechanics.robot.selection[:, leg]
        self.contact: Array = np.zeros(3)
        self.jacobian: Array = np.zeros((3, mechanics.model.nv))
        self._by_velocity: Array = np.zeros((len(leg), 3))

    def locate(self) -> None:
        """Take contact and Jacobian of the data, whose joints' Jacobians are of this configuration."""
        model = self.mechanics.model
        data = self.mechanics.data
        frame = model.frames[self.frame_number]
        aligned = pin.LOCAL_WORLD_ALIGNED
        jacobian = pin.getFrameJacobian(model, data, frame.parentJoint, frame.placement, aligned)
        self.jacobian = of_contact(jacobian, self.above[2])
        self.contact = data.oMi[frame.parentJoint].act(frame.placement.translation) - self.above
        self._by_velocity = np.asarray(np.linalg.pinv(self.jacobian @ self.columns), np.float64)

    def joint_rates(self, v: Array) -> Array:
        """Rates (k,) of its leg's joints that move the lowest point as velocities (nv,) of all coordinates do."""
        return np.asarray(self._by_velocity @ (self.jacobian @ v))

    def joint_accelerations(self) -> Array:
        """Accelerations (k,) of its leg's joints that make it slip as the motion does of which the data are."""
        model = self.mechanics.model
        aligned = pin.LOCAL_WORLD_ALIGNED
        acceleration = pin.getFrameClassicalAcceleration(model, self.mechanics.data, self.frame_number, aligned)
        return np.asarray(self._by_velocity @ (acceleration.linear + skew(self.above) @ acceleration.angular))


def rolled_from(
    mechanics: Mechanics, names: Sequence[str], times: Array, motion: Array, fixed_end: int, direction: Array | None
) -> Array:
    """The motion (3, 6+n, G) with legs that roll from its fixed end on.

    Parameters
    ----------
    mechanics : Mechanics
    names : of the feet that roll
    times : (G,) s
    motion : (3, 6+n, G)
    fixed_end : 0 or -1
    direction : as of :class:`RollingRobot`
    """
    onwards = 1 if fixed_end == 0 else -1
    fine = refined(times, 2)  # each Runge-Kutta step needs its middle
    between = values(quintic_spline(times, motion), np.clip(fine, times[0], times[-1]))
    robot = RollingRobot(mechanics, names, between[:, :, ::onwards], direction)
    steps = np.diff(fine[::onwards][::2])
    state = np.concatenate(([0.0, 0.0], motion[0, robot.joints, fixed_end]))
    columns = []
    for column in range(len(times)):
        slope = robot.slope(2 * column, state)
        at_instant = robot.motion_at(2 * column, state)
        if direction is not None:
            at_instant[2, :BASE, 0] += slope[1] * direction
        columns.append(at_instant)
        if column < len(steps):
            state = _runge_kutta(robot.slope, 2 * column, state, slope, float(steps[column]))
    rolled = np.concatenate(columns[::onwards], axis=2)
    mechanics.hold_feet(rolled, names, 1, 2)
    if not np.isfinite(rolled).all():
        raise NoExactStanceError("legs that roll do not reach the ground")
    return rolled
