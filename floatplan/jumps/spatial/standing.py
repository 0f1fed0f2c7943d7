"""Where a robot stands: feet as points, the posture in which all are level, what stays above, how far legs lift it."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull, QhullError

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.problem.attitude import Attitude
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid, frame_position
from floatplan.robot.standing import ROLLED, may_roll

DOWN = np.array([0.0, 0.0, -1.0])
LEVEL = 1e-6  # [m] by which heights of feet that stand may differ


@dataclass(frozen=True)
class Foot:
    """A point on which the robot stands: a foot, one of the three points of a sole, or the centre of a rolling ball.

    Attributes
    ----------
    frame : its name; the origin of this link or joint is the point, unless it is of a sole
    body : joint of the robot's model that carries it
    local : (3,) m, in that joint's frame
    depth : height of the point over the ground where it stands, m
    suffix : of a sole's point, one of :attr:`of_soles`; else empty
    radius : of the ball about it that rolls on the ground, m; 0 for a foot that turns about its point
    """

    of_soles: ClassVar[tuple[str, str, str]] = (".heel", ".left_toe", ".right_toe")

    frame: str
    body: int
    local: tuple[float, float, float]
    depth: float
    suffix: str = ""
    radius: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its points, by which forces are listed."""
        return (self.name,)

    @property
    def name(self) -> str:
        """The point's name."""
        return self.frame + self.suffix

    @property
    def stays(self) -> Array:
        """In which directions (3,) it stays where it stands, 1 or 0: what rolls keeps only its height."""
        return np.array([0.0, 0.0, 1.0]) if self.radius else np.ones(3)


class Kinematics:
    """Places of a robot's points in configurations, by Pinocchio."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = robot.model
        self.data = robot.model.createData()

    def pose(self, base: Array, rotation: Array, joints: Array) -> Array:
        """Set the base's origin (3,), m, and rotation (3, 3), and planned joints (n,); return the configuration."""
        q = self.robot.configuration(joints)
        q[:3] = base
        q[3:7] = pin.Quaternion(rotation).coeffs()
        pin.forwardKinematics(self.model, self.data, q)
        return q

    def point(self, body: int, local: Sequence[float] | Array) -> Array:
        """Where a point of a body is, (3,) m, in the configuration that was set last."""
        return np.asarray(self.data.oMi[body].act(np.asarray(local, float)))

    def lowest(self, links: Sequence[str]) -> float:
        """Height of the lowest point of the solids of links, m."""
        heights = []
        for solid in self.robot.solids:
            if solid.link in links:
                placement = self.data.oMi[solid.body]
                reach = solid.reach((DOWN @ placement.rotation)[None])[0]
                heights.append(placement.translation[2] - reach)
        return float(min(heights, default=math.inf))


def feet_at(robot: Robot, frame: str, attitude: Attitude, joints: Array, key: str) -> tuple[Foot, ...]:
    """Return the points of a frame's foot: the frame's origin, or three of a flat sole, in a posture that stands.

    Raises
    ------
    InputError
        Its link has no shape.
    """
    body, local = frame_position(robot.model, robot.joint_tree, frame)
    link = frame if frame in robot.joint_tree.links else robot.joint_tree.joint[frame].child
    own = robot.contact_link(link)
    if own is None or body < 2:
        reason = f"{frame!r} has no shape with which it could stand on the ground, or is the base"
        raise InputError(reason, element=key, advice="name a foot")
    kinematics = Kinematics(robot)
    kinematics.pose(np.zeros(3), attitude.matrix, joints)
    point = kinematics.point(body, local)
    ground = kinematics.lowest([own])
    lowest = _lowest_points(kinematics, own)
    largest = 0.06  # [m] from a foot's point to the end of a sole: larger ones stand on soles, not on points
    if point[2] >= ground and np.linalg.norm((lowest - point)[:, :2], axis=1).max() <= largest:
        return (Foot(frame, body, tuple(local.tolist()), float(point[2] - ground)),)
    placement = kinematics.data.oMi[body]
    feet = []
    for suffix, position in zip(Foot.of_soles, _sole_points(lowest, attitude), strict=True):
        x, y, z = placement.actInv(np.array([*position, ground])).tolist()
        feet.append(Foot(frame, body, (x, y, z), 0.0, suffix))
    return tuple(feet)


