"""What is drawn over time, in figures and in the report: curves with their limits, proved peaks and ends."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.plans.verdicts import Certificate
from floatplan.tables import JOINT_LIMITS, LimitRow
from floatplan.view.jumps import efforts, footing
from floatplan.view.outlines import robot_size
from floatplan.view.sampled import SampledPlan, attitude_axes, flies_in_space, limits_in_use
from floatplan.view.style import ALARM, GREY, INK, OBSTACLES, OKABE_ITO, palette

ALIKE = 0.01  # [-] of a leader's peak: followers whose torques differ by less are not drawn
MOMENTS = ("least", "middle", "largest")
INTERVAL = "h without turning back"  # what (9) holds
NEAR = 2.5  # [-] a limit is drawn if it is at most this many times the largest value


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity over time.

    Attributes
    ----------
    name, colour : of the curve
    key : of its column in :class:`SampledPlan`
    part : 0 for the base, i + 1 for what joint i moves, None for neither
    limit : (N,) or one, on both sides; infinite where there is none, None of what has no limits
    proved : largest magnitude that is proved; of clearances the least value; infinite where none is
    ends : where the problem has it start and end
    linestyle : dotted of a follower
    """

    name: str
    key: str
    colour: Any
    part: int | None = None
    limit: Array | float | None = None
    proved: float = np.inf
    ends: tuple[float, float] | None = None
    linestyle: str = "-"


