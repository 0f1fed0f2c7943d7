"""What the program of a jump in space is about: its limits, its nodes, where it begins and ends, and its solution.

Rows of a node that its feet, forces and torques keep are here too; limits are parameters of the expressions.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.model import casadi
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.standing import Foot


@dataclass(frozen=True, eq=False)
class SpatialBounds:
    """Limits of a program.

    Attributes
    ----------
    torque : (m,) N m, of motors
    stall, slope : (m,) N m and N m s/rad of motors' torque-speed curves
    velocity : (n,) rad/s
    position : (n, 2) rad
    friction : [-]
    clearance : m, of what is no foot from the ground
    lift : m, of feet in the flight, between its quarters
    dip : m, by which corners of feet may be below the ground, on which the feet's points stand
    shank_height : m, of points of links to which feet are fixed; 0 where there are none
    tilt : rad, of the middle one of the base's angles
    leeway : rad, by which the base's other angles leave what is between those of both ends
    impact : m/s, greatest speed of feet that end the flight; 0 where they have none
    least_force : vertical, over the weight, on each foot that stands
    inside : least share of a sole's vertical force on each of its points, which keeps the centre of pressure inside
    scales : (m,) N m, what each motor's torque is a share of: the most that it may ever have
    """

    torque: Array
    stall: Array
    slope: Array
    velocity: Array
    position: Array
    friction: float
    clearance: float
    lift: float
    dip: float
    shank_height: float
    tilt: float
    leeway: float
    impact: float
    least_force: float
    inside: float
    scales: Array


@dataclass(frozen=True)
class NodeKind:
    """What holds at a node.

    Attributes
    ----------
    side : of the flight, whose places feet have
    tracking : feet that stand, leave or touch down
    bearing : feet with forces
    damping_signs : of each foot that tracks, the sign of the damping of what it is off: 1 decays with time, -1
        backwards in time, 0 has no row
    fixed : how many of y, v and a are fixed there
    """

    side: str
    tracking: tuple[Foot, ...]
    bearing: tuple[Foot, ...]
    damping_signs: tuple[int, ...] = ()
    fixed: int = 0


Row: TypeAlias = tuple[Any, float, float, str]  # expression, low, high, and a label for a person


@dataclass(frozen=True, eq=False)
class NodeParameters:
    """Symbols of what differs between nodes of one kind, and between programs with other margins.

    Attributes
    ----------
    reference : (6+n,) coordinates y to which those of the node are to be near; (0,) for none
    friction, inside : as of SpatialBounds
    scales : (m,) as of SpatialBounds
    signs : of the damping of each foot that tracks
    """

    reference: Any
    friction: Any
    inside: Any
    scales: Any
    signs: Any

    @classmethod
    def of_sizes(cls, motors: int, feet: int, reference: int) -> "NodeParameters":
        """Symbols for so many motors, feet that track, and coordinates of a reference."""
        sx = casadi().SX
        return cls(
            reference=sx.sym("reference", reference),
            friction=sx.sym("friction"),
            inside=sx.sym("inside"),
            scales=sx.sym("scales", motors),
            signs=sx.sym("signs", feet),
        )

    @property
    def vector(self) -> Any:
        """All of them, one after the other."""
        return casadi().vertcat(self.reference, self.friction, self.inside, self.scales, self.signs)


def standing_rows(
    model: SpatialModel, kind: NodeKind, places: Mapping[str, Array], displacement: Any, signs: Any
) -> list[Row]:
    """Rows of feet that stand.

    Parameters
    ----------
    model : SpatialModel
    kind : of the node
    places : (3,) m, of the side's feet by their names
    displacement : (2,) m, of these places
    signs : (F,) of the damping of the feet that track
    """
    ca = casadi()
    stiffness = 625.0  # [1/s^2] and
    damping = 50.0  # [1/s] of the rows of feet that stand: critically damped, in 40 ms
    rows: list[Row] = []
    of_feet = zip(kind.tracking, kind.damping_signs, ca.vertsplit(signs), strict=True)
    for foot, is_damped, sign in of_feet:
        if not is_damped:
            continue
        _, (position, velocity, acceleration) = model.foot(foot.name)
        gap = foot.stays * (position - places[foot.name] - ca.vertcat(displacement, 0))
        label = f"position of {foot.name}"
        for direction in _directions(places, foot):
            along = ca.DM(direction).T
            off, speed, change = (ca.mtimes(along, vector) for vector in (gap, velocity, acceleration))
            pulled = change + sign * damping * speed + stiffness * off
            rows.append((pulled / model.gravity, 0.0, 0.0, label))
    return rows


def _directions(places: Mapping[str, Array], foot: Foot) -> Array:
    """Directions (k, 3) in which a point's position is fixed, in the world: as many as fix a sole.

    Those are all three of a point's and a heel's; of one toe but that towards the heel; of the other the vertical.
    """
    heel, _, right_toe = Foot.of_soles
    if foot.suffix in ("", heel):
        return np.eye(3)
    vertical = np.array([0.0, 0.0, 1.0])
    if foot.suffix == right_toe:
        return vertical[None]
    to_heel = places[foot.frame + heel] - places[foot.name]
    across = np.cross(vertical, to_heel)
    return np.array([across / np.linalg.norm(across), vertical])


def force_rows(bearing: Sequence[Foot], scaled_forces: Mapping[str, Any], friction: Any, inside: Any) -> list[Row]:
    """Rows that keep forces inside friction cones, and the centre of pressure inside each sole.

    Each point of a sole bears a share of the sole's vertical force at least.

    Parameters
    ----------
    bearing : feet that bear force
    scaled_forces : of each, by its name, its force (3,) over the weight; or impulses, likewise scaled
    friction, inside : symbols of the bounds
    """
    sides = 8  # [-] of the pyramid inside the friction cone
    steepest = friction * math.cos(math.pi / sides)
    rows: list[Row] = []
    for foot in bearing:
        force = scaled_forces[foot.name]
        for angle in np.linspace(0.0, 2 * math.pi, sides, endpoint=False).tolist():
            along = math.cos(angle) * force[0] + math.sin(angle) * force[1]
            rows.append((steepest * force[2] - along, 0.0, math.inf, f"friction of {foot.name}"))
        if foot.suffix:
            of_sole = sum(scaled_forces[other.name][2] for other in bearing if other.frame == foot.frame)
            rows.append((force[2] - inside * of_sole, 0.0, math.inf, f"pressure of {foot.name}"))
    return rows


def torque_rows(
    model: SpatialModel, bounds: SpatialBounds, forces: Mapping[str, Any], scales: Any
) -> tuple[list[Row], Any]:
    """Rows of torques within limits and curves, and the sum of squared shares of the limits.

    Parameters
    ----------
    model : SpatialModel
    bounds : SpatialBounds
    forces : (3,) N, at points by their names
    scales : symbols (m,) of the bounds' scales
    """
    ca = casadi()
    robot = model.robot
    torques = ca.mtimes(ca.sparsify(ca.DM(robot.transmission[BASE:].T)), model.torques(forces))
    rates = ca.mtimes(ca.sparsify(ca.DM(robot.motor_ratios)), model.v[BASE:])
    rows: list[Row] = []
    cost = ca.SX(0)
    for index, name in enumerate(robot.motors):
        share = torques[index] / scales[index]
        cost += share**2
        if math.isfinite(bounds.torque[index]):
            most = float(bounds.torque[index] / bounds.scales[index])
            rows.append((share, -most, most, f"torque of {name}"))
        if math.isfinite(bounds.stall[index]):
            lost = bounds.slope[index] * rates[index] / scales[index]
            most = float(bounds.stall[index] / bounds.scales[index])
            label = f"torque-speed curve of {name}"
            rows.append((share + lost, -most, most, label))
            rows.append((share - lost, -most, most, label))
    return rows, cost


def leverage_rows(model: SpatialModel, feet: Sequence[Foot], standing: Array, refuses: bool) -> list[Row]:
    """Rows that keep legs which stand from postures in which their joints cannot move the foot every way.

    Parameters
    ----------
    model : SpatialModel
    feet : that stand
    standing : (6+n,) coordinates y, the centre of mass's first, where the robot stands at first
    refuses : whether a leg that is in such a posture there is refused

    Raises
    ------
    InputError
        It is refused.
    """
    ca = casadi()
    least = 0.2  # [-] of the leverage where the robot stands at first,
    singular = 0.01  # [-] which is more than this of the cube of the centre of mass's height
    rows: list[Row] = []
    for foot in feet:
        leverage = model.leverage(foot.name)
        if leverage is None:
            continue
        at_first = float(ca.Function("leverage", [model.y], [leverage])(standing))
        if refuses and abs(at_first) < singular * standing[2] ** 3:
            reason = f"the leg of {foot.name!r} is straight, or its foot on the hip's axis"
            raise InputError(reason, element="jump.takeoff.from", advice="stand with bent legs")
        rows.append((leverage / at_first - least, 0.0, np.inf, f"leverage of {foot.name}"))
    return rows


def lifted_share(progress: float) -> float:
    """Share of the lift that feet have at a time over the flight's duration: all of it between its quarters.

    Before and after, it grows with the square of the time, since feet are still when they leave the ground, and so they
    are when they meet it, unless they land with speed.
    """
    quarter = 0.25
    growing = progress * (1 - progress) / (quarter * (1 - quarter))
    return min(1.0, growing**2)


@dataclass(frozen=True, eq=False)
class SpatialSolution:
    """Values at the K+1 nodes of a jump.

    Attributes
    ----------
    raw : (size,) variables
    y, v, a : (6+n, K+1) coordinates and their derivatives; rows 0 to 2 are the centre of mass, m, not the base's origin
    forces : of each node, name of a foot's point -> (3,) N
    durations : (phases,) s
    worst : largest violation of a row, scaled; and which it is
    iterations : int
    converged : whether every row holds
    arrival : (2, 6+n) rates and accelerations with which the flight ends, the centre of mass's first; None where they
        are those of its last node
    origin : (3,) m, of the program in the world of y
    """

    raw: Array
    y: Array
    v: Array
    a: Array
    forces: list[dict[str, Array]]
    durations: Array
    worst: tuple[float, str]
    iterations: int
    converged: bool
    arrival: Array | None = None
    origin: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def com_motion(self) -> Array:
        """y, v and a (3, 6+n, K+1), whose rows 0 to 2 are the centre of mass."""
        return np.stack((self.y, self.v, self.a))

    def moved(self, origin: Array) -> "SpatialSolution":
        """The same where the program's origin is elsewhere in the world, (3,) m."""
        y = self.y.copy()
        y[:3] += (origin - self.origin)[:, None]
        return replace(self, y=y, origin=origin)