def rolling(robot: Robot, foot: Foot, attitude: Attitude, joints: Array) -> Foot:
    """Return a foot that rolls on a ball about its frame down to the ground, in a posture that stands.

    Raises
    ------
    InputError
        The shape of its link is no such ball near its lowest point, as far as a foot may roll.
    """
    kinematics = Kinematics(robot)
    kinematics.pose(np.zeros(3), attitude.matrix, joints)
    reason = "is a sole"
    if not foot.suffix:
        off = _off_ball(kinematics, foot)
        if may_roll(off, foot.depth):
            return replace(foot, radius=foot.depth)
        reason = f"is no ball about it, by {1e3 * off:.0f} mm" if foot.depth > 0 else "is a point"
    raise InputError(
        f"{foot.frame!r} cannot roll: its link {reason}",
        element="jump.feet",
        advice='name a frame at the centre of a round foot, or let feet = "points"',
    )


def _off_ball(kinematics: Kinematics, foot: Foot) -> float:
    """By how much, m, a foot's link is no ball of the foot's depth about its point, where it may roll.

    That is so far about its lowest point, in the configuration that was set last.
    """
    tilts = np.linspace(0.0, ROLLED, 13)  # 5 degrees apart
    headings = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)  # 15 degrees
    tilt, heading = np.meshgrid(tilts, headings)
    across = np.sin(tilt)
    directions = np.stack((across * np.cos(heading), across * np.sin(heading), -np.cos(tilt)), axis=-1).reshape(-1, 3)
    in_joint = directions @ kinematics.data.oMi[foot.body].rotation
    links = feet_links(kinematics.robot, [foot])
    reaches = [solid.reach(in_joint) for solid in kinematics.robot.solids if solid.link in links]
    from_point = np.max(reaches, axis=0) - in_joint @ np.array(foot.local)
    return float(np.abs(from_point - foot.depth).max())


def _lowest_points(kinematics: Kinematics, link: str) -> Array:
    """What of a link is on the ground, or within 5 mm of it (N, 3), m, in the configuration that was set last."""
    nearly = 5e-3  # [m]
    points = []
    for solid in kinematics.robot.solids:
        if solid.link == link:
            placement = kinematics.data.oMi[solid.body]
            below = float(np.linalg.norm(DOWN @ placement.rotation @ solid.axes))
            in_world = solid.points @ placement.rotation.T + placement.translation
            points.append(in_world + below * DOWN)
    everything = np.concatenate(points)
    return np.asarray(everything[everything[:, 2] < everything[:, 2].min() + nearly])


def _sole_points(lowest: Array, attitude: Attitude) -> Array:
    """Return the middle of a sole's rear edge and the corners of its front one (3, 2), m, in the world.

    The sole is what its lowest points (N, 3) span; the base looks forwards.
    """
    edge = 0.01  # [m] what is so near to an end is the edge there
    heading = attitude.matrix[:2, 0] / np.linalg.norm(attitude.matrix[:2, 0])
    left = np.array([-heading[1], heading[0]])
    along = lowest[:, :2] @ heading
    across = lowest[:, :2] @ left
    rear = across[along < along.min() + edge]
    front = across[along > along.max() - edge]
    heel = along.min() * heading + (rear.min() + rear.max()) / 2 * left
    left_toe = along.max() * heading + front.max() * left
    right_toe = along.max() * heading + front.min() * left
    return np.array([heel, left_toe, right_toe])


def standing_joints(
    robot: Robot, feet: Sequence[Foot], attitude: Attitude, target: Array, limits: Array
) -> tuple[Array, float]:
    """Return the joints (n,) nearest to a target with which all feet are level, and the height of the base, m."""
    kinematics = Kinematics(robot)

    def heights(joints: Array) -> Array:
        kinematics.pose(np.zeros(3), attitude.matrix, joints)
        return np.array([kinematics.point(foot.body, foot.local)[2] - foot.depth for foot in feet])

    def residual(joints: Array) -> Array:
        ground = heights(joints)
        nearness = 1e-6  # [-] weight of the distance from the target: feet are level to LEVEL
        return np.concatenate(((ground - ground.mean()) * 1e3, nearness * (joints - target)))

    joints = np.clip(target, limits[:, 0], limits[:, 1])
    if np.ptp(heights(joints)) > LEVEL:
        joints = least_squares(residual, joints, bounds=(limits[:, 0] - 1e-9, limits[:, 1] + 1e-9), xtol=1e-15).x
    return joints, float(-heights(joints).mean())


