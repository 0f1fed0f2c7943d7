"""What a plan has to do: a robot, the states at takeoff and landing, the flight, and what must hold meanwhile.

Every dataclass is frozen. :class:`Problem` checks its arguments once, here, and stores them resolved: arrays in the
order of ``robot.joints``, SI units, radians.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from floatplan.arguments import Check, Checked, flag, html_table, made, many, optional, shortened, text
from floatplan.arrays import Array, identity, read_only
from floatplan.errors import InputError, check_name, faults, refuse
from floatplan.pool import one_thread
from floatplan.problem import parts, resolution
from floatplan.problem.attitude import Reorientation
from floatplan.problem.ballistics import Ballistics, ballistics
from floatplan.problem.jump import JumpRequest, jump_errors
from floatplan.problem.spatial_obstacles import SPATIAL_OBSTACLE_KINDS, LevelGround
from floatplan.robot.leak import refuse_leak
from floatplan.robot.planar.inertia import inertia_extremes, momentum_intervals
from floatplan.robot.robot import Frame, LinkCapsule, Robot
from floatplan.tables import JOINT_LIMITS, LIMIT_TABLE, LimitKey

LONGEST_LIST = 12  # [-] joints listed one by one


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Checked):
    """A flight to plan. Checked and resolved when made; raises :class:`~floatplan.errors.InputError`.

    Parameters
    ----------
    robot : Robot
    start, goal : Posture
    flight, motion, limits : Flight, Motion, Limits
    obstacles : sequence of Circle, HalfPlane or Bar; in space of Sphere, Capsule, HalfSpace or Box
    self_clearances : sequence of SelfClearance
    name : str
        Of the problem, and of the folder of its results.
    ground : bool
        Whether all links stay above the horizontal line through the lowest point of the takeoff link's shapes at t = 0.
    jump : JumpRequest or None
        The whole jump of which this is the flight, for :func:`floatplan.jump`; plans of the flight ignore it.
    written : str, optional
        The problem file's text, as ``file_text``; ``dataclasses.replace`` drops it.

    Attributes
    ----------
    initial, final : JointState
        ``start`` and ``goal`` as arrays.
    position_limits : (n, 2) rad, always finite
    joint_limits : key of ``[limits]`` -> (n,), of the planned coordinates; infinite where there is none
        In the units of the table of limits.
    torque_limits : (n,) N m, of the generalised torques; infinite where there is none
        As in a sequence, or what the motors' own limits add up to, by ratio.
    motor_torque_limits, motor_stall : (m,) N m, of each of ``robot.motors``; infinite where there is none
    motor_slope : (m,) N m s/rad
    degrees : (n,) int
    reference : (K, n) rad, or None
        The recorded motion of the objective "clip", at instants evenly apart from takeoff to landing.
    file_text : str or None
    takeoff, landing : Takeoff, Landing
        With the defaults filled in.
    landing_height : m, of the landing frame at t = T
    path : Ballistics
        Of the centre of mass.
    reorientation : Reorientation, or None in a plane
        From which attitude to which the base turns.
    inertia_extremes : two arrays (n+1,) kg m^2; (0,) in space
        Least and largest D_i of (4) over the joint ranges.
    angular_momentum_bounds : (low, high) kg m^2/s, or None in space
        (9): where h lies if orientation and joints all move monotonically; its middle is (10).
    limit_shares : tuple of Shares
        What the limits bound, but for the joints' ranges.
    angular_momentum : kg m^2/s, or None where it is free, and in space
        The requested h as a number: (10) instead of the word.
    has_inequalities : whether more is requested than the states at both ends
    minimises_b : whether (17) is its objective, the size of b, as of "coefficients" in a plane
    is_standard : whether it minimises (17) in a plane, between fixed states at a fixed h: batches plan such problems
    is_plain : whether it is standard, and has no inequalities
    chooses_ends : whether velocities or accelerations at an end are words, so that a plan settles them
    raises_degree : whether the degree may be raised where nothing else helps
    """

    robot: Robot
    start: parts.Posture
    goal: parts.Posture
    flight: parts.Flight
    motion: parts.Motion = field(default_factory=parts.Motion)
    limits: parts.Limits = field(default_factory=parts.Limits)
    obstacles: tuple[parts.Obstacle, ...] = ()
    self_clearances: tuple[parts.SelfClearance, ...] = ()
    name: str = "flight"
    ground: bool = False
    jump: JumpRequest | None = None
    written: InitVar[str | None] = None
    initial: parts.JointState = field(init=False)
    final: parts.JointState = field(init=False)
    position_limits: Array = field(init=False)
    joint_limits: Mapping[LimitKey, Array] = field(init=False)
    torque_limits: Array = field(init=False)
    motor_torque_limits: Array = field(init=False)
    motor_stall: Array = field(init=False)
    motor_slope: Array = field(init=False)
    degrees: tuple[int, ...] = field(init=False)
    reference: Array | None = field(init=False)
    takeoff: parts.Takeoff = field(init=False)
    landing: parts.Landing = field(init=False)
    landing_height: float = field(init=False)
    path: Ballistics = field(init=False)
    reorientation: Reorientation | None = field(init=False)
    inertia_extremes: tuple[Array, Array] = field(init=False)
    angular_momentum_bounds: tuple[float, float] | None = field(init=False)
    angular_momentum: float | None = field(init=False)
    limit_shares: tuple[Shares, ...] = field(init=False)
    has_inequalities: bool = field(init=False)
    minimises_b: bool = field(init=False)
    is_standard: bool = field(init=False)
    is_plain: bool = field(init=False)
    chooses_ends: bool = field(init=False)
    raises_degree: bool = field(init=False)
    file_text: str | None = field(init=False, repr=False)
    checks: ClassVar[Mapping[str, Check]] = {
        "robot": made(Robot, advice="load it with Robot.from_urdf"),
        "start": made(parts.Posture),
        "goal": made(parts.Posture),
        "flight": made(parts.Flight),
        "motion": made(parts.Motion),
        "limits": made(parts.Limits),
        "obstacles": many(made(*parts.OBSTACLE_KINDS.values(), *SPATIAL_OBSTACLE_KINDS.values()), "obstacles"),
        "self_clearances": lambda value, _: many(made(parts.SelfClearance), "SelfClearance")(value, "self_clearance"),
        "name": text,
        "ground": flag,
        "jump": optional(made(JumpRequest)),
        "file_text": optional(text),
    }

    def __post_init__(self, written: str | None) -> None:
        """Resolve and check everything; report all that is wrong, not only the first."""
        object.__setattr__(self, "file_text", written)
        self._settle(self.checks)

    def with_parts(self, **parts: Any) -> Problem:
        """Return the problem with other parts, of the same robot; what none of them touches is not resolved again.

        Raises
        ------
        InputError
            As where a problem is made.
        """
        made = self.changed(file_text=None, **parts)
        made._settle(parts)
        return made

    @one_thread
    def _settle(self, changed: Container[str]) -> None:
        """Check, and resolve what depends on parts that have changed."""
        errors = self.faults()
        fields = {error.element for error in errors}
        try:
            further = faults((*self._resolutions(changed), partial(check_name, self.name, "name")))
            further += resolution.flight_errors(self.robot, self.flight)
            further += list(self._planar_errors()) if self.robot.in_plane else self._errors_in_space()
            further += resolution.surroundings_errors(
                self.robot, self.obstacles, self.self_clearances, self.flight.duration
            )
            if self.obstacles or self.self_clearances or self.ground:
                further += faults((self.robot.check_shapes,))
            for error in further:
                if not any(str(field).startswith(error.element or "?") for field in fields):
                    errors.append(error)
        except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError):
            if not errors:
                raise  # else it comes of what is wrong already
        if not errors:
            ranges, flight = self.position_limits, self.flight
            for element, state in (("start", self.initial), ("goal", self.final)):
                errors += resolution.end_errors(self.robot, ranges, flight, state, element)
        refuse(errors)
        self._settle_flight()
        keeps_clear = bool(self.obstacles or self.self_clearances or self.ground)
        is_limited = self.limits.orientation_rate is not None or bool(np.isfinite(np.concatenate(self.limited)).any())
        limit_shares = tuple(shares_of_limits(self)) if is_limited else ()
        has_inequalities = keeps_clear or is_limited
        chooses_ends = any(end.frame_rests or end.free_accelerations for end in (self.initial, self.final))
        minimises_b = self.angular_momentum_bounds is not None and self.motion.objective == "coefficients"
        fixes_momentum = self.angular_momentum is not None and not chooses_ends
        is_standard = minimises_b and fixes_momentum and len(self.robot.joints) > 0
        vars(self).update(
            landing_height=self.landing.height or 0.0,
            limit_shares=limit_shares,
            has_inequalities=has_inequalities,
            minimises_b=minimises_b,
            is_standard=is_standard,
            is_plain=is_standard and not has_inequalities,
            chooses_ends=chooses_ends,
            raises_degree=self.motion.degree == "auto",
        )

    def _settle_flight(self) -> None:
        """What holds of every motion that meets the problem.

        That is the path of the centre of mass, in a plane (9), and in space how the base turns.
        """
        extremes = np.empty(0), np.empty(0)
        momenta = momentum = reorientation = None
        if self.robot.in_plane:
            extremes = inertia_extremes(self.robot.tree, self.position_limits)
            rotation = self.final.orientation - self.initial.orientation
            changes = np.array([rotation, *(self.final.positions - self.initial.positions)])
            low, high = momentum_intervals(extremes, changes, np.array(self.flight.duration))
            momenta = float(low), float(high)
            requested = self.flight.momentum_in_plane
            if requested != "free":
                momentum = sum(momenta) / 2 if isinstance(requested, str) else float(requested)
        if self.initial.attitude and self.final.attitude:
            reorientation = Reorientation(self.initial.attitude, self.final.attitude)
        path = ballistics(self.robot, self.flight, self.takeoff, self.initial, self.landing, self.final)
        vars(self).update(
            path=path,
            reorientation=reorientation,
            inertia_extremes=extremes,
            angular_momentum_bounds=momenta,
            angular_momentum=momentum,
        )

    def _planar_errors(self) -> Iterator[InputError]:
        """What is wrong in the plane: with the robot, and with the jump around the flight."""
        yield from faults((partial(refuse_leak, self.robot),))
        if self.motion.objective == "robust":
            reason = (
                '"robust" is for flights in space: in a plane a wrong attitude at takeoff does not grow until landing'
            )
            yield InputError(reason, element="motion.objective", advice="leave it out")
        yield from () if self.jump is None else jump_errors(self.robot, self.jump)

    def _errors_in_space(self) -> Iterator[InputError]:
        """What is wrong in space: with the jump around the flight, and a rotation whose direction is left open."""
        yield from () if self.jump is None else jump_errors(self.robot, self.jump)
        if hasattr(self, "initial") and hasattr(self, "final"):
            yield from resolution.attitude_errors(self.initial, self.final)

    def __repr__(self) -> str:
        """At most a few lines: who, from where, to where, in what time."""
        robot, flight, ends = self.robot, self.flight, (self.initial, self.final)
        start, goal = (f"{end.attitude or format(end.orientation, '.4g')}; {shortened(end.positions)}" for end in ends)
        return (
            f"Problem({self.name!r}, {robot.name}, {len(robot.joints)} joints, {flight.duration:g} s,"
            f" {len(self.obstacles)} obstacles)\n  start {start} rad\n  goal {goal} rad"
        )

    def _repr_html_(self) -> str:
        """A table, as notebooks show it."""
        return html_table(self.name, self.rows())

    def rows(self) -> list[tuple[str, str]]:
        """Return names and values, as notebooks and the report show the problem."""
        flight, joints, momentum = self.flight, self.robot.joints, self.flight.angular_momentum
        degrees = "degree " + ", ".join(map(str, self.degrees if len(set(self.degrees)) > 1 else self.degrees[:1]))
        degrees = "the degree that is needed" if self.raises_degree else degrees
        rows = [
            ("robot", f"{self.robot.name}, {len(joints)} planned joints, {self.robot.mass:.4g} kg"),
            ("start", _posture(self.initial, joints)),
            ("goal", _posture(self.final, joints)),
            ("duration", f"{flight.duration:g} s"),
            ("takes off", f"{self.takeoff.frame} at ({shortened(self.takeoff.position, 6)}) m"),
            ("lands", f"{self.landing.frame} at height {self.landing_height:g} m"),
            ("speed", f"{_number(flight.horizontal_velocity)} m/s horizontally, gravity {flight.gravity:g} m/s²"),
            ("momentum", momentum if isinstance(momentum, str) else f"{_number(momentum)} kg m²/s"),
            ("motion", f"sine polynomials of {degrees}, least {self.motion.objective}"),
        ]
        if self.ground:
            rows.append(("ground", "no link below the line on which it took off"))
        return rows + [("obstacle", obstacle.description) for obstacle in self.obstacles]

    def _resolutions(self, changed: Container[str]) -> Iterator[Callable[[], None]]:
        """What resolves the values that depend on parts that have changed."""
        robot, flight, limits = self.robot, self.flight, self.limits
        resolvers: dict[str, tuple[str, Callable[[], object]]] = {
            "initial": ("start", lambda: resolution.joint_state(robot, self.start, "start")),
            "final": ("goal", lambda: resolution.joint_state(robot, self.goal, "goal")),
            "position_limits": ("limits", lambda: resolution.position_limits(robot, limits)),
            "joint_limits": ("limits", lambda: resolution.joint_limits(robot, limits)),
            "torque_limits": ("limits", lambda: resolution.torque_limits(robot, limits.torque)),
            "motor_torque_limits": (
                "limits",
                lambda: resolution.motor_limits(robot, LIMIT_TABLE["torque"], limits.torque),
            ),
            "motor_stall": ("limits", lambda: resolution.motor_values(robot, limits, "stall", math.inf)),
            "motor_slope": ("limits", lambda: resolution.motor_values(robot, limits, "slope", 0.0)),
            "degrees": ("motion", lambda: resolution.degrees_of(robot, self.motion)),
            "reference": ("motion", lambda: resolution.reference_of(robot, self.motion)),
            "takeoff": ("flight", lambda: resolution.takeoff_of(robot, flight)),
            "landing": (
                "flight start goal ground",
                lambda: resolution.landing_of(robot, flight, self.start, self.goal, self.ground),
            ),
        }
        for name, (needed, resolve) in resolvers.items():
            if any(field in changed for field in needed.split()):
                yield partial(self._resolve, name, resolve)

    def _resolve(self, name: str, resolve: Callable[[], object]) -> None:
        object.__setattr__(self, name, resolve())

    @property
    def momentum_interval(self) -> tuple[float, float]:
        """(9), kg m^2/s; refused in space, where there is none."""
        if self.angular_momentum_bounds is None:
            raise self.robot.not_in_plane
        return self.angular_momentum_bounds

    @property
    def velocity_limits(self) -> Array:
        """Limits (n,) rad/s of the planned coordinates; infinite where there is none."""
        return self.joint_limits["velocity"]

    @property
    def limited(self) -> tuple[Array, ...]:
        """All limits on joints and motors but for their ranges, infinite where there is none."""
        return *self.joint_limits.values(), self.torque_limits, self.motor_torque_limits, self.motor_stall

    @property
    def takeoff_frame(self) -> Frame:
        """The takeoff frame, resolved."""
        return self.robot.frames[self.takeoff.frame]

    @property
    def landing_frame(self) -> Frame:
        """The landing frame, resolved."""
        return self.robot.frames[self.landing.frame]

    @cached_property
    @one_thread
    def ground_plane(self) -> parts.Ground | LevelGround:
        """The half-plane below the ground's line, in space the half-space, requested or not.

        Raises
        ------
        InputError
            The collision geometry of the takeoff link is wrong.
        """
        height = resolution.ground_height(self.robot, self.takeoff.frame, self.takeoff.position, self.initial)
        if self.robot.in_plane is None:
            return LevelGround(point=(0.0, 0.0, height))
        return parts.Ground(point=(0.0, height), normal=(0.0, 1.0))

    @cached_property
    def ground_shapes(self) -> tuple[LinkCapsule, ...]:
        """Shapes of all links by whose ends heights over the ground are measured; errors as above.

        Exact are those that touch it: the links that take off and land, and ends of limbs that are as low there.
        """
        robot, line = self.robot, self.ground_plane.point[1]
        ends = (
            (self.takeoff_frame, self.takeoff.position[1], self.initial),
            (self.landing_frame, self.landing_height, self.final),
        )
        low: list[str] = []
        for link in robot.limb_ends:
            for frame, height, state in ends:
                above_frame = resolution.lowest_point(robot, link, state) - resolution.frame_height(robot, frame, state)
                if height + above_frame - line < resolution.TOUCHING and link not in low:
                    low.append(link)
        return robot.hulls((self.takeoff.frame, self.landing.frame), low)

    def settled(self, velocities: Array, accelerations: Array) -> Problem:
        """Return the problem with what a plan has come to, where it asks for words: arrays (2, n), start and goal.

        Raises
        ------
        InputError
            A joint on the edge of its range would have to move.
        """
        pairs = zip(velocities, accelerations, strict=True)
        start, goal = ((read_only(velocity), read_only(acceleration)) for velocity, acceleration in pairs)
        return replace(
            self,
            start=replace(self.start, settled=start),
            goal=replace(self.goal, settled=goal),
            written=self.file_text,
        )


def _number(value: float | tuple[float, ...]) -> str:
    return f"({shortened(value, 6)})" if isinstance(value, tuple) else f"{value:g}"


def _posture(state: parts.JointState, joints: Sequence[str]) -> str:
    if state.attitude is not None:
        return f"{state.attitude}, joints ({shortened(np.rad2deg(state.positions) + 0.0)})°"
    angles = np.rad2deg([state.orientation, *state.positions]) + 0.0
    if len(joints) <= LONGEST_LIST:
        return ", ".join(f"{name} {angle:.5g}°" for name, angle in zip(("orientation", *joints), angles, strict=True))
    listed = ", ".join(f"{angle:.5g}" for angle in angles[1 : LONGEST_LIST + 1])
    return f"orientation {angles[0]:.5g}°, joints {listed}, … ({len(joints)} in all)°"


@dataclass(frozen=True, eq=False)
class Shares:
    """Limits (r,) of a key, in a unit, and what is used of them: the magnitudes of two sums of quantities, added.

    ``used, also`` : weights (r, m) of quantities by their names; their sums are 1 where the whole of a limit is used
    """

    key: LimitKey
    labels: tuple[str, ...]
    limit: Array
    unit: str
    used: Mapping[str, Array]
    also: Mapping[str, Array] = field(default_factory=dict)


def shares_of_limits(problem: Problem) -> Iterator[Shares]:
    """Yield what a problem's limits bound, or those of many, of which the same are finite.

    They are those of the motors' own torques, of generalised ones where these do not imply them, of the joints' rates
    and accelerations, of motors that are weaker at speed, and of the base's rate.
    """
    robot, own, generalized = problem.robot, problem.motor_torque_limits, problem.torque_limits
    if generalized.min(initial=np.inf) < np.inf:
        implied = ((robot.motor_ratios == 0) | np.isfinite(own[..., None])).all(axis=-2)
        generalized = np.where(implied, np.inf, generalized)
    kinds: list[tuple[LimitKey, str, Array, Sequence[str], Array | None, Array | None]] = [
        ("torque", "torque", own, robot.motors, None, None),
        ("torque", "generalized torque", generalized, robot.joints, robot.motor_ratios.T, None),
        *((row.key, row.key, problem.joint_limits[row.key], robot.joints, None, None) for row in JOINT_LIMITS),
        ("torque", "speed-dependent torque", problem.motor_stall, robot.motors, None, problem.motor_slope),
    ]
    for key, what, limits, subjects, rows, slope in kinds:
        first = limits if limits.ndim == 1 else limits[0]
        limited = np.flatnonzero(first < math.inf).tolist()
        if limited:
            row, limit = LIMIT_TABLE[key], limits[..., limited]
            names = tuple(f"{what} of {subjects[i]}" for i in limited)
            used = (identity(len(subjects)) if rows is None else rows)[limited] / limit[..., None]
            also = {}
            if slope is not None:
                also["velocities"] = (slope[..., limited] / limit)[..., None] * robot.motor_ratios[limited]
            yield Shares(key, names, limit, row.unit, {row.quantity: used}, also)
    if problem.limits.orientation_rate is not None:
        row, limit = LIMIT_TABLE["orientation_rate"], np.array([problem.limits.orientation_rate])
        yield Shares(row.key, ("orientation rate",), limit, row.unit, {row.quantity: 1 / limit[:, None]})