@dataclass(frozen=True, eq=False)
class SpatialEnds:
    """Where the robot is at the first and the last node: standing still, or as a flight has it there.

    Attributes
    ----------
    y : (2, 6+n) centre of mass, angles and joints; the last centre is above the origin, moved by the displacement
    places : of each side, name of a foot's point -> (3,) m; after landing horizontally relative to the centre of mass's
        last position, but for those of a single stance
    displacement : (2,) m of the centre of mass, where it is fixed; None where it is left to the program
    v : (2, 6+n) rates of y; (2, 1) of zeros where the robot stands still at both ends
    a : (2, 6+n) or (2, 1), accelerations likewise; NaN of an end where they are left to the program
    flies : of each end, whether a flight is met there, so that nothing bears the robot
    settles : of each end, whether the robot stands still there in a posture that is left to the program
    rise : height of the ground on which it lands over that which it leaves, m
    tallest : greatest height of the centre of mass over the ground to which slow legs reach, m; infinite of fast ones
    """

    y: Array
    places: dict[str, dict[str, Array]]
    displacement: Array | None = None
    v: Array = field(default_factory=lambda: np.zeros((2, 1)))
    a: Array = field(default_factory=lambda: np.zeros((2, 1)))
    flies: tuple[bool, bool] = (False, False)
    settles: tuple[bool, bool] = (False, False)
    rise: float = 0.0
    tallest: float = math.inf

    def fixed(self, end: int) -> int:
        """How many of y, v and a are fixed at an end, 0 or -1; none where it settles, whose v and a are 0."""
        if self.settles[end]:
            return 0
        return 3 if np.isfinite(self.a[end]).all() else 2

    @property
    def standing(self) -> Array:
        """The coordinates y (6+n,) of an end at which the robot stands; of two flights' the first."""
        return np.asarray(self.y[1 if self.flies[0] and not self.flies[1] else 0])
