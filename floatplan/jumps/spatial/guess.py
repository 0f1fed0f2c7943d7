"""Where the search for a jump in space begins."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.jump import Jump
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.motion.spatial.rotations import of_quaternions, unwrapped_angles


def guess(program: SpatialProgram, rng: np.random.Generator | None = None) -> Array:
    """Return the generic guess (size,); with random numbers a perturbed one.

    Joints go from posture to posture, the centre of mass rises to 1.15 of its height, or as high as slow legs reach,
    flies, and comes down; the base turns by a smoothstep from the takeoff's last phase to the landing's first.
    """
    durations = np.array([phase.duration for phase in program.phases])
    if rng is not None:
        low, high = np.transpose([phase.bounds for phase in program.phases])
        durations = np.clip(durations * rng.uniform(0.8, 1.25, len(durations)), low, high)
    n = program.model.size
    times = program.times(durations)
    y = np.empty((n, program.nodes))
    v = np.zeros((n, program.nodes))
    along = np.linspace(0.0, 1.0, program.nodes)  # of the nodes, by their numbers
    begin, end = times[program.borders[[max(program.flight - 1, 0), min(program.flight + 2, len(program.phases))]]]
    if program.flight == 1:  # one phase before it: the base turns in its second half
        begin = times[program.borders[1]] / 2
    if program.flight == len(program.phases) - 2:
        end = (times[program.borders[-2]] + times[-1]) / 2
    progress = np.clip((times - begin) / (end - begin), 0.0, 1.0)
    smooth = progress**2 * (3 - 2 * progress)
    first, last = program.ends.y
    y[3:6] = first[3:6, None] + np.outer(last[3:6] - first[3:6], smooth)
    v[3:6] = np.outer(last[3:6] - first[3:6], 6 * progress * (1 - progress) / (end - begin))
    y[BASE:] = first[BASE:, None] + np.outer(last[BASE:] - first[BASE:], smooth)
    if rng is not None:
        bumps = np.sin(np.pi * along[None] * rng.integers(1, 4, (n - BASE, 1)))
        y[BASE:] += rng.uniform(-0.2, 0.2, (n - BASE, 1)) * bumps
    takeoff, landing = times[program.borders[[program.flight, program.flight + 1]]]
    y[:3], v[:3], lift = _guessed_centre(program, times, takeoff, landing)
    raw = np.zeros(program.size)
    for node, kind in enumerate(program.kinds):
        at = program.begins[node]
        raw[at : at + n] = y[:, node]
        raw[at + n : at + 2 * n] = v[:, node]
        forces = np.arange(at + 3 * n, program.begins[node + 1])
        if len(forces):
            raw[forces[2::3]] = max(lift[node], 0.0) / len(kind.bearing)
    raw[program.size - len(program.phases) :] = durations
    if program.arrival.feet:
        raw[program.arrival.rates] = v[:, program.borders[program.flight + 1]]
    return raw


def guess_near(program: SpatialProgram, mechanics: Mechanics, near: Jump) -> Array:
    """Return the motion of a jump of nearly the same problem as a guess (size,), its durations within their bounds.

    It is taken at the program's nodes, of which it may have had others. Where the program begins or ends elsewhere,
    turned further, displaced further or in another posture, the difference joins by a smoothstep over the flight.

    Parameters
    ----------
    mechanics : of the program's robot, feet and axes
    near : Jump

    Raises
    ------
    InputError
        It is of another robot, has other phases or contacts, has other rotations, or is none at all.
    """
    _refuse_unlike(program, near)
    of_near = np.array([phase.end - phase.begin for phase in near.phases])
    times = np.minimum(program.times(of_near), near.duration)
    state = near.at(times)
    first, last = program.ends.y
    angles = unwrapped_angles(mechanics.axes, of_quaternions(state.positions[:, 3 : BASE + 1]))
    angles += 2 * np.pi * np.round((first[3:BASE] - angles[0]) / (2 * np.pi))
    com_motion = _com_motion(mechanics, state, angles.T)
    touchdown = int(program.borders[program.flight + 1])
    arrival = com_motion[1:, :, touchdown].copy()
    if program.arrival.feet:  # there the state is that before an impact, and the program's node that after it
        landed = near.after[0].at(times[[touchdown]])
        com_motion[1:, :, [touchdown]] = _com_motion(mechanics, landed, angles[[touchdown]].T)[1:]
    com_motion[0, :2] -= com_motion[0, :2, :1]
    com_motion[0, 2] -= near.ground

    before = first - com_motion[0, :, 0]
    after = last - com_motion[0, :, -1]
    displacement = program.ends.displacement
    after[:2] = 0.0 if displacement is None else displacement - com_motion[0, :2, -1]
    turns = np.abs(after[3:BASE]).max() / (2 * np.pi)
    most = 0.25  # [-] of a whole rotation, by which a motion may be bent: more of it leads nowhere
    if turns > most:
        raise _unlike(f"a jump that turns by {360 * turns:.4g} degrees less or more than this one has to")
    begin, end = times[program.borders[[program.flight, program.flight + 1]]]
    progress = np.clip((times - begin) / (end - begin), 0.0, 1.0)
    joining = np.stack(
        (
            progress**2 * (3 - 2 * progress),
            6 * progress * (1 - progress) / (end - begin),
            np.where((times > begin) & (times < end), 6 * (1 - 2 * progress) / (end - begin) ** 2, 0.0),
        )
    )
    com_motion[0] += before[:, None]
    com_motion += (after - before)[:, None] * joining[:, None]
    durations = np.clip(of_near, *np.transpose([phase.bounds for phase in program.phases]))
    raw = program.joined(com_motion, state.forces, durations)
    if program.arrival.feet:
        raw[program.arrival.derivatives] = arrival.ravel()
    return raw


def _com_motion(mechanics: Mechanics, state: JumpState, angles: Array) -> Array:
    """The motion (3, 6+n, N) of a state, with the centre of mass, its angles next to some (3, N)."""
    motion = mechanics.from_coordinates(state.positions, state.velocities, state.accelerations, angles)
    motion[:, :3], _ = mechanics.centre(motion)
    return motion


def _refuse_unlike(program: SpatialProgram, near: Jump) -> None:
    """Refuse a jump that is not one of a program's robot, phases and contacts."""
    if near.flight is None:
        raise _unlike("no jump: its search had none")
    robot = program.model.robot
    if (near.robot.base, near.robot.joints) != (robot.base, robot.joints):
        raise _unlike(f"a jump of another robot: of this one {', '.join(robot.joints)} are planned")
    own = [" and ".join(phase.names) or "flight" for phase in program.phases]
    others = [" and ".join(phase.contacts) or "flight" for phase in near.phases]
    if own != others:
        raise _unlike(f"a jump of other phases: {', '.join(others)}, and not {', '.join(own)}")


