"""Whether a flight of a clip can fly: the fall of its centre of mass, and the turning of its base.

Neither is judged by differences of poses: at 30 Hz, with a fifth of a degree of noise, the angular momentum of a true
flight so found spreads by several kg m^2/s. A parabola is fitted to the centre of mass instead, and to the attitudes
the turning that follows from the joints' motion with one constant angular momentum:

    omega = I^-1 (R^T h - A q')                                                                                   (S1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.curve import body_poses, centre_of_mass
from floatplan.clips.flights import FOOT_CLEARANCE, STILL, ClipFlight
from floatplan.motion.spatial.attitude import IntegrationError, Turning, cells, turn
from floatplan.motion.spatial.dynamics import BASE, SpatialDynamics
from floatplan.motion.spatial.rotations import exponential, logarithm, of_quaternions
from floatplan.robot.robot import Robot

GRAVITY = 9.81  # [m/s^2]
PHYSICAL, UNPHYSICAL, UNDECIDED, AFLOAT = "physical", "unphysical", "undecided", "afloat"

CONFIDENCE = 0.9995  # [-] of Student's t, one-sided: one false alarm in a thousand flights whose noise is as assumed
LEAST_NOISE = 5e-5  # [m] of the centre of mass in a frame: digits of files, and splines between frames
FALL_TOLERANCE = 0.5  # [m/s^2] by which the fall may be off, whatever the noise
WIDEST_INTERVAL = 1.5  # [m/s^2] of the fall: with a wider one nothing is decided
PATH_TOLERANCE = 3e-3  # [m] root mean square, by which the centre of mass may be off any parabola
NO_FALL = 1.5  # [m/s^2] a smaller acceleration of the centre of mass is no fall: something carries the robot

TURN_TOLERANCE = np.deg2rad(0.5)  # [rad] root mean square, by which attitudes may be off a flight's
NOISE_FACTOR = 2.5  # [-] of the frames' own noise, by which places and attitudes may be off
COUNTED_NOISE = np.deg2rad(0.5)  # [rad] of noise that counts so at most
ROUGHEST = np.deg2rad(1.0)  # [rad] of noise: more is a fault of its own

BESIDE = 0.3  # [s] before and after a flight, in which its feet are looked at
HIGHEST_STANCE = 0.05  # [m] over the ground: a foot that is still and higher is held up

LEAST_FRAMES = 4  # [-] of a flight whose turning is fitted
DEGREES = range(2, 10)  # [-] of the polynomials of joints
HIGHER_DEGREES = (12, 15, 20, 25, 30)  # [-] of long flights, where there are frames for them
FRAMES_PER_COEFFICIENT = 2.0  # [-] at least, of the higher degrees
OTHER_DEGREES = (-2, -1, 1, 2)  # [-] beside the best, tried before a turning is called a fault
CELLS = 12  # [-] of the integration of the attitude
STAGES = 6  # [-] of each
GAUSS_NEWTON_STEPS = 12  # [-] at most
SMALL_TURN = 1e-6  # [rad, or kg m^2/s of the largest] of differences
SETTLED = 1e-9  # [rad] a step that is smaller ends the fit


@dataclass(frozen=True, eq=False)
class Fall:
    """The parabola nearest to the centre of mass.

    Attributes
    ----------
    fall : m/s^2, downwards
    interval : m/s^2, half of the confidence interval; infinite where there are too few frames
    sideways : m/s^2, the acceleration across
    rms : m, root mean square of what is left, of one coordinate
    noise : m, the same of the part that changes from frame to frame
    coefficients : (3, 3)
        Place, velocity and half the acceleration (by row), at the middle of the flight.
    times : (K,) s, of the frames
    places : (K, 3) m, of the centre of mass in the frames, in the world
    """

    fall: float
    interval: float
    sideways: float
    rms: float
    noise: float
    coefficients: Array
    times: Array
    places: Array

    def at(self, times: Array) -> Array:
        """Places (K, 3) of the parabola at times (K,), s."""
        middle = 0.5 * (self.times[0] + self.times[-1])
        return np.vander(times - middle, 3, increasing=True) @ self.coefficients

    @property
    def tolerance(self) -> float:
        """By how much it may be off, m/s^2."""
        return max(FALL_TOLERANCE, self.interval)

    @property
    def on_parabola(self) -> bool:
        """Whether the centre of mass is as near to it as its noise allows."""
        return not self.rms > max(PATH_TOLERANCE, NOISE_FACTOR * self.noise)


@dataclass(frozen=True, eq=False)
class JointFit:
    """Polynomials of the joints over a flight.

    Attributes
    ----------
    begin, duration : s
    coefficients : (degree + 1, J) rad, of Chebyshev polynomials on [-1, 1]
    """

    begin: float
    duration: float
    coefficients: Array

    @property
    def degree(self) -> int:
        """Of the polynomials."""
        return len(self.coefficients) - 1

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (K, J) at times (K,), s."""
        x = 2.0 * (times - self.begin) / self.duration - 1.0
        rate = 2.0 / self.duration
        chebyshev = np.polynomial.chebyshev
        first = chebyshev.chebder(self.coefficients)
        second = chebyshev.chebder(self.coefficients, 2)
        return (
            chebyshev.chebval(x, self.coefficients).T,
            rate * chebyshev.chebval(x, first).T,
            rate**2 * chebyshev.chebval(x, second).T,
        )


