"""Charts over time, in figures and in the report: curves with their limits, proved peaks and ends."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.plans.verdicts import Certificate
from floatplan.problem.ground_step import OfHigherGround
from floatplan.tables import JOINT_LIMITS, LimitRow
from floatplan.view.jumps import efforts, flies_in_space, footing
from floatplan.view.outlines import robot_size
from floatplan.view.sampled import SampledPlan, attitude_axes, limits_in_use
from floatplan.view.style import PALETTE, palette

INTERVAL = "h without turning back"  # name of the interval (9)


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity over time.

    Attributes
    ----------
    name, colour : of the curve
    key : of its column in :class:`SampledPlan`
    segment : 0 for the base, i + 1 for what joint i moves, None for neither
    limit : (N,) or one, on both sides; infinite where there is none, None of what has no limits
    proved : largest magnitude that is proved; of clearances the least value; infinite where none is
    ends : where the problem has it start and end
    linestyle : dotted of a follower
    """

    name: str
    key: str
    colour: Any
    segment: int | None = None
    limit: Array | float | None = None
    proved: float = np.inf
    ends: tuple[float, float] | None = None
    linestyle: str = "-"


@dataclass(frozen=True, eq=False)
class ReferenceLine:
    """A line that curves are compared with: name, colour, value, () or samples (N,), and the segment it is about."""

    name: str
    colour: Any
    value: Array
    segment: int | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves on one axis.

    Attributes
    ----------
    label : in front of the unit
    interval : (9), shaded
    range : ends of the axis of distances; what is further away is cut off
    fixed : margins, and other lines that are shown however far away they are
    """

    label: str
    curves: Sequence[Curve]
    interval: tuple[float, float] | None = None
    range: tuple[float, float] | None = None
    fixed: Sequence[ReferenceLine] = ()

    def lines(self, peak: float) -> tuple[list[ReferenceLine], list[ReferenceLine]]:
        """Return margins, limits and interval, and those of them that are left out: they would flatten the curves.

        The largest magnitude shown is ``peak``. One limit for several curves is one line, of no segment.
        """
        farthest = 2.5 * peak  # [-] a line farther away than this makes the curves too flat to read
        curves = list(self.curves)
        limits = np.array(np.broadcast_arrays(*map(_limit_of, curves)))
        if len(curves) > 1 and (limits == limits[0, 0]).all():
            curves = [Curve("", "", PALETTE.ink)]
            limits = limits[:1]
        shown = [*self.fixed]
        omitted: list[ReferenceLine] = []
        for curve, limit in zip(curves, limits, strict=True):
            if np.isfinite(limit.min()):
                lines = shown if limit.min() <= farthest else omitted
                lines.append(ReferenceLine("limit", curve.colour, limit, curve.segment))
                lines.append(ReferenceLine("limit", curve.colour, -limit, curve.segment))
        if self.interval is not None:
            lines = shown if max(map(abs, self.interval)) <= farthest else omitted
            lines += [ReferenceLine(INTERVAL, PALETTE.ink, np.array(end)) for end in self.interval]
        return shown, omitted


def _limit_of(curve: Curve) -> Array:
    return np.atleast_1d(np.inf if curve.limit is None else curve.limit)


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one kind.

    Attributes
    ----------
    name : of its figure
    title, unit : for a person; bands, which are there or not, have no unit
    panels : axes, the tallest first
    factor : from SI to ``unit``
    of_each : whether a curve has a picture of its own where there are too many for one
    """

    name: str
    title: str
    unit: str
    panels: Sequence[Panel]
    factor: float = 1.0
    of_each: bool = True

    @property
    def curves(self) -> list[Curve]:
        """All curves, the base's first."""
        curves: list[Curve] = []
        for panel in reversed(self.panels):
            curves += panel.curves
        return curves


