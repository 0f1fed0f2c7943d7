"""Whether a robot can bring itself to the takeoff of a plan in space, or to standing after its landing.

The feet that are lowest in the plan's posture are the last to stand, or the first; where they move in the flight, the
joints have the rates with which they are still. The robot stands level on all feet before, or after, its feet where the
flight has them. Stances of the least squared torques are searched for within a share of the limits, then within a
larger or a smaller one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.flight import scaled_limits
from floatplan.jumps.launches.result import LIMIT_WORDS, Launch, launch_of_stances
from floatplan.jumps.motion import quintic
from floatplan.jumps.spatial.coordinates import Mechanics, best_axes, rotations_about
from floatplan.jumps.spatial.exact import met_by_flight
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.phases import SpatialPhase, side_phases
from floatplan.jumps.spatial.setup import feet_and_posture, phase_feet
from floatplan.jumps.spatial.stance_search import StanceEnd, StanceResult, planned_stance, stance_setup
from floatplan.jumps.spatial.standing import Foot, not_standing
from floatplan.motion.planar.contact_rates import End
from floatplan.motion.spatial.rotations import unwrapped_angles
from floatplan.plans.plan import Plan
from floatplan.problem.attitude import Attitude
from floatplan.problem.jump import JumpRequest
from floatplan.tables import RELATIVE


@dataclass(frozen=True, eq=False)
class SpatialLaunch:
    """The stance to search for.

    Attributes
    ----------
    plan : Plan
    request : JumpRequest
    end : "takeoff" or "landing"
    mechanics : of the robot on all of its feet
    phases : in order of time
    places : (3,) m, of all feet's points, by name
    standing : (3, 6+n) where the robot stands still
    met : (3, 6+n) where the flight is met
    """

    plan: Plan
    request: JumpRequest
    end: End
    mechanics: Mechanics
    phases: tuple[SpatialPhase, ...]
    places: dict[str, Array]
    standing: Array
    met: Array

    def stance(self, level: float, duration: float) -> StanceResult:
        """Search within a share of the limits, from a guess whose durations are a share of the usual ones."""
        problem = self.plan.problem
        phases = []
        for phase in self.phases:
            low, high = phase.bounds
            phases.append(replace(phase, duration=float(np.clip(duration * phase.duration, low, high))))
        ends = (StanceEnd(self.standing), StanceEnd(self.met, flies=True))
        if self.end == "landing":
            ends = ends[::-1]
        setup = stance_setup(
            replace(problem, limits=scaled_limits(problem, level, level)),
            self.request,
            self.mechanics.axes,
            phases,
            ends,
            self.places,
        )
        begin = self.plan.duration if self.end == "landing" else 0.0
        span = np.array([0.0, 0.0])
        for phase in phases:
            span[1] += phase.duration
        first, last = ends
        return planned_stance(
            setup, lambda times: quintic(np.clip(times, *span), span, first.motion, last.motion), begin=begin
        )

    def judged(self, result: StanceResult) -> Launch:
        """What a stance comes to, in shares of the plan's own limits."""
        problem = replace(self.plan.problem, obstacles=(), self_clearances=())
        sides = (result.stances, ()) if self.end == "takeoff" else ((), result.stances)
        motion = SpatialJumpMotion(problem, self.request, self.plan, *sides)
        return launch_of_stances(motion, self.end)


def launch_in_space(
    plan: Plan, request: JumpRequest, end: End, seed: int, starts: int, say: Callable[[str], None]
) -> Launch:
    """Search for the stance that meets a plan in space; see :func:`floatplan.jumps.launches.launch.launch`."""
    stance = _stance(plan, request, end)
    if isinstance(stance, Launch):
        return stance
    joints = zip(plan.robot.joints, stance.standing[0, BASE:], strict=True)
    posture = ", ".join(f"{name} {angle:.4g}" for name, angle in joints)
    stands = f"Friction {request.friction:g}, at rest with {posture} rad."
    impossible, met = _within_rates(stance)
    if impossible is not None:
        return replace(impossible, sentences=(*impossible.sentences, stands))
    result = _search(replace(stance, met=met), seed, starts, say)
    return replace(result, sentences=(*result.sentences, stands))