@dataclass(frozen=True, eq=False)
class TurnFit:
    """The turning with one angular momentum that is nearest to a clip's attitudes.

    Attributes
    ----------
    angular_momentum : (3,) kg m^2/s, in the world
    rms : rad, root mean square of what is left of the attitudes
    noise : rad, the same of their own noise
    residuals : (K, 3) rad, in the world, at the frames
    turning : Turning
    """

    angular_momentum: Array
    rms: float
    noise: float
    residuals: Array
    turning: Turning

    @property
    def tolerance(self) -> float:
        """By how much they may be off, rad."""
        return max(TURN_TOLERANCE, NOISE_FACTOR * min(self.noise, COUNTED_NOISE))


def free_dynamics(robot: Robot) -> SpatialDynamics:
    """Momentum and torques by all joints that move, in the order of the model."""
    count = len(robot.model_joints)
    return SpatialDynamics(robot.model, np.zeros(count), np.eye(count))


def fit_fall(times: Array, places: Array) -> Fall:
    """Fit a parabola to places (K, 3), m, of the centre of mass at times (K,), s.

    With three frames there is no interval, as nothing tells acceleration from noise; with fewer there is no parabola.
    """
    count = len(times)
    if count < 3:
        nothing = np.full((3, 3), np.nan)
        return Fall(np.nan, np.inf, np.nan, rms=np.nan, noise=0.0, coefficients=nothing, times=times, places=places)
    middle = 0.5 * (times[0] + times[-1])
    terms = np.vander(times - middle, 3, increasing=True)
    coefficients, *_ = np.linalg.lstsq(terms, places, rcond=None)
    left = places - terms @ coefficients
    acceleration = 2.0 * coefficients[2]
    freedom = count - 3
    rms = float(np.sqrt((left**2).sum() / (3 * freedom))) if freedom > 0 else np.nan
    interval = np.inf
    if freedom > 0:
        covariance = np.linalg.inv(terms.T @ terms)
        deviation = 2.0 * np.sqrt(covariance[2, 2]) * max(rms, LEAST_NOISE)
        interval = float(student.ppf(CONFIDENCE, 3 * freedom) * deviation)
    return Fall(
        fall=float(-acceleration[2]),
        interval=interval,
        sideways=float(np.hypot(acceleration[0], acceleration[1])),
        rms=rms,
        noise=frame_noise(left) / np.sqrt(3.0),
        coefficients=coefficients,
        times=times,
        places=places,
    )


def fit_joints(times: Array, positions: Array, degree: int | None = None) -> JointFit:
    """Fit polynomials of one degree to all joints (K, J), chosen by generalised cross-validation where none is given.

    Of noise the degree must leave what no motion of a robot has; BIC and AICc choose far lower degrees.
    """
    count = len(times)
    begin = float(times[0])
    duration = float(times[-1] - times[0])
    x = 2.0 * (times - begin) / duration - 1.0
    best = (np.inf, np.zeros((1, positions.shape[1])))
    for tried in possible_degrees(count) if degree is None else (degree,):
        terms = np.polynomial.chebyshev.chebvander(x, tried)
        coefficients, *_ = np.linalg.lstsq(terms, positions, rcond=None)
        squares = float(((positions - terms @ coefficients) ** 2).sum())
        score = squares / (count - tried - 1) ** 2
        if score < best[0]:
            best = (score, coefficients)
    return JointFit(begin=begin, duration=duration, coefficients=best[1])