def charts(sampled: SampledPlan, other: SampledPlan | None = None) -> list[Chart]:
    """Return a plan's charts: angles, limited quantities of the joints, torques, momentum, inertia, clearance.

    Another plan's curves may be compared with them. In space there are shares of limits, too. Of a jump contacts,
    forces, shares of limits and the height of the centre of mass replace momentum and inertia.
    """
    plan = sampled.plan
    joints = range(len(plan.robot.joints))
    limits = plan.whole_problem.joint_limits
    problem = plan.whole_problem
    keys = [f"positions.{joint}" for joint in joints]
    starts = [*problem.initial.positions]
    goals = [*problem.final.positions]
    if not flies_in_space(plan):
        keys.insert(0, "orientation")
        starts.insert(0, problem.initial.orientation)
        goals.insert(0, problem.final.orientation)
    angles = _of_segments(plan, keys, ends=list(zip(starts, goals, strict=True)))
    result = [Chart("configuration", "Angles", "deg", [Panel("angle", angles)], factor=180 / np.pi)]
    limited = [row for row in JOINT_LIMITS if row.always or np.isfinite(limits[row.key]).any()]
    result += [_limited(plan, row) for row in limited]
    result.append(Chart("torques", "Torques", "N m", [Panel("torque", _motors(sampled))]))
    if flies_in_space(plan):
        result.insert(0, _attitude(plan))
    if isinstance(plan, JumpMotion):
        result = [*_of_jump(sampled, plan), *result]
    elif isinstance(plan, Plan) and flies_in_space(plan):
        result += [*_shares_in_space(sampled, plan), *_momentum_in_space(plan)]
    elif isinstance(plan, Plan):
        inertia = _of_segments(plan, [f"inertia.{segment}" for segment in range(len(joints) + 1)])
        result += [_momentum(plan), Chart("inertia", "Inertia row D", "kg m²", [Panel("D", inertia)])]
    return [*result, _clearance(sampled, other)] if problem.obstacles else result


def _of_jump(sampled: SampledPlan, jump: JumpMotion) -> list[Chart]:
    """Contacts, forces, shares of friction and of limits, height."""
    robot = jump.robot
    problem = jump.whole_problem
    margin = jump.request.margin
    lock_limits = efforts(jump)
    stands = _of_contacts(jump, "stands")
    forces = _of_contacts(jump, "force_z")
    friction = _of_contacts(jump, "friction")
    limits = np.minimum(problem.motor_torque_limits, problem.motor_stall)
    rates = _of_segments(jump, [f"velocities.{joint}" for joint in range(len(robot.joints))])
    by_use = sorted(enumerate(lock_limits), key=lambda lock: -largest(sampled.columns[f"held_use.{lock[0]}"]))
    locks = [
        Curve(name, "", colour) for (_, name), colour in zip(by_use, PALETTE.obstacles, strict=False)
    ]  # the most used
    horizontal = "horizontal force" if flies_in_space(jump) else "|Fx|"
    cone = Panel(f"{horizontal} over μ Fz", friction, fixed=[ReferenceLine("limit", PALETTE.ink, np.array(1.0))])
    height = Panel("height", [Curve("CM", "com_height", PALETTE.ink)])
    result = [
        Chart("contacts", "On the ground", "", [Panel("", stands)], of_each=False),
        Chart("forces", "Vertical forces", "N", [Panel("vertical force", forces)], of_each=False),
        Chart("friction", "Friction used", "%", [cone], factor=100, of_each=False),
        _shares("torque_use", "Torque over limit", _motors(sampled), robot.motors, limits, margin["torque"]),
        _shares(
            "held_use",
            "Torque of held joints over effort",
            locks,
            tuple(lock_limits),
            np.array([*lock_limits.values()]),
        ),
        _shares("rate_use", "Rate over limit", rates, robot.joints, problem.velocity_limits, margin["velocity"]),
        Chart("com_height", "Height of the centre of mass", "m", [height]),
    ]
    return [chart for chart in result if chart.curves]


def _of_contacts(jump: JumpMotion, key: str) -> list[Curve]:
    """A curve for each contact of a jump."""
    colours = footing(jump).colours
    return [Curve(name, f"{key}.{index}", colour) for index, (name, colour) in enumerate(colours.items())]


def _shares(
    name: str, title: str, curves: list[Curve], order: tuple[str, ...], limits: Array, margin: float = 1.0
) -> Chart:
    """Shares of limits; ``order`` is that of columns and limits, ``margin`` the share that stances may use."""
    shares = []
    for curve in curves:
        index = order.index(curve.name)
        if np.isfinite(limits[index]):
            shares.append(replace(curve, key=f"{name}.{index}", limit=None, proved=np.inf))
    ends = {"limit": (PALETTE.ink, 1.0)}
    if margin < 1.0:
        ends["margin of stances"] = (PALETTE.alarm, margin)
    lines = []
    for label, (colour, end) in ends.items():
        lines.append(ReferenceLine(label, colour, np.array(end)))
        lines.append(ReferenceLine(label, colour, np.array(-end)))
    return Chart(name, title, "%", [Panel(title.lower(), shares, fixed=lines)], factor=100)