def _unlike(reason: str) -> InputError:
    """The refusal of a jump from which no search of a program begins."""
    return InputError(f"is {reason}", element="near", advice="leave it out, or take one of nearly the same problem")


def _guessed_centre(
    program: SpatialProgram, times: Array, takeoff: float, landing: float
) -> tuple[Array, Array, Array]:
    """Centre of mass and its velocity (3, K+1), and vertical force over the weight (K+1,)."""
    gravity = program.model.gravity
    speed = gravity * (landing - takeoff) / 2
    first, last = program.ends.y[:, :3]
    displacement = np.zeros(2) if program.ends.displacement is None else program.ends.displacement - first[:2]
    horizontal = displacement / (landing - takeoff) * 0.8  # of the way in the air
    knots = [0.0, takeoff, landing, times[-1]]
    rise = program.ends.rise
    usual = 1.15  # [-] of the height where it stands
    bent = 0.98  # [-] of the greatest height, so that legs are not quite straight
    high = min(usual, bent * program.ends.tallest / max(first[2], last[2] - rise))
    climb = rise / (landing - takeoff)
    way = horizontal * (landing - takeoff)
    middle = (displacement - way) / 2
    places = np.array(
        [
            first,
            [*(first[:2] + middle), high * first[2]],
            [*(first[:2] + middle + way), rise + high * (last[2] - rise)],
            [*(first[:2] + displacement), last[2]],
        ]
    )
    rates = np.array([np.zeros(3), [*horizontal, speed + climb], [*horizontal, climb - speed], np.zeros(3)])
    curve = CubicHermiteSpline(knots, places, rates)
    in_flight = (times >= takeoff) & (times <= landing)
    y = curve(times).T
    v = curve(times, 1).T
    lift = 1 + curve(times, 2)[:, 2] / gravity
    since = times[in_flight] - takeoff
    drop = (last[2] - rise - first[2]) * high / (landing - takeoff) + climb
    y[2, in_flight] = high * first[2] + (speed + drop) * since - gravity * since**2 / 2
    v[2, in_flight] = speed + drop - gravity * since
    lift[in_flight] = 0.0
    return y, v, lift