def possible_degrees(frames: int) -> tuple[int, ...]:
    """Degrees of polynomials that so many frames can tell."""
    low = tuple(degree for degree in DEGREES if degree <= frames - 2)
    high = tuple(degree for degree in HIGHER_DEGREES if frames >= FRAMES_PER_COEFFICIENT * (degree + 1))
    return low + high


def nearest_turning(
    dynamics: SpatialDynamics, times: Array, positions: Array, attitudes: Array
) -> tuple[JointFit, TurnFit | None]:
    """Fit joints and turning; where that is a fault, with other degrees too: the frames may not tell which is right."""
    joints = fit_joints(times, positions)
    turning = fit_turning(dynamics, joints, times, attitudes)
    possible = possible_degrees(len(times))
    chosen = possible.index(joints.degree)
    for step in OTHER_DEGREES:
        if turning is not None and turning.rms <= turning.tolerance:
            break
        if not 0 <= chosen + step < len(possible):
            continue
        other = fit_joints(times, positions, possible[chosen + step])
        found = fit_turning(dynamics, other, times, attitudes)
        if found is not None and (turning is None or found.rms < turning.rms):
            joints, turning = other, found
    return joints, turning


def fit_turning(dynamics: SpatialDynamics, joints: JointFit, times: Array, attitudes: Array) -> TurnFit | None:
    """Fit takeoff attitude and angular momentum, by Gauss and Newton, to attitudes (K, 3, 3) at times (K,), s.

    None where no such motion can be integrated.
    """
    grid = cells(CELLS, STAGES)
    positions, velocities, _ = joints.at(joints.begin + grid.s * joints.duration)
    inertia, joint_map = dynamics.momentum_maps(positions)
    relative = np.einsum("kaj,kj->ka", joint_map, velocities)
    s = np.clip((times - joints.begin) / joints.duration, 0.0, 1.0)

    def fly(start: Array, momentum: Array) -> tuple[Turning, Array]:
        turning = turn(grid, joints.duration, inertia, relative, momentum, start)
        return turning, logarithm(attitudes @ np.swapaxes(turning.at(s), 1, 2))

    start = attitudes[0]
    momentum = _mean_momentum(inertia, relative, times, attitudes, grid.s * joints.duration + joints.begin)
    scale = max(float(np.linalg.norm(momentum)), float(np.abs(inertia).max()))
    try:
        turning, residuals = fly(start, momentum)
        for _ in range(GAUSS_NEWTON_STEPS):
            columns = []
            for axis in range(6):
                step = np.zeros(6)
                step[axis] = SMALL_TURN * (1.0 if axis < 3 else scale)
                _, moved = fly(exponential(step[None, :3])[0] @ start, momentum + step[3:])
                columns.append((moved - residuals).ravel() / step[axis])
            change, *_ = np.linalg.lstsq(np.stack(columns, axis=1), -residuals.ravel(), rcond=None)
            length = 1.0
            before = float((residuals**2).sum())
            while length > 1e-3:
                next_start = exponential(length * change[None, :3])[0] @ start
                next_momentum = momentum + length * change[3:]
                next_turning, next_residuals = fly(next_start, next_momentum)
                if float((next_residuals**2).sum()) <= before:
                    start, momentum, turning, residuals = next_start, next_momentum, next_turning, next_residuals
                    break
                length *= 0.5
            if length <= 1e-3 or float(np.linalg.norm(length * change[:3])) < SETTLED:
                break
    except IntegrationError:
        return None
    freedom = max(3 * len(times) - 6, 1)
    rms = float(np.sqrt((residuals**2).sum() / freedom * 3))
    return TurnFit(
        angular_momentum=momentum,
        rms=rms,
        noise=frame_noise(residuals),
        residuals=residuals,
        turning=turning,
    )


def _mean_momentum(inertia: Array, relative: Array, times: Array, attitudes: Array, instants: Array) -> Array:
    """The mean angular momentum (3,) of the attitudes as they are: where the fit begins."""
    step = np.diff(times)
    turned = logarithm(np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])  # in the base's axes
    rates = turned / step[:, None]
    middle = 0.5 * (times[:-1] + times[1:])
    nearest = np.abs(instants[None] - middle[:, None]).argmin(axis=1)
    own = np.einsum("kab,kb->ka", inertia[nearest], rates) + relative[nearest]
    return np.asarray(np.einsum("kab,kb->ka", attitudes[:-1], own).mean(axis=0))