@dataclass(frozen=True, eq=False)
class ReferenceLine:
    """What curves are held against: its name, colour, value, () or samples (N,), and the part that it is about."""

    name: str
    colour: Any
    value: Array
    part: int | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves on one axis.

    Attributes
    ----------
    label : in front of the unit
    interval : of its quantity that is marked: (9)
    range : ends of the axis of distances, where what is far away is cut off
    fixed : margins, and other lines that are drawn however far away they are
    """

    label: str
    curves: Sequence[Curve]
    interval: tuple[float, float] | None = None
    range: tuple[float, float] | None = None
    fixed: Sequence[ReferenceLine] = ()

    def lines(self, peak: float) -> tuple[list[ReferenceLine], list[ReferenceLine]]:
        """Return margins, limits and interval, and those of them that are left out: they would flatten the curves.

        The largest magnitude drawn is ``peak``. One limit for several curves is one line, of no part.
        """
        known = [np.atleast_1d(np.inf if curve.limit is None else curve.limit) for curve in self.curves]
        curves = list(self.curves)
        limits = np.array(np.broadcast_arrays(*known))
        if len(curves) > 1 and (limits == limits[0, 0]).all():
            curves = [Curve("", "", INK)]
            limits = limits[:1]
        drawn = [*self.fixed]
        left: list[ReferenceLine] = []
        for curve, limit in zip(curves, limits, strict=True):
            if np.isfinite(limit.min()):
                lines = [ReferenceLine("limit", curve.colour, side * limit, curve.part) for side in (1.0, -1.0)]
                (drawn if limit.min() <= NEAR * peak else left).extend(lines)
        if self.interval is not None:
            near = max(map(abs, self.interval)) <= NEAR * peak
            (drawn if near else left).extend(ReferenceLine(INTERVAL, INK, np.array(end)) for end in self.interval)
        return drawn, left


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one kind.

    Attributes
    ----------
    name : of its figure
    title, unit : for a person; bands, which are there or not, have no unit
    panels : axes, the tallest first
    factor : from SI to ``unit``
    of_each : whether each curve has a picture of its own where they are too many for one
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
        return [curve for panel in reversed(self.panels) for curve in panel.curves]


def charts(sampled: SampledPlan, other: SampledPlan | None = None) -> list[Chart]:
    """Return a plan's charts: angles, what is limited of the joints, torques, momentum, inertia, clearance.

    Curves of another plan may be drawn beside them. In space shares of limits are told too. A jump has what stands,
    forces, shares of limits and the height of the centre of mass in the place of momentum and inertia.
    """
    plan = sampled.plan
    joints = range(len(plan.robot.joints))
    limits = plan.whole_problem.joint_limits
    states = (plan.whole_problem.initial, plan.whole_problem.final)
    keys = [f"positions.{joint}" for joint in joints]
    if flies_in_space(plan):
        ends = [tuple(state.positions) for state in states]
    else:
        ends = [(state.orientation, *state.positions) for state in states]
        keys = ["orientation", *keys]
    angles = _of_parts(plan, keys, ends=list(zip(*ends, strict=True)))
    drawn = [
        Chart("configuration", "Angles", "deg", [Panel("angle", angles)], factor=180 / np.pi),
        *(_limited(plan, row) for row in JOINT_LIMITS if row.always or np.isfinite(limits[row.key]).any()),
        Chart("torques", "Torques", "N m", [Panel("torque", _motors(sampled))]),
    ]
    if flies_in_space(plan):
        drawn = [_attitude(plan), *drawn, *_shares_in_space(sampled, plan), *_momentum_in_space(plan)]
    elif isinstance(plan, JumpMotion):
        drawn = [*_of_jump(sampled, plan), *drawn]
    elif isinstance(plan, Plan):
        inertia = _of_parts(plan, [f"inertia.{part}" for part in range(len(joints) + 1)])
        drawn += [_momentum(plan), Chart("inertia", "Inertia row D", "kg m²", [Panel("D", inertia)])]
    return [*drawn, _clearance(sampled, other)] if plan.whole_problem.obstacles else drawn


def _of_jump(sampled: SampledPlan, jump: JumpMotion) -> list[Chart]:
    """What stands, forces, what is used of friction and of limits, height."""
    robot = jump.robot
    problem = jump.whole_problem
    margin = jump.request.margin
    held_by = efforts(jump)
    stands, forces, friction = (
        [Curve(name, f"{key}.{index}", colour) for index, (name, colour) in enumerate(footing(jump).colours.items())]
        for key in ("stands", "force_z", "friction")
    )
    limits = np.minimum(problem.motor_torque_limits, problem.motor_stall)
    effort_limits = np.array([*held_by.values()])
    rates = _of_parts(jump, [f"velocities.{joint}" for joint in range(len(robot.joints))])
    by_use = sorted(enumerate(held_by), key=lambda each: -largest(sampled.columns[f"held_use.{each[0]}"]))
    held = [Curve(name, "", colour) for (_, name), colour in zip(by_use, OBSTACLES, strict=False)]  # the most used
    cone = Panel("|Fx| over μ Fz", friction, fixed=[ReferenceLine("limit", INK, np.array(1.0))])
    drawn = [
        Chart("contacts", "On the ground", "", [Panel("", stands)], of_each=False),
        Chart("forces", "Vertical forces", "N", [Panel("vertical force", forces)], of_each=False),
        Chart("friction", "Friction used", "%", [cone], factor=100, of_each=False),
        _shares("torque_use", "Torque over limit", _motors(sampled), robot.motors, limits, margin["torque"]),
        _shares("held_use", "Torque of held joints over effort", held, tuple(held_by), effort_limits),
        _shares("rate_use", "Rate over limit", rates, robot.joints, problem.velocity_limits, margin["velocity"]),
        Chart("com_height", "Height of the centre of mass", "m", [Panel("height", [Curve("CM", "com_height", INK)])]),
    ]
    return [chart for chart in drawn if chart.curves]


def _shares(
    name: str, title: str, curves: list[Curve], order: tuple[str, ...], limits: Array, margin: float = 1.0
) -> Chart:
    """Shares of limits, of what has one; ``order`` is that of columns and limits, ``margin`` what stances may use."""
    places = [(curve, order.index(curve.name)) for curve in curves]
    limited = [(curve, index) for curve, index in places if np.isfinite(limits[index])]
    shares = [replace(curve, key=f"{name}.{index}", limit=None, proved=np.inf) for curve, index in limited]
    ends = {"limit": (INK, 1.0)} | ({"margin of stances": (ALARM, margin)} if margin < 1.0 else {})
    signed = [(name, colour, side * end) for name, (colour, end) in ends.items() for side in (1.0, -1.0)]
    lines = [ReferenceLine(name, colour, np.array(value)) for name, colour, value in signed]
    return Chart(name, title, "%", [Panel(title.lower(), shares, fixed=lines)], factor=100)


def _attitude(plan: Plan) -> Chart:
    """Angles of the base, with whole turns; where the problem gives two quaternions yaw, pitch and roll."""
    axes, names = attitude_axes(plan.problem)
    states = (plan.problem.initial, plan.problem.final)
    ends = np.array([np.zeros(3) if state.attitude is None else state.attitude.angles_about(axes) for state in states])
    curves = [
        Curve(f"{name} {axis}", f"orientation.{index}", OKABE_ITO[index], 0, ends=(float(start), float(goal)))
        for index, (name, axis, start, goal) in enumerate(zip(names, axes, *ends, strict=True))
    ]
    return Chart("orientation", "Orientation", "deg", [Panel("angle", curves)], 180 / np.pi, of_each=False)


def _momentum_in_space(plan: Plan) -> list[Chart]:
    """What base and joints have of h, along it, and how the robot's inertia changes."""
    curves = [
        Curve("base", "momentum_base", OKABE_ITO[0]),
        Curve("joints", "momentum_joints", OKABE_ITO[1]),
        Curve("h", "momentum", INK),
    ]
    moments = [Curve(name, f"inertia.{index}", OKABE_ITO[index]) for index, name in enumerate(MOMENTS)]
    panel = Panel("momentum", curves)
    inertia = Panel("inertia", moments)
    return [
        Chart("momentum", "Angular momentum along h", "kg m²/s", [panel], of_each=False),
        Chart("inertia", "Principal moments of inertia", "kg m²", [inertia], of_each=False),
    ]


def _shares_in_space(sampled: SampledPlan, plan: Plan) -> list[Chart]:
    """What is used of limits, asked for or the file's."""
    limits = limits_in_use(plan)
    robot = plan.robot
    rates = _of_parts(plan, [f"velocities.{joint}" for joint in range(len(robot.joints))])
    drawn = [
        _shares("torque_use", "Torque over limit", _motors(sampled), robot.motors, limits["torque"]),
        _shares("rate_use", "Rate over limit", rates, robot.motors, limits["velocity"]),
    ]
    return [chart for chart in drawn if chart.curves]