def _search(stance: SpatialLaunch, seed: int, starts: int, say: Callable[[str], None]) -> Launch:
    """The stance with the least share of the limits."""
    levels = (1.0, 1.5, 2.5, 4.0)  # [-] of the limits: beyond their own, how much is missing
    best: Launch | None = None
    reason = ""
    duration = 1.0
    for level in levels:
        for start in range(starts):
            say(f"start {start + 1} of {starts}, within {level:g} of the limits")
            usual = (1.0, 0.7)  # [-] of the usual durations, of the first two starts
            duration = usual[start] if start < 2 else float(np.random.default_rng((seed, start)).uniform(0.4, 1.3))
            result = stance.stance(level, duration)
            if result.stances:
                best = stance.judged(result)
                break
            reason = reason or result.broken[0]
        if best is not None:
            break
    if best is None:
        sentences = (f"{stance.end.capitalize()}: no stance was found.", reason)
        return Launch(False, np.inf, "", "", sentences, {})
    for _ in range(3):  # tighter limits, as long as there is a stance within them
        say("within tighter limits")
        result = stance.stance(0.85 * best.ratio, duration)
        tighter = stance.judged(result) if result.stances else None
        if tighter is None or tighter.broken or tighter.ratio >= best.ratio:
            break
        best = tighter
    return best


def _stance(plan: Plan, request: JumpRequest, end: End) -> SpatialLaunch | Launch:
    """State the search; or the result, where the feet that stand at that end are not on one level."""
    problem = plan.problem
    robot = plan.robot
    feet, joints, height = feet_and_posture(problem, request, end)
    time = 0.0 if end == "takeoff" else plan.duration
    coordinates = plan.full_motion(np.array([time])).coordinates
    rotation = pin.Quaternion(*coordinates.positions[0, [6, 3, 4, 5]]).matrix()
    level, axes, angles = _levelled(rotation)
    mechanics = Mechanics(robot, axes, float(problem.flight.gravity), feet)
    own = mechanics.from_coordinates(
        coordinates.positions, coordinates.velocities, coordinates.accelerations, angles[-1][:, None]
    )
    even = 1e-3  # [m] by which feet that stand where the flight is met may differ in height
    names = [foot.name for foot in feet]
    points = mechanics.feet(own, names)
    grounds = points[0, 0, :, 2] - [foot.depth for foot in feet]
    side = getattr(request, end)
    if side.contacts:
        groups = phase_feet(side.contacts, feet)
    else:
        low = [foot for foot, ground in zip(feet, grounds, strict=True) if ground < grounds.min() + even]
        groups = [tuple(feet), tuple(low)] if len(low) < len(feet) else [tuple(feet)]
        groups = groups if end == "takeoff" else groups[::-1]
    last = groups[-1 if end == "takeoff" else 0]
    if len(last) < 2:
        reason = f"{last[0].frame!r} would stand on its own"
        raise InputError(reason, element=f"jump.{end}.contacts", advice="name two feet at least in each phase")
    of_last = np.array([grounds[names.index(foot.name)] for foot in last])
    if np.ptp(of_last) > even:
        highest = last[int(of_last.argmax())]
        lowest = last[int(of_last.argmin())]
        words = f"{highest.name} is {1e3 * np.ptp(of_last):.0f} mm higher than {lowest.name} then"
        sentence = f"{end.capitalize()}: no stance reaches it: {words}, and both would stand."
        return Launch(False, np.inf, "", "", (sentence,), {}, impossible=True)
    places = {}
    for foot in last:
        position = points[0, 0, names.index(foot.name)].copy()
        position[2] = of_last.mean() + foot.depth
        places[foot.name] = position
    standing, places = _standing_there(mechanics, feet, places, joints, height, level)
    standing[0, 3:BASE] = _nearest(axes, rotations_about(axes, standing[0, 3:BASE, None])[0], rotation)
    reason = not_standing(
        robot, feet, Attitude(angles=tuple(standing[0, 3:BASE].tolist()), axes=axes), standing[0, BASE:]
    )
    if reason:
        advice = "give another posture, or other contacts"
        key = f"jump.{end}.{'from' if end == 'takeoff' else 'to'}"
        raise InputError(
            f"with its feet where the flight has them it is not static: {reason}", element=key, advice=advice
        )
    state = plan.at(np.array([time]))
    momentum = np.asarray(plan.angular_momentum)
    last_places = {}
    for foot in last:
        last_places[foot.name] = places[foot.name]
    met = met_by_flight(mechanics, own[:, :, 0], last_places, state.com_velocity[0], momentum)
    centre = float(mechanics.centre(standing[:, :, None])[0][0, 2, 0]) - float(of_last.mean())
    unit = float(np.sqrt(centre / mechanics.gravity))
    phases = []
    for phase in side_phases(end, groups, unit, [None] * len(groups)):
        shortest = 0.3 * phase.duration  # since the flight is fixed, stances may have to be brief
        phases.append(replace(phase, bounds=(shortest, phase.bounds[1])))
    # The leeway is of other angles than those here, and a stance by itself is searched for with feet that are still.
    calm = replace(
        request,
        margin=dict.fromkeys(request.margin, 1.0),
        clearance=0.0,
        pitch_error=0.0,
        least_force=0.0,
        leeway=None,
        landing=replace(request.landing, impact=0.0),
    )
    return SpatialLaunch(plan, calm, end, mechanics, tuple(phases), places, standing, met)


