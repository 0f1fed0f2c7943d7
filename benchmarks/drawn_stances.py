"""Stances drawn at random from rest to a takeoff, so that the takeoff is known to be within reach.

Either all feet leave at once, or the front ones first. Where both pairs stand, orientation and centre of mass follow
quintics, and the legs them; on the rear feet alone all joints follow quintics, and the orientation the balance of
moments. Accelerations at the ends are those at which feet that leave carry nothing. What does not hold at 2 kHz by
Pinocchio's inverse dynamics is drawn again. Limits are a little above what the stance needs.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.jumps.check import sentences_on, stance_figures
from floatplan.jumps.contacts import GroundContact, contact_at
from floatplan.jumps.exact import OnePoint, StanceDynamics
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.model import PlanarModel, anchor_force, casadi
from floatplan.jumps.motion import Grid, Stance, quintic
from floatplan.jumps.phases import Phase, standing_posture
from floatplan.motion.flight import flight_of
from floatplan.planning.variables import decision_variables
from floatplan.plans.plan import Plan
from floatplan.robot.standing import corners, positions_from_com, undersides
from floatplan.tables import POINT_FEET

NODES = 61  # [-] of each phase
FEW = 13  # [-] of one that is only tried
FOLLOWED = 12  # [-] times, at most, until feet carry nothing at the end
WIDER = 1.5  # [-] bounds of durations about those that are known
HEADROOM = 1.05  # [-] of limits over what the stance needs
SLIPPERY = (0.25, 0.8)  # [-] friction of what is kept
RISING = (0.6, 2.8)  # [m/s] of the centre of mass at takeoff
GRAVITY = 9.81
TORQUE, FASTEST = 5.0, 40.0  # [N m], [rad/s] where the file gives none
ROBOTS = {
    "Go2": ("go2_description/urdf/go2.urdf", "RL_foot", "FL_foot"),
    "A1": ("a1_description/urdf/a1.urdf", "RL_foot", "FL_foot"),
    "Solo12": ("solo_description/robots/solo12.urdf", "HL_FOOT", "FL_FOOT"),
}
# Of the seeds 0, 1, ..., those whose draws hold: one in 230, and one in 37. Others need not be tried again.
STANCE_SEEDS = """
    16 324 325 526 548 592 616 971 979 1070 1085 2462 2466 3119 3122 3329 3339 4215 4234 4303 4311 4402 4405
    4592 4611 6941 6959 7077 7078 7084 7158 7514 7539 7540 7545 8218 8320 8462 8465 8530 8535 9249 9270 9285
    9332 9993 9994 11141 11166 11427
"""
HOP_SEEDS = """
    16 29 33 49 71 73 139 154 159 161 165 169 561 564 565 686 710 711 783 798 799 813 819 845 849 867 868 924
    947 952 979 1015 1016 1024 1035 1052 1191 1219 1222 1316 1322 1342 1368 1407 1414 1624 1673 1677 1851 1864