def not_standing(robot: Robot, feet: Sequence[Foot], attitude: Attitude, joints: Array) -> str:
    """Why a robot does not stand still on feet in a posture, for a person; empty where it does."""
    kinematics = Kinematics(robot)
    q = kinematics.pose(np.zeros(3), attitude.matrix, joints)
    points = np.array([kinematics.point(foot.body, foot.local) for foot in feet])
    ground = points[:, 2] - [foot.depth for foot in feet]
    if np.ptp(ground) > 2 * LEVEL:
        return (
            f"its feet are {1e3 * np.ptp(ground):.0f} mm apart in height, {feet[int(ground.argmax())].name!r} highest"
        )
    links = [link for link in {solid.link for solid in robot.solids} if link not in feet_links(robot, feet)]
    dip = float(ground.mean()) - kinematics.lowest(links)
    if dip > 0:
        return f"something but its feet is {1e3 * dip:.0f} mm below the ground"
    com = pin.centerOfMass(kinematics.model, kinematics.data, q)[:2]
    try:
        hull = ConvexHull(points[:, :2])
    except (QhullError, ValueError):
        return "its feet are on a line, or fewer than three"
    inside = -float((hull.equations[:, :2] @ com + hull.equations[:, 2]).max())
    if inside < 0.02:  # m: less than that and a step of the program is a fall
        return f"its centre of mass is {1e3 * -inside:.0f} mm outside its feet, or {1e3 * inside:.0f} mm inside"
    return ""


def feet_links(robot: Robot, feet: Sequence[Foot]) -> set[str | None]:
    """Links with whose shapes feet stand on the ground."""
    links: set[str | None] = set()
    for foot in feet:
        tree = robot.joint_tree
        link = foot.frame if foot.frame in tree.links else tree.joint[foot.frame].child
        links.add(robot.contact_link(link))
        if foot.suffix:  # links fixed to a sole that have no geometry of their own: frames on the ground
            on_sole = {solid.link for solid in robot.solids if solid.body == foot.body}
            links |= {name for name in on_sole if not robot.stands_on_geometry(name)}
    return links


@dataclass(frozen=True)
class ClearancePoint:
    """A ball of a link that stays above the ground: body, centre (3,) m in its joint's frame, and radius, m."""

    link: str
    body: int
    local: tuple[float, float, float]
    radius: float


def clearance_points(robot: Robot, feet: Sequence[Foot], rotation: Array, joints: Array) -> list[ClearancePoint]:
    """Return corners of the base, and ends of the limbs' capsules but for what is near the feet.

    Of those that are nearly one in every posture, as a knee's of thigh and shank, only one is returned. Where the robot
    stands, with the base's rotation (3, 3) and joints (n,), none is in the ground: see :func:`thinned_above_ground`.
    """
    near_foot = 0.1  # [m] from a foot's point: the end of the shank
    small = 0.05  # [m] across: sensors on the base
    points: list[ClearancePoint] = []
    for solid in robot.solids:
        low = solid.points.min(axis=0)
        high = solid.points.max(axis=0)
        if solid.body != 1 or np.linalg.norm(high - low) < small:
            continue
        radius = float(np.linalg.norm(solid.axes, axis=0).max())
        for x, y, z in itertools.product(*zip(low.tolist(), high.tolist(), strict=True)):
            corner = ClearancePoint(solid.link, 1, (x, y, z), radius)
            points.append(corner)
    standing = feet_links(robot, feet)
    for capsule in robot.solid_capsules:
        if capsule.body == 1 or capsule.link in standing:
            continue
        for end in (capsule.start, capsule.end):
            is_near = [foot.body == capsule.body and math.dist(foot.local, end) < near_foot for foot in feet]
            if not any(is_near):
                x, y, z = end.tolist()
                points.append(ClearancePoint(capsule.link, capsule.body, (x, y, z), capsule.radius))
    return thinned_above_ground(robot, feet, _distinct(robot, points), rotation, joints)


def thinned_above_ground(
    robot: Robot, feet: Sequence[Foot], points: Sequence[ClearancePoint], rotation: Array, joints: Array
) -> list[ClearancePoint]:
    """The points; a ball that is on the ground where the robot stands becomes so small that it is as high as its link.

    A capsule may be much thicker than its link is at that end: that of a shank with wide knees reaches below the sole.
    No motion would keep it above the ground.
    """
    on_ground = 5e-3  # [m] above it
    kinematics = Kinematics(robot)
    kinematics.pose(np.zeros(3), rotation, joints)
    ground = kinematics.point(feet[0].body, feet[0].local)[2] - feet[0].depth
    above = []
    for point in points:
        centre = kinematics.point(point.body, point.local)[2]
        if centre - point.radius < ground + on_ground:
            radius = float(centre - kinematics.lowest([point.link]))
            point = replace(point, radius=min(point.radius, max(radius, 0.0)))
        above.append(point)
    return above