def _attitude(plan: Trajectory) -> Chart:
    """Angles of the base, with whole turns; where the problem gives two quaternions yaw, pitch and roll."""
    problem = plan.whole_problem
    axes, names = attitude_axes(problem)
    states = (problem.initial, problem.final)
    ends = [np.zeros(3) if state.attitude is None else state.attitude.angles_about(axes) for state in states]
    curves = []
    for index, (name, axis, start, goal) in enumerate(zip(names, axes, *ends, strict=True)):
        colour = PALETTE.hues[index]
        ends_of_angle = (float(start), float(goal))
        curves.append(Curve(f"{name} {axis}", f"orientation.{index}", colour, 0, ends=ends_of_angle))
    return Chart("orientation", "Orientation", "deg", [Panel("angle", curves)], 180 / np.pi, of_each=False)


def _momentum_in_space(plan: Plan) -> list[Chart]:
    """The parts of h that base and joints have, along h, and how the robot's inertia changes."""
    curves = [
        Curve("base", "momentum_base", PALETTE.hues[0]),
        Curve("joints", "momentum_joints", PALETTE.hues[1]),
        Curve("h", "momentum", PALETTE.ink),
    ]
    panel = Panel("momentum", curves)
    moments = ("least", "middle", "largest")
    inertia = Panel("inertia", [Curve(name, f"inertia.{i}", PALETTE.hues[i]) for i, name in enumerate(moments)])
    return [
        Chart("momentum", "Angular momentum along h", "kg m²/s", [panel], of_each=False),
        Chart("inertia", "Principal moments of inertia", "kg m²", [inertia], of_each=False),
    ]


def _shares_in_space(sampled: SampledPlan, plan: Plan) -> list[Chart]:
    """Shares of the limits of the problem or the file."""
    limits = limits_in_use(plan)
    robot = plan.robot
    rates = _of_segments(plan, [f"velocities.{joint}" for joint in range(len(robot.joints))])
    result = [
        _shares("torque_use", "Torque over limit", _motors(sampled), robot.motors, limits["torque"]),
        _shares("rate_use", "Rate over limit", rates, robot.motors, limits["velocity"]),
    ]
    return [chart for chart in result if chart.curves]


def largest(values: Array) -> float:
    """Largest magnitude of a sampled quantity (N,); NaN does not count."""
    return float(np.fmax.reduce(np.abs(values)))


def certificate_of(motion: Trajectory) -> Certificate | None:
    """Return the certificate of a whole motion: none of a jump, since its flight is all that is proved."""
    return motion.certificate if isinstance(motion, Plan) else None


def is_crowded(plan: Trajectory) -> bool:
    """Whether a robot has more segments than there are hues that everyone can tell apart."""
    return len(plan.robot.joints) + 1 > len(PALETTE.hues)


def _of_segments(plan: Trajectory, keys: Sequence[str], **fields: Sequence[Any]) -> list[Curve]:
    """Curves of the last of base and joints, as many as there are keys; fields have a value for each."""
    first = len(plan.robot.joints) + 1 - len(keys)
    names = ("orientation", *plan.robot.joints)
    colours = palette(len(plan.robot.joints) + 1)
    curves = []
    for index, key in enumerate(keys):
        segment = first + index
        own = {name: values[index] for name, values in fields.items()}
        curves.append(Curve(names[segment], key, colours[segment], segment, **own))
    return curves


def _limited(plan: Trajectory, row: LimitRow) -> Chart:
    """A limited quantity of a row of the table: that of the joints, and of the base where it has one."""
    keys = [f"{row.quantity}.{index}" for index in range(len(plan.robot.joints))]
    certificate = certificate_of(plan)
    peaks = None if certificate is None else getattr(certificate, f"{row.key}_peak", None)
    proved = np.full(len(keys), np.inf) if peaks is None else peaks
    joints = _of_segments(plan, keys, limit=plan.whole_problem.joint_limits[row.key].tolist(), proved=proved.tolist())
    panels = [Panel("joints", joints)]
    if row.base is not None:
        limit = getattr(plan.whole_problem.limits, row.base)
        colour = palette(len(keys) + 1)[0]
        base = Curve("orientation", row.base, colour, 0, np.inf if limit is None else float(limit))
        panels.append(Panel("orientation", [base]))
    return Chart(row.title.lower(), row.title, row.unit, panels)