def frame_noise(residuals: Array) -> float:
    """Root mean square of the part of residuals (K, 3) that changes from frame to frame, in their unit.

    Second differences of what is smooth are small; of independent noise they have six times its variance.
    """
    if len(residuals) < 4:
        return 0.0
    seconds = np.diff(residuals, 2, axis=0)
    return float(np.sqrt((seconds**2).sum(axis=1).mean() / 6.0))


@dataclass(frozen=True, eq=False)
class FlightJudgement:
    """What is said of one flight of a clip.

    Attributes
    ----------
    flight : ClipFlight
    verdict : "physical", "unphysical", "undecided" or "afloat"
    faults : what is wrong, a sentence each
    fall : Fall
    joints : JointFit, optional
    turn : TurnFit, optional
        None, as the joints' fit, of a flight of too few frames.
    rate_share, torque_share : the largest share of a limit, and whose; None where the robot has no such limits
    wrench : (2,) N and N m
        Root mean squares of force and moment that a simulator must add at the base for the motion to be followed.
    floating, sinking, sliding : m, of feet that stand within 0.3 s of the flight
    """

    flight: ClipFlight
    verdict: str
    faults: tuple[str, ...]
    fall: Fall
    joints: JointFit | None
    turn: TurnFit | None
    rate_share: tuple[float, str] | None
    torque_share: tuple[float, str] | None
    wrench: tuple[float, float]
    floating: float
    sinking: float
    sliding: float


def judge_flight(clip: Clip, flight: ClipFlight, gravity: float = GRAVITY) -> FlightJudgement:
    """Judge one flight of a clip by its frames that are within it."""
    frames = slice(flight.first, flight.last + 1)
    times = np.asarray(clip.times[frames])
    attitudes = of_quaternions(clip.base_quaternion[frames])
    poses = body_poses(clip.robot.model, clip.base_position[frames], attitudes, clip.positions[frames])
    places = centre_of_mass(clip.robot.model, poses)
    fall = fit_fall(times, places)
    dynamics = free_dynamics(clip.robot)
    joints = turning = rate_share = torque_share = None
    if len(times) >= LEAST_FRAMES:
        joints, turning = nearest_turning(dynamics, times, np.asarray(clip.positions[frames]), attitudes)
    if joints is not None and turning is not None:
        rate_share, torque_share = _shares(clip.robot, dynamics, joints, turning)
    faults = _faults(fall, turning, joints, gravity)
    floating, sinking, sliding = _feet_beside(clip, flight)
    return FlightJudgement(
        flight=flight,
        verdict=_verdict(fall, faults),
        faults=faults,
        fall=fall,
        joints=joints,
        turn=turning,
        rate_share=rate_share,
        torque_share=torque_share,
        wrench=_wrench(clip.robot, fall, joints, turning, dynamics, times, gravity),
        floating=floating,
        sinking=sinking,
        sliding=sliding,
    )


def _faults(fall: Fall, turning: TurnFit | None, joints: JointFit | None, gravity: float) -> tuple[str, ...]:
    """What keeps a flight from flying, a sentence each."""
    faults: list[str] = []
    if fall.interval <= WIDEST_INTERVAL:
        if abs(fall.fall - gravity) > fall.tolerance:
            faults.append(f"the centre of mass falls at {fall.fall:.2f} m/s^2, not {gravity:g}")
        if fall.sideways > fall.tolerance:
            faults.append(f"the centre of mass accelerates sideways at {fall.sideways:.2f} m/s^2")
    if not fall.on_parabola:
        faults.append(f"the centre of mass is {1e3 * fall.rms:.0f} mm rms from any parabola")
    if joints is None:
        return tuple(faults)
    if turning is None:
        faults.append("no flight with these joints and a constant angular momentum could be integrated")
        return tuple(faults)
    if turning.noise > ROUGHEST:
        faults.append(f"rough: attitudes jump by {np.rad2deg(turning.noise):.1f} degrees from frame to frame")
    if turning.rms > turning.tolerance:
        off = np.rad2deg(turning.rms)
        faults.append(f"attitudes are {off:.1f} degrees rms from any flight with a constant angular momentum")
    return tuple(faults)


def _verdict(fall: Fall, faults: tuple[str, ...]) -> str:
    slow = float(np.hypot(fall.fall, fall.sideways)) < NO_FALL
    if fall.interval <= WIDEST_INTERVAL and slow and fall.on_parabola:
        return AFLOAT
    if faults:
        return UNPHYSICAL
    return PHYSICAL if fall.interval <= WIDEST_INTERVAL else UNDECIDED