def foot_corners(robot: Robot, feet: Sequence[Foot], least: float) -> list[ClearancePoint]:
    """Return corners of the feet's shapes that would be in the ground, by ``least`` or more, below the feet's points.

    A foot's point stays as high as it stands; where the leg tilts, what is farther from it than the ground dips in. Of
    corners in nearly the same direction only the farthest is returned.
    """
    alike = math.cos(math.radians(25.0))  # of directions from the foot's point
    corners: list[ClearancePoint] = []
    for foot in feet:
        if not foot.suffix:  # a sole stands flat, and its points are its corners
            solids = [solid for solid in robot.solids if solid.link in feet_links(robot, [foot])]
            corners += _far_points(foot, solids, foot.depth + least, alike)
    return corners


def shank_points(robot: Robot, feet: Sequence[Foot], height: float) -> list[ClearancePoint]:
    """Return points of the links to which feet are fixed, that are lower than a height, m, where such a leg tilts.

    A shank may be wider than its foot, whose point does not move: how low it reaches follows from the tilt.
    """
    alike = math.cos(math.radians(15.0))  # of directions from the foot's point: a rim between them is 0.3 mm lower
    points: list[ClearancePoint] = []
    for foot in feet:
        if not foot.suffix:
            own = feet_links(robot, [foot])
            solids = [solid for solid in robot.solids if solid.body == foot.body and solid.link not in own]
            # What is nearer to the joint than the foot's point is the lowest on legs that are upside down.
            points += _far_points(foot, solids, foot.depth - height, alike, away_from_joint=True)
    return points


def _far_points(
    foot: Foot, solids: Sequence[LinkSolid], least: float, alike: float, away_from_joint: bool = False
) -> list[ClearancePoint]:
    """Balls around points of solids that reach ``least`` m or more from a foot's point, the farthest of its direction.

    Directions are one where their cosine is ``alike`` or more. Points that are not ``away_from_joint``, on the foot's
    other side, may be left out.
    """
    candidates = []
    for solid in solids:
        radius = float(np.linalg.norm(solid.axes, axis=0).max())
        candidates += [(point - np.array(foot.local), radius, solid.link) for point in solid.points]
    candidates.sort(key=lambda candidate: -float(np.linalg.norm(candidate[0])) - candidate[1])
    directions: list[Array] = []
    points: list[ClearancePoint] = []
    for arm, radius, link in candidates:
        distance = float(np.linalg.norm(arm))
        if distance + radius < least or not distance:
            continue
        if away_from_joint and arm @ np.array(foot.local) < -0.1 * distance * float(np.linalg.norm(foot.local)):
            continue
        direction = arm / distance
        if all(direction @ other < alike for other in directions):
            directions.append(direction)
            x, y, z = (np.array(foot.local) + arm).tolist()
            points.append(ClearancePoint(link, foot.body, (x, y, z), radius))
    return points


def _distinct(robot: Robot, points: Sequence[ClearancePoint]) -> list[ClearancePoint]:
    """The points without those that are within 3 cm of a larger one in every posture."""
    same = 0.03  # [m]
    kinematics = Kinematics(robot)
    places = []
    for joints in np.random.default_rng(0).uniform(-1.0, 1.0, (3, len(robot.joints))):
        kinematics.pose(np.zeros(3), np.eye(3), joints)
        places.append([kinematics.point(point.body, point.local) for point in points])
    positions = np.array(places)
    distinct: list[int] = []
    for index in sorted(range(len(points)), key=lambda index: -points[index].radius):
        distances = np.linalg.norm(positions[:, distinct] - positions[:, [index]], axis=2).max(axis=0)
        is_box = points[index].body == 1
        if is_box or (distances > same).all():
            distinct.append(index)
    return [points[index] for index in distinct]


@dataclass(frozen=True)
class LegReach:
    """What legs reach while all feet stand where they are and the base is not rotated; other joints are still.

    Attributes
    ----------
    tallest : m, the greatest height of the centre of mass over the ground
    fastest : m/s, the greatest speed upwards of the centre of mass at any height, within the joints' rates
    """

    tallest: float
    fastest: float