def largest(values: Array) -> float:
    """Largest magnitude of a sampled quantity (N,), of what is known of it."""
    return float(np.fmax.reduce(np.abs(values)))


def certificate_of(motion: Trajectory) -> Certificate | None:
    """Return what was proved of all of a motion: nothing of a jump, whose flight alone has a certificate."""
    return motion.certificate if isinstance(motion, Plan) else None


def is_crowded(plan: Trajectory) -> bool:
    """Whether a robot has more parts than there are hues that everyone can tell apart."""
    return len(plan.robot.joints) + 1 > len(OKABE_ITO)


def _of_parts(plan: Trajectory, keys: Sequence[str], **more: Sequence[Any]) -> list[Curve]:
    """Curves of the last of base and joints, with what more they have."""
    first = len(plan.robot.joints) + 1 - len(keys)
    names = ("orientation", *plan.robot.joints)
    colours = palette(len(plan.robot.joints) + 1)
    return [
        Curve(names[part], key, colours[part], part, **{name: values[part - first] for name, values in more.items()})
        for part, key in enumerate(keys, first)
    ]


def _limited(plan: Trajectory, row: LimitRow) -> Chart:
    """What a row of the table limits: that of the joints, and of the base where it has one."""
    keys = [f"{row.quantity}.{index}" for index in range(len(plan.robot.joints))]
    certificate = certificate_of(plan)
    peaks = None if certificate is None else getattr(certificate, f"{row.key}_peak", None)
    proved = np.full(len(keys), np.inf) if peaks is None else peaks
    joints = _of_parts(plan, keys, limit=plan.whole_problem.joint_limits[row.key].tolist(), proved=proved.tolist())
    panels = [Panel("joints", joints)]
    if row.base is not None:
        limit = getattr(plan.whole_problem.limits, row.base)
        colour = palette(len(keys) + 1)[0]
        base = Curve("orientation", row.base, colour, 0, np.inf if limit is None else float(limit))
        panels.append(Panel("orientation", [base]))
    return Chart(row.title.lower(), row.title, row.unit, panels)


def _motors(sampled: SampledPlan) -> list[Curve]:
    """The motors' own torques, in their leaders' colours; followers that do as their leaders do are left out."""
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
    followed = torques[:, leaders]
    apart = np.minimum(np.abs(torques - followed).max(axis=0), np.abs(torques + followed).max(axis=0))
    differ = apart > ALIKE * np.abs(followed).max(axis=0)
    return [
        Curve(
            name=name,
            key=f"motor_torques.{motor}",
            colour=colours[leaders[motor]],
            part=int(leaders[motor]) + 1,
            limit=limits[:, motor],
            proved=proved.get(name, np.inf),
            linestyle=":" if motor >= joints else "-",
        )
        for motor, name in enumerate(motors)
        if motor < joints or differ[motor]
    ]


def _momentum(plan: Plan) -> Chart:
    """What base and joints have of h, and the interval (9) that holds h of joints which do not turn back."""
    curves = [
        Curve("base", "momentum_base", OKABE_ITO[0]),
        Curve("joints", "momentum_joints", OKABE_ITO[1] if is_crowded(plan) else GREY),
        Curve("h", "angular_momentum", INK),
    ]
    panel = Panel("momentum", curves, plan.angular_momentum_bounds)
    return Chart("momentum", "Angular momentum", "kg m²/s", [panel], of_each=False)


def _clearance(sampled: SampledPlan, other: SampledPlan | None) -> Chart:
    """Distances from obstacles; what is far away is cut off, the picture is of the passage."""
    plan = sampled.plan
    obstacles = plan.whole_problem.obstacles
    certificate = certificate_of(plan)
    kinds = [obstacle.kind for obstacle in obstacles]
    findings = () if certificate is None else certificate.findings
    proved = {
        finding.subject: finding.bound
        for finding in findings
        if finding.kind == "obstacle" and finding.verdict == "proved" and finding.bound is not None
    }
    curves = [
        Curve(
            name=kind if kinds.count(kind) == 1 else f"{kind} {kinds[: index + 1].count(kind)}",
            key=f"clearance.{index}",
            colour=OBSTACLES[index % len(OBSTACLES)],
            proved=proved.get((index, kind), np.inf),
        )
        for index, kind in enumerate(kinds)
    ]
    plans = [sampled] if other is None else [sampled, other]
    values = np.array([each.columns[curve.key] for each in plans for curve in curves])
    margins = np.unique([obstacle.margin for obstacle in obstacles])
    fixed = [ReferenceLine("margin", ALARM, margin) for margin in margins]
    farthest = values.max(where=np.isfinite(values), initial=0.0)
    top = min(1.05 * farthest, max(robot_size(plan) / 2, 4 * margins[-1])) or 1.0
    panel = Panel("clearance", curves, range=(min(1.1 * values.min(), -0.06 * top), top), fixed=fixed)
    return Chart("clearance", "Clearance", "m", [panel], of_each=False)
