"""What the program of a jump in space is about: its limits, its nodes, where it begins and ends, and its solution."""

from dataclasses import dataclass, field, replace

import numpy as np

from floatplan.arrays import Array
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
    inside : least share of a sole's vertical force on each of its points, which keeps the centre of pressure inside
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
    inside: float


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


@dataclass(frozen=True, eq=False)
class SpatialSolution:
    """Values at the K+1 nodes of a jump.

    Attributes
    ----------
    raw : (size,) variables
    y, v, a : (6+n, K+1)
    forces : of each node, frame -> (3,) N
    durations : (phases,) s
    worst : largest violation of a row, scaled; and which it is
    iterations : int
    converged : whether every row holds
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
    origin: Array = field(default_factory=lambda: np.zeros(3))

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
    y : (2, 6+n) centre of mass, angles and joints; the last centre is above the origin, its position is free
    places : of each side, frame -> (3,) m, of the feet; after landing relative to the centre of mass's position
    displacement : (2,) m of the centre of mass, where it is fixed; else None
    v : (2, 6+n) their rates, 0 where it stands still
    a : (2, 6+n) and accelerations; NaN of an end where they are left to the program
    flies : of each end, whether a flight is met there, so that nothing bears the robot
    rise : height of the ground on which it lands over that which it leaves, m
    """

    y: Array
    places: dict[str, dict[str, Array]]
    displacement: Array | None = None
    v: Array = field(default_factory=lambda: np.zeros((2, 1)))
    a: Array = field(default_factory=lambda: np.zeros((2, 1)))
    flies: tuple[bool, bool] = (False, False)
    rise: float = 0.0

    def fixed(self, end: int) -> int:
        """How many of y, v and a are fixed at an end, 0 or -1."""
        return 3 if np.isfinite(self.a[end]).all() else 2

    @property
    def standing(self) -> Array:
        """The coordinates (6+n,) of an end at which the robot stands; of two flights' the first."""
        return np.asarray(self.y[1 if self.flies[0] and not self.flies[1] else 0])