def _levelled(rotation: Array) -> tuple[Array, str, Array]:
    """A rotation (3, 3) without its tilt, axes that serve from there to the rotation, and the angles on the way."""
    up = np.array([0.0, 0.0, 1.0])
    level = pin.Quaternion.FromTwoVectors(rotation[:, 2], up).matrix() @ rotation
    way = pin.log3(level.T @ rotation)
    path = _path(level, way)
    axes = best_axes(path)
    return level, axes, unwrapped_angles(axes, path)


def _nearest(axes: str, level: Array, rotation: Array) -> Array:
    """Angles (3,) of a rotation (3, 3) on the way from which to another the angles are next to that one's."""
    way = pin.log3(rotation.T @ level)
    return np.asarray(unwrapped_angles(axes, _path(rotation, way))[-1])


def _path(first: Array, way: Array) -> Array:
    """Rotations (25, 3, 3) from one (3, 3) along a vector of rotation (3,), rad."""
    return np.array([first @ pin.exp3(share * way) for share in np.linspace(0.0, 1.0, 25)])


def _standing_there(
    mechanics: Mechanics, feet: Sequence[Foot], places: dict[str, Array], joints: Array, height: float, level: Array
) -> tuple[Array, dict[str, Array]]:
    """Where the robot stands level with feet at places, (3, 6+n), and the places of all of its feet."""
    motion = np.zeros((3, BASE + len(joints), 1))
    motion[0, 2] = height
    motion[0, 3:BASE, 0] = unwrapped_angles(mechanics.axes, level[None])[0]
    motion[0, BASE:, 0] = joints
    names = [foot.name for foot in feet]
    points = mechanics.feet(motion, names)
    own = dict(zip(names, points[0, 0], strict=True))
    # Turned about the vertical and moved so that the feet are nearest to where they have to be.
    here = points[0, 0, [names.index(name) for name in places]]
    there = np.array(list(places.values()))
    flat = (here - here.mean(axis=0))[:, :2]
    target = (there - there.mean(axis=0))[:, :2]
    yaw = np.arctan2((flat[:, 0] * target[:, 1] - flat[:, 1] * target[:, 0]).sum(), (flat * target).sum())
    about_vertical = pin.exp3(np.array([0.0, 0.0, yaw]))
    moved = {}
    for name, position in own.items():
        moved[name] = about_vertical @ (position - here.mean(axis=0)) + there.mean(axis=0)
    motion[0, :3, 0] = about_vertical @ (motion[0, :3, 0] - here.mean(axis=0)) + there.mean(axis=0)
    motion[0, 3:BASE, 0] = unwrapped_angles(mechanics.axes, (about_vertical @ level)[None])[0]
    first = next(foot for foot in feet if foot.name in places)
    ground = places[first.name][2] - first.depth
    for foot in feet:
        moved[foot.name][2] = ground + foot.depth
    everything = moved | places
    return mechanics.close(motion, everything)[:, :, 0], everything