"""
Drawn = TypeVar("Drawn")


@dataclass(frozen=True)
class DrawnStance:
    """A stance that is known, and a plan whose takeoff is its end.

    Attributes
    ----------
    plan : Plan, whose limits are a little above what the stance needs
    request : JumpRequest, of its contacts and a little more than its friction
    """

    plan: Plan
    request: fp.JumpRequest


class Drawing:
    """A robot that stands, with what stances of it need."""

    def __init__(self, name: str) -> None:
        source, *feet = ROBOTS[name]
        self.robot = fp.Robot.from_urdf(f"example-robot-data:{source}", coupled="mirror", reference="standing")
        wanted = np.append(0.0, self.robot.resting)
        self.feet: tuple[GroundContact, ...] = tuple(contact_at(self.robot, each, wanted)[0] for each in feet)
        limits = np.vstack((np.zeros(2), self.robot.position_limits))
        found = standing_posture(self.robot, self.feet, wanted, limits)
        assert found is not None
        self.home = found
        self.model = PlanarModel(self.robot, GRAVITY)
        alone = Phase("takeoff", self.feet[:1], 1.0, (1.0, 1.0), 1)
        self.alone = StanceDynamics(self.model, alone, self.home)
        self.tried, self.point = (OnePoint(self.alone, np.linspace(0.0, 1.0, count)) for count in (FEW, NODES))
        rear, front = (foot.spots[0] for foot in self.feet)
        model, size = self.model, len(self.home)
        (fx, fz), _ = anchor_force(model, alone, [])
        com = model.com_from(rear, 1)
        moment = self.alone.moment(model.y, model.v, model.a, np.zeros(0))
        self._carried = model.function("carried", [fx, fz, moment, model.momentum(), *com])
        weights = model.weights([front], rear)
        place = casadi().vertcat(*model.com_from(rear), *model.positions(weights))
        rate = casadi().jtimes(place, model.y, model.v)
        parts = [place, casadi().vec(casadi().jacobian(place, model.y)), casadi().jtimes(rate, model.y, model.v)]
        self._task = model.function("task", [casadi().vertcat(*parts)])
        self.stands = self.task(self.home[:, None], np.zeros((size, 1)))[0][0]

    def carried(self, y: Array, v: Array, a: Array) -> Array:
        """Forces on the rear feet were they alone, the moment about them, h, and the velocity of the centre of mass.

        (6, N) of y, y', y'' (n+1, N): N, N m, kg m^2/s, m/s.
        """
        return np.concatenate([np.asarray(each).reshape(1, -1) for each in self._carried(y, v, a)])

    def task(self, y: Array, v: Array) -> tuple[Array, Array, Array]:
        """Places (N, 4) of centre of mass and front feet from the rear ones, derivatives (N, 4, n+1), and drifts."""
        size, found = len(y), np.asarray(self._task(y, v, 0 * y)).reshape(-1, y.shape[1]).T
        return found[:, :4], found[:, 4:-4].reshape(-1, size, 4).transpose(0, 2, 1), found[:, -4:]

    def legs(self, orientation: Array, com: Array) -> tuple[Array, Array, Array] | None:
        """y, y', y'' (n+1, N) with all feet where they stand.

        Parameters
        ----------
        orientation : (3, N) with its derivatives
        com : (3, 2, N) of the centre of mass from the rear feet, with its derivatives
        """
        count = orientation.shape[1]
        feet = np.zeros((3, 2, count))
        feet[0] = self.stands[2:, None]
        wanted = np.concatenate((com, feet), axis=1).transpose(0, 2, 1)
        y, v = np.repeat(self.home[:, None], count, axis=1), np.zeros((len(self.home), count))
        y[0], v[0] = orientation[:2]
        for _ in range(10):
            value, ways, _ = self.task(y, v)
            step = np.linalg.solve(ways[:, :, 1:], (wanted[0] - value)[:, :, None])[:, :, 0]
            y[1:] += np.clip(step.T, -0.5, 0.5)
            if np.abs(step).max() < 1e-10:
                break
        else:
            return None
        v[1:] = np.linalg.solve(ways[:, :, 1:], (wanted[1] - ways[:, :, 0] * v[0][:, None])[:, :, None])[:, :, 0].T
        rest = wanted[2] - ways[:, :, 0] * orientation[2][:, None] - self.task(y, v)[2]
        a = np.vstack((orientation[2], np.linalg.solve(ways[:, :, 1:], rest[:, :, None])[:, :, 0].T))
        return y, v, a


def drawn_stances(count: int) -> tuple[list[DrawnStance], int]:
    """Draw ``count`` stances, the robots in turn, of each one from all feet, one from the rear; and the last seed."""

    def draw(drawings: list[Drawing], index: int, rng: np.random.Generator) -> DrawnStance | None:
        return drawn_stance(drawings[index // 2 % len(drawings)], rng, together=index % 2 == 0)

    return _drawn(count, STANCE_SEEDS, draw)


def _drawn(
    count: int, known: str, draw: Callable[[list[Drawing], int, np.random.Generator], Drawn | None]
) -> tuple[list[Drawn], int]:
    """What holds of the draws with seeds 0, 1, ..., and the last seed; those that are known to hold are tried alone."""
    found: list[Drawn] = []
    drawings, seeds = [Drawing(name) for name in ROBOTS], list(map(int, known.split()))
    for seed in itertools.chain(seeds, itertools.count(seeds[-1] + 1)):
        drawn = draw(drawings, len(found), np.random.default_rng(seed))
        found += [] if drawn is None else [drawn]
        if len(found) >= count:
            return found, seed
    raise AssertionError


def drawn_stance(drawing: Drawing, rng: np.random.Generator, together: bool) -> DrawnStance | None:
    """Draw a stance, whose feet leave together or the front ones first; None where it does not hold."""
    alone = 0.0 if together else rng.uniform(0.03, 0.12)
    try:
        grid = _both(drawing, rng, alone)
    except np.linalg.LinAlgError:
        return None
    if grid is None:
        return None
    stances = [Stance(drawing.robot, GRAVITY, drawing.feet, 0j, grid)]
    if alone and _promises(stances[0]):
        last = _alone(drawing, rng, grid, alone)
        if last is None:
            return None
        stances.append(Stance(drawing.robot, GRAVITY, drawing.feet[:1], 0j, last))
    return _known(drawing, tuple(stances)) if _promises(stances[-1]) else None


def _in_reach(drawing: Drawing, motion: Sequence[Array] | Array, carries: slice = slice(None)) -> bool:
    """Whether joints are in range, and the force on all feet together, where they carry, in the widest cone."""
    low, high = np.asarray(drawing.robot.position_limits).T[..., None]
    horizontal, vertical = drawing.carried(*[each[:, carries] for each in motion])[:2]
    within = ((low < motion[0][1:]) & (motion[0][1:] < high)).all()
    return bool(within and (np.abs(horizontal) <= SLIPPERY[1] * vertical).all())


def _promises(stance: Stance) -> bool:
    """Whether at some instants forces are in the cone, so that it is worth to look at all of them."""
    forces = [each[:-2] for each in stance.at(stance.grid.times[:: NODES // 10]).forces.values()]
    return all((each[:, 1] > 0).all() and (np.abs(each[:, 0]) < SLIPPERY[1] * each[:, 1]).all() for each in forces)


def _both(drawing: Drawing, rng: np.random.Generator, alone: float = 0.0, straight: bool = False) -> Grid | None:
    """The phase on all feet, from rest; at its end the front feet carry nothing, or no foot does.

    The rear feet are to stand ``alone`` for so long, s, then.

    Where it is to end ``straight``, the centre of mass then rises upright and the angular momentum is zero.
    """
    height, begin = drawing.stands[1], np.append(0.0, drawing.stands[:2])
    moved = rng.uniform((-0.3, -0.25, -0.15), (0.3, 0.2, 0.3)) * (1.0, height, height)
    rates = rng.uniform((-3.0, -1.0, 0.8), (3.0, 1.0, 2.8)) * (1.0, *([np.sqrt(height / 0.3)] * 2))
    moved -= rates * alone
    changes = rng.uniform((-40.0, -6.0, -6.0), (40.0, 6.0, 20.0)) if alone else np.array([0.0, 0.0, -GRAVITY])
    times = np.linspace(0.0, rng.uniform(0.15, 0.45), NODES)

    def motion(turning: float, at: Array) -> tuple[Array, Array, Array] | None:
        pushes = np.append(turning, changes[1:])
        ends = np.stack((begin, 0 * rates, 0 * rates)), np.stack((begin + moved, rates, pushes))
        parts = quintic(at, times[[0, -1]], *ends)
        return drawing.legs(parts[:, 0], parts[:, 1:])

    def last(turning: float, row: int) -> float:
        found = motion(turning, times[-1:])
        return np.nan if found is None else float(drawing.carried(*found)[row, 0])

    if straight:
        rates[:2] = 0.0
        still = last(0.0, 3)
        rates[0] = 1.0
        rates[0] = -still / (last(0.0, 3) - still)
    rest = last(0.0, 2)
    turning = np.nan if np.isnan(rest) else -rest / (last(1.0, 2) - rest)  # at which the front feet carry nothing
    few = None if np.isnan(turning) else motion(turning, times[6:-1:6])  # most do not hold, which few instants show
    found = motion(turning, times) if few is not None and _in_reach(drawing, few) else None
    if found is None or not _in_reach(drawing, found, slice(None if alone else -1)):
        return None
    fx, fz, *_ = drawing.carried(*found)
    ratios = fx / np.where(fz > 0, fz, 1.0)
    if not alone:
        ratios[-1] = 2 * ratios[-2] - ratios[-3]
    return Grid(times, *found, ratios[None])


def drawn_hops(count: int) -> tuple[list[fp.Problem], int]:
    """Draw ``count`` problems of jumps that are known to be possible, the robots in turn; and the last seed."""

    def draw(drawings: list[Drawing], index: int, rng: np.random.Generator) -> fp.Problem | None:
        return _hop(drawings[index % len(drawings)], rng)

    return _drawn(count, HOP_SEEDS, draw)


def _hop(drawing: Drawing, rng: np.random.Generator) -> fp.Problem | None:
    """A jump straight up whose landing is its takeoff, backwards in time; so is the second half of its flight."""
    try:
        grid = _both(drawing, rng, straight=True)
    except np.linalg.LinAlgError:
        return None
    stance = None if grid is None else Stance(drawing.robot, GRAVITY, drawing.feet, 0j, grid)
    known = _known(drawing, (stance,)) if stance is not None and _promises(stance) else None
    flown = None if known is None else _flown(known.plan, drawing)
    if known is None or flown is None or stance is None:
        return None
    plan, limits, margin = known.plan, known.plan.problem, fp.JumpRequest().margin
    torque = np.maximum(limits.motor_torque_limits, HEADROOM * flown[0]) / margin["torque"]
    velocity = np.maximum(limits.velocity_limits, HEADROOM * flown[1]) / margin["velocity"]
    feet, lasts = [tuple(foot.frame for foot in drawing.feet)], stance.span[1]
    spans = [(lasts / WIDER, lasts * WIDER)]
    sides = fp.JumpTakeoff(feet, spans), fp.JumpLanding(feet, spans)
    request = fp.JumpRequest(known.request.friction, clearance=0.01, takeoff=sides[0], landing=sides[1])
    robot, flight = drawing.robot, fp.Flight(plan.duration, "free", fp.Takeoff(feet[0][0]), gravity=GRAVITY)
    home = fp.Posture(0.0, drawing.home[1:])
    bounds = fp.Limits(torque=dict(zip(robot.motors, torque, strict=True)), velocity=velocity.tolist())
    return fp.Problem(robot, home, home, flight, limits=bounds, jump=request)


def _flown(plan: Plan, drawing: Drawing) -> tuple[Array, Array] | None:
    """Largest torques (motors,) N m and rates (n,) rad/s of a flight that goes back as it came; None where it hits."""
    robot, start, duration = drawing.robot, plan.problem.initial, plan.duration
    s = np.linspace(0.0, 1.0, NODES)
    u = np.polynomial.Polynomial([0, 1, -1])
    first = np.asarray(start.velocities) * duration
    sizes = np.stack((first, np.asarray(start.accelerations) * duration**2 / 2 + first))
    powers = [np.stack([(each.deriv(k) if k else each)(s) for each in (u, u**2)]).T for k in range(3)]
    q, v, a = (each @ sizes / duration**k for k, each in enumerate(powers))
    q = q + start.positions
    low, high = np.asarray(robot.position_limits).T
    rate = plan.dynamics.base_rate(q, v, 0.0)
    torques = plan.dynamics.full_forces(q, v, a, rate) @ robot.transmission
    turned = start.orientation + np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2))) * duration / (NODES - 1)
    spots = [drawing.feet[0].spots[0]._replace(radius=drawing.feet[0].depth), *corners(robot.hulls([]))]
    com = plan.ballistics.gravity * duration**2 / 2 * s * (1 - s)
    lows = [undersides(robot, spots, np.append(turned[k], q[k])) + com[k] for k in range(NODES)]
    hits = min(each.min() for each in lows) < lows[0][0] - POINT_FEET
    return None if hits or not ((low < q) & (q < high)).all() else (np.abs(torques).max(axis=0), np.abs(v).max(axis=0))


def _alone(drawing: Drawing, rng: np.random.Generator, before: Grid, duration: float) -> Grid | None:
    """The phase on the rear feet, at whose end they carry nothing."""
    first = before.motion[:, 1:, -1]
    begin, start = before.times[-1], (float(before.y[0, -1]), float(before.v[0, -1]))
    rates = first[1] + first[2] * duration / 2 + rng.uniform(-25.0, 25.0, len(first[0])) * duration
    moved = (0.6 * first[1] + 0.4 * rates) * duration + rng.uniform(-2.0, 2.0, len(rates)) * duration**2
    weight = drawing.robot.mass * GRAVITY

    accelerations = np.zeros(len(rates))
    for point in (drawing.tried, drawing.point):  # most do not hold, which few nodes show
        point.times = begin + duration * np.linspace(0.0, 1.0, len(point.times))
        for _ in range(FOLLOWED):
            end = np.stack((first[0] + moved, rates, accelerations))
            joints = [quintic(times, point.times[[0, -1]], first, end) for times in point.sampled]
            found = point.follow(joints, start)
            if not np.isfinite(found).all() or abs(found[1, 0, -1]) > FASTEST:
                return None
            y, v, a = found[:, :, -1]
            if np.abs(drawing.carried(y, v, a)[:2]).max() < 1e-9 * weight:
                break
            accelerations = drawing.alone.released(y, v, a)[1:]
        if np.abs(drawing.carried(*found)[:2, -1]).max() > 1e-7 * weight or not _in_reach(drawing, found, slice(-1)):
            return None
    return Grid(point.times, found[0], found[1], found[2], np.zeros((0, NODES)))


def _known(drawing: Drawing, stances: tuple[Stance, ...]) -> DrawnStance | None:
    """What is known of a stance that holds: its limits, its friction, and the flight after it."""
    robot, last = drawing.robot, stances[-1].grid
    momentum, horizontal, vertical = drawing.carried(*last.motion[:, :, -1:])[3:, 0].tolist()
    y, v, a = last.motion[:, :, -1]
    if not RISING[0] < vertical < RISING[1]:
        return None
    names = [tuple(each.frame for each in stance.contacts) for stance in stances]
    request = fp.JumpRequest(friction=SLIPPERY[1], takeoff=fp.JumpTakeoff(contacts=names))
    problem = _problem(drawing, (y, v, a), (momentum, horizontal, vertical))
    plan = _plan(problem, momentum)
    motion = JumpMotion(problem, request, plan, stances)
    figures = stance_figures(motion)
    shares = {key: figures.pop(key) for key in ("torque", "torque_speed", "velocity")}
    figures.pop("held_torque")
    if sentences_on(request, figures)[0]:
        return None
    limits = fp.Limits(
        torque=dict(zip(robot.motors, HEADROOM * shares["torque"] * problem.motor_torque_limits, strict=True)),
        velocity=(HEADROOM * shares["velocity"] * problem.velocity_limits).tolist(),
    )
    friction = max(SLIPPERY[0], HEADROOM * figures["friction"])
    return DrawnStance(replace(plan, problem=replace(problem, limits=limits)), replace(request, friction=friction))


def _problem(drawing: Drawing, state: tuple[Array, Array, Array], flown: tuple[float, float, float]) -> fp.Problem:
    """A flight from a state (y, y', y''), of some time, with h and the velocity of the centre of mass."""
    robot, (y, v, a), (momentum, horizontal, vertical) = drawing.robot, state, flown
    duration = 2 * vertical / GRAVITY
    given = np.isfinite(robot.torque_limits).all()
    limits = fp.Limits(torque="urdf", velocity="urdf") if given else fp.Limits(torque=TORQUE, velocity=FASTEST)
    foot = drawing.feet[0]
    rest = positions_from_com(robot, foot.spots[:1], drawing.home)[0].imag
    now = positions_from_com(robot, foot.spots[:1], y)[0].imag
    return fp.Problem(
        robot,
        fp.Posture(float(y[0]), y[1:], v[1:], a[1:]),
        fp.Posture(0.0, drawing.home[1:]),
        fp.Flight(
            duration,
            angular_momentum=momentum,
            takeoff=fp.Takeoff(foot.frame),
            landing=fp.Landing(foot.frame, height=float(rest - now)),
            horizontal_velocity=horizontal,
            gravity=GRAVITY,
        ),
        fp.Motion(degree=7),
        limits,
    )


def _plan(problem: fp.Problem, momentum: float) -> Plan:
    """The plainest flight from the start of a problem; it need not reach the goal."""
    variables = decision_variables(
        problem, problem.degrees, np.zeros((2, len(problem.robot.joints)), int), flight_of(problem).momentum_set
    )
    polynomials = variables.polynomials
    z = np.zeros_like(polynomials.nominal_coefficients)
    answer: dict[str, Any] = {"status": "infeasible", "ok": False, "explanation": "", "solver": {}}
    return Plan.of_motion(problem, polynomials, z, np.array([momentum]), **answer)