def _motors(sampled: SampledPlan) -> list[Curve]:
    """The motors' own torques, in their leaders' colours; followers with the torque of their leader are left out."""
    plan = sampled.plan
    motors = sampled.plan.robot.motors
    leaders: IntArray = np.abs(plan.robot.motor_ratios).argmax(axis=1)
    colours = palette(len(plan.robot.joints) + 1)[1:]
    joints = len(plan.robot.joints)
    problem = plan.whole_problem
    certificate = certificate_of(plan)
    rates = np.abs(sampled.state.velocities @ plan.robot.motor_ratios.T)
    available = problem.motor_stall - problem.motor_slope * rates
    limits = np.minimum(problem.motor_torque_limits, available)
    proved = {} if certificate is None else certificate.motor_torque_peak
    torques = sampled.state.motor_torques
    of_leader = torques[:, leaders]
    apart = np.minimum(np.abs(torques - of_leader).max(axis=0), np.abs(torques + of_leader).max(axis=0))
    # 1 % of the leader's peak: two curves that differ by less look like one
    differ = apart > 0.01 * np.abs(of_leader).max(axis=0)
    curves = []
    for motor, name in enumerate(motors):
        is_follower = motor >= joints
        if is_follower and not differ[motor]:
            continue
        curve = Curve(
            name=name,
            key=f"motor_torques.{motor}",
            colour=colours[leaders[motor]],
            segment=int(leaders[motor]) + 1,
            limit=limits[:, motor],
            proved=proved.get(name, np.inf),
            linestyle=":" if is_follower else "-",
        )
        curves.append(curve)
    return curves


def _momentum(plan: Plan) -> Chart:
    """The parts of h that base and joints have, and the interval (9) of h in which joints need not reverse."""
    curves = [
        Curve("base", "momentum_base", PALETTE.hues[0]),
        Curve("joints", "momentum_joints", PALETTE.hues[1] if is_crowded(plan) else PALETTE.grey),
        Curve("h", "angular_momentum", PALETTE.ink),
    ]
    panel = Panel("momentum", curves, plan.angular_momentum_bounds)
    return Chart("momentum", "Angular momentum", "kg m²/s", [panel], of_each=False)


def _clearance(sampled: SampledPlan, other: SampledPlan | None) -> Chart:
    """Distances from obstacles; what is far away is cut off, so that the passage fills the picture."""
    plan = sampled.plan
    obstacles = plan.whole_problem.obstacles
    certificate = certificate_of(plan)
    names = ["edge" if isinstance(obstacle, OfHigherGround) else obstacle.kind for obstacle in obstacles]
    proved = {}
    for finding in () if certificate is None else certificate.findings:
        if finding.kind == "obstacle" and finding.verdict == "proved" and finding.bound is not None:
            proved[finding.subject] = finding.bound
    curves = []
    values = []
    for index, (name, obstacle) in enumerate(zip(names, obstacles, strict=True)):
        curve = Curve(
            name=name if names.count(name) == 1 else f"{name} {names[: index + 1].count(name)}",
            key=f"clearance.{index}",
            colour=PALETTE.obstacles[index % len(PALETTE.obstacles)],
            proved=proved.get((index, obstacle.kind), np.inf),
        )
        curves.append(curve)
        values.append(sampled.columns[curve.key])
        if other is not None:
            values.append(other.columns[curve.key])
    margins = np.unique([obstacle.margin for obstacle in obstacles])
    fixed = [ReferenceLine("margin", PALETTE.alarm, margin) for margin in margins]
    distances = np.array(values)
    farthest = distances.max(where=np.isfinite(distances), initial=0.0)
    top = min(1.05 * farthest, max(robot_size(plan) / 2, 4 * margins[-1])) or 1.0
    panel = Panel("clearance", curves, range=(min(1.1 * distances.min(), -0.06 * top), top), fixed=fixed)
    return Chart("clearance", "Clearance", "m", [panel], of_each=False)