def _within_rates(stance: SpatialLaunch) -> tuple[Launch | None, Array]:
    """The result where no rates with which feet are still are within their limits; and what meets the flight."""
    mechanics = stance.mechanics
    limits = np.asarray(stance.plan.problem.velocity_limits)
    phase = stance.phases[-1 if stance.end == "takeoff" else 0]
    met = stance.met
    share, rates = _least_rates(mechanics, met, phase.names, limits)
    if share > 1 + RELATIVE:
        joint = stance.plan.robot.joints[int(np.abs(rates[BASE:] / limits).argmax())]
        words = LIMIT_WORDS["velocity"].format(joint)
        other = "came before" if stance.end == "takeoff" else "comes after"
        feet = " and ".join(phase.frames)
        sentence = (
            f"{stance.end.capitalize()}: no stance reaches it: with {feet} at rest then, {words} is at least "
            f"{share:.2f} of its limit, whatever {other}."
        )
        return Launch(False, share, "velocity", joint, (sentence,), {}, impossible=True), met
    if (np.abs(met[1, BASE:]) > limits).any():
        places = {name: stance.places[name] for name in phase.names}
        state = stance.plan.at(np.array([0.0 if stance.end == "takeoff" else stance.plan.duration]))
        met = met.copy()
        met[1] = rates
        met = met_by_flight(mechanics, met, places, state.com_velocity[0], np.asarray(stance.plan.angular_momentum))
    return None, met


def _least_rates(mechanics: Mechanics, met: Array, names: Sequence[str], limits: Array) -> tuple[float, Array]:
    """The least largest share of rates' limits with the velocity and momentum of a motion, feet still; the rates."""
    size = met.shape[1]
    varied = np.repeat(met[:, :, None], size + 1, axis=2)
    varied[1, :, 1:] = np.eye(size)
    centres, momenta = mechanics.centre(varied)
    feet = mechanics.feet(varied, list(names))
    effects = np.vstack((centres[1], momenta, feet[1].reshape(size + 1, -1).T))
    # Variables: rates, then the share.
    equations = np.column_stack((effects[:, 1:], np.zeros(len(effects))))
    limited = np.flatnonzero(np.isfinite(limits))
    bound = np.zeros((len(limited), size + 1))
    bound[np.arange(len(limited)), BASE + limited] = 1.0
    bound[:, -1] = -limits[limited]
    opposite = bound.copy()
    opposite[:, :-1] *= -1.0
    cost = np.zeros(size + 1)
    cost[-1] = 1.0
    result = linprog(
        cost,
        A_ub=np.vstack((bound, opposite)) if len(limited) else None,
        b_ub=np.zeros(2 * len(limited)) if len(limited) else None,
        A_eq=equations,
        b_eq=effects[:, 0],
        bounds=[(None, None)] * size + [(0.0, None)],
    )
    if result.x is None:  # as rounding may have it where three points of a sole fix a pose
        return float(np.max(np.abs(met[1, BASE:]) / limits)), met[1]
    return float(result.x[-1]), np.asarray(result.x[:-1])