def _shares(
    robot: Robot, dynamics: SpatialDynamics, joints: JointFit, turning: TurnFit
) -> tuple[tuple[float, str] | None, tuple[float, str] | None]:
    """The largest share of a rate's and of a torque's limit, in free flight, each with its motor."""
    s = np.linspace(0.0, 1.0, 65)
    positions, velocities, accelerations = joints.at(joints.begin + s * joints.duration)
    inertia, joint_map = dynamics.momentum_maps(positions)
    attitudes = turning.turning.at(s)
    relative = np.einsum("kaj,kj->ka", joint_map, velocities)
    rates = np.linalg.solve(inertia, (turning.angular_momentum @ attitudes - relative)[..., None])[..., 0]
    torques = dynamics.torques(positions, velocities, accelerations, rates)
    of_motors = np.abs(torques @ robot.transmission[BASE:])
    motor_rates = np.abs(velocities[:, [robot.model_joints.index(name) for name in robot.motors]])
    return (
        _largest_share(motor_rates, robot.motor_velocity_limits, robot.motors),
        _largest_share(of_motors, robot.motor_torque_limits, robot.motors),
    )


def _largest_share(values: Array, limits: Array, names: tuple[str, ...]) -> tuple[float, str] | None:
    limited = np.flatnonzero(np.isfinite(limits))
    if not len(limited):
        return None
    shares = values[:, limited].max(axis=0) / limits[limited]
    largest = int(shares.argmax())
    return float(shares[largest]), names[limited[largest]]


def _wrench(
    robot: Robot,
    fall: Fall,
    joints: JointFit | None,
    turning: TurnFit | None,
    dynamics: SpatialDynamics,
    times: Array,
    gravity: float,
) -> tuple[float, float]:
    """Force, N, and moment, N m, that a simulator must add: ``m |c'' - g|``, and the mean square of dh/dt."""
    acceleration = 2.0 * fall.coefficients[2] + np.array([0.0, 0.0, gravity])
    force = robot.mass * float(np.linalg.norm(acceleration))
    if joints is None or turning is None:
        return force, float("nan")
    # what the attitudes are off, as a smooth motion of degree 4: its angular acceleration is not the flight's
    middle = 0.5 * (times[0] + times[-1])
    degree = min(4, len(times) - 1)
    terms = np.vander(times - middle, degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(terms, turning.residuals, rcond=None)
    orders = np.arange(degree + 1)
    powers = np.where(orders >= 2, orders - 2, 0)
    factors = np.where(orders >= 2, orders * (orders - 1), 0)
    angular = ((times - middle)[:, None] ** powers * factors) @ coefficients
    inertia, _ = dynamics.momentum_maps(joints.at(times)[0])
    attitudes = turning.turning.at(np.clip((times - joints.begin) / joints.duration, 0.0, 1.0))
    in_world = attitudes @ inertia @ np.swapaxes(attitudes, 1, 2)
    moments = np.einsum("kab,kb->ka", in_world, angular)
    return force, float(np.sqrt((moments**2).sum(axis=1).mean()))


def _feet_beside(clip: Clip, flight: ClipFlight) -> tuple[float, float, float]:
    """How far feet that stand beside a flight float over the ground, sink into it, and slide along it, m.

    A foot that stands is still; one that leaves or arrives is not, and does not float.
    """
    scene = clip.scene
    step = float(scene.times[1] - scene.times[0])
    floating = sinking = sliding = 0.0
    for begin, end in ((flight.begin - BESIDE, flight.begin), (flight.end, flight.end + BESIDE)):
        beside = np.flatnonzero((scene.times >= begin) & (scene.times <= end))
        if not len(beside):
            continue
        heights = scene.foot_heights[beside] - scene.ground.heights[beside, None]
        velocities = scene.foot_velocities[beside]
        stands = (np.linalg.norm(velocities, axis=2) < STILL) & (heights < HIGHEST_STANCE)
        along_ground = np.linalg.norm(velocities[..., :2], axis=2)
        slid = np.where(heights < FOOT_CLEARANCE, along_ground, 0.0).sum(axis=0) * step
        floating = max(floating, float(heights[stands].max(initial=0.0)))
        sinking = max(sinking, float(-heights.min()))
        sliding = max(sliding, float(slid.max()))
    return floating, sinking, sliding