def leg_reach(
    kinematics: Kinematics,
    feet: Sequence[Foot],
    places: Mapping[str, Array],
    rotation: Array,
    standing: Array,
    ranges: Array,
    rates: Array,
) -> LegReach:
    """Lift and lower a robot from where it stands by steps of 1 % of its height, as far as its legs reach.

    Parameters
    ----------
    kinematics : of the robot
    feet : that stand
    places : (3,) m, of their points, by their names; the centre of mass is above the origin
    rotation : (3, 3) of the base
    standing : (1+n,) height of the centre of mass, m, and joints, where the robot stands
    ranges : (n, 2) rad, of joints
    rates : (n,) rad/s, that joints may have
    """
    deepest = 0.6  # [-] of the height where it stands: lower no robot crouches to jump
    step = 0.01  # [-] of it
    height = float(standing[0])
    tallest = height
    fastest = 0.0
    for direction in (1.0, -1.0):
        legs = StandingLegs(kinematics, feet, places, rotation, standing[1:], ranges)
        level = height
        while level >= deepest * height and legs.carry(level):
            tallest = max(tallest, level)
            fastest = max(fastest, legs.speed(rates))
            level += direction * step * height
    return LegReach(tallest, fastest)


class StandingLegs:
    """A robot whose feet stand, in a configuration that follows the height of its centre of mass."""

    def __init__(
        self,
        kinematics: Kinematics,
        feet: Sequence[Foot],
        places: Mapping[str, Array],
        rotation: Array,
        joints: Array,
        ranges: Array,
    ) -> None:
        robot = kinematics.robot
        self.kinematics = kinematics
        self.feet = feet
        self.places = np.concatenate([places[foot.name] for foot in feet])
        self.q = kinematics.pose(np.zeros(3), rotation, joints)
        self.q[:3] -= pin.centerOfMass(kinematics.model, kinematics.data, self.q)
        self.q[2] += self.places[2] - kinematics.point(feet[0].body, feet[0].local)[2]
        model = kinematics.model
        in_legs: set[int] = set()
        for foot in feet:
            in_legs.update(model.supports[foot.body])
        self.joints = []
        numbers = []
        for index, name in enumerate(robot.joints):
            number = model.getJointId(name)
            if number in in_legs:
                self.joints.append(index)
                numbers.append(number)
        self.columns = [0, 1, 2, *(model.joints[number].idx_v for number in numbers)]
        self.coordinates = [model.joints[number].idx_q for number in numbers]
        self.ranges = ranges[self.joints]

    def carry(self, height: float) -> bool:
        """Bring the centre of mass to a height, m, above the origin; return whether the legs reach that far."""
        close = 1e-4  # [m]
        longest = 0.2  # [rad, m] of a step of Newton's method
        model = self.kinematics.model
        required = np.concatenate(([0.0, 0.0, height], self.places))
        for _ in range(30):
            positions, jacobian = self.points()
            gap = required - positions
            if np.abs(gap).max() < close:
                return True
            change = np.linalg.lstsq(jacobian, gap, rcond=1e-6)[0]
            motion = np.zeros(model.nv)
            motion[self.columns] = change * min(1.0, longest / np.abs(change).max())
            self.q = pin.integrate(model, self.q, motion)
            self.q[self.coordinates] = np.clip(self.q[self.coordinates], *self.ranges.T)
        return False

    def speed(self, rates: Array) -> float:
        """How fast the legs lift the centre of mass here, m/s, with joints (n,) as fast as they may be, rad/s."""
        _, jacobian = self.points()
        upwards = np.zeros(len(jacobian))
        upwards[2] = 1.0
        of_joints = np.abs(np.linalg.lstsq(jacobian, upwards, rcond=1e-6)[0][3:])  # [rad/m] over its height
        return float((rates[self.joints] / np.maximum(of_joints, 1e-9)).min())

    def points(self) -> tuple[Array, Array]:
        """The centre of mass and the feet's points (3+3F,), m, and their derivatives by the base and the legs."""
        model = self.kinematics.model
        data = self.kinematics.data
        pin.forwardKinematics(model, data, self.q)
        pin.computeJointJacobians(model, data, self.q)
        rows = [pin.jacobianCenterOfMass(model, data, self.q)]
        positions = [data.com[0].copy()]
        for foot in self.feet:
            of_joint = pin.getJointJacobian(model, data, foot.body, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = data.oMi[foot.body].rotation @ np.array(foot.local)
            rows.append(of_joint[:3] - pin.skew(arm) @ of_joint[3:])
            positions.append(self.kinematics.point(foot.body, foot.local))
        return np.concatenate(positions), np.vstack(rows)[:, self.columns]
