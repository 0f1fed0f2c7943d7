"""The turning of a flight's base: what follows from the joints' motion with one constant angular momentum.

Momentum is not judged by differences of poses: at 30 Hz, with a fifth of a degree of noise, that of a true flight
would spread by several kg m^2/s. The turning is integrated instead, and fitted to the attitudes:

    omega = I^-1 (R^T h - A q')                                                                                   (S1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.clips.fall import NOISE_FACTOR, frame_noise
from floatplan.motion.spatial.attitude import IntegrationError, Turning, cells, turn
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.motion.spatial.rotations import cross_matrix, exponential, logarithm

LEAST_FRAMES = 4  # [-] of a flight whose turning is fitted


@dataclass(frozen=True)
class FitSettings:
    """How joints and turning are fitted."""

    degrees: range = range(2, 10)  # [-] of the polynomials of joints
    higher_degrees: tuple[int, ...] = (12, 15, 20, 25, 30)  # [-] of long flights, where there are frames for them
    frames_per_coefficient: float = 2.0  # [-] at least, of the higher degrees
    other_degrees: tuple[int, ...] = (-2, -1, 1, 2)  # [-] off the best, tried before a turning is called a fault
    cells: int = 8  # [-] of the integration of the attitude
    stages: int = 6  # [-] of each cell
    iterations: int = 12  # [-] of Gauss and Newton, at most
    shortest_step: float = 1e-3  # [-] of Gauss and Newton: where no longer one is better, the fit ends
    converged: float = 1e-6  # [rad] a step that is smaller ends the fit: what it tells is compared with 0.5 degree


FIT = FitSettings()


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
        positions = chebyshev.chebval(x, self.coefficients).T
        velocities = rate * chebyshev.chebval(x, first).T
        accelerations = rate**2 * chebyshev.chebval(x, second).T
        return np.asarray(positions, float), np.asarray(velocities, float), np.asarray(accelerations, float)


@dataclass(frozen=True, eq=False)
class RotationFit:
    """The turning with one angular momentum that is nearest to a clip's attitudes.

    Attributes
    ----------
    angular_momentum : (3,) kg m^2/s, in the world
    rms : rad, root mean square of what is left of the attitudes
    noise : rad, the same of their own noise
    residuals : (K, 3) rad, in the world, at the frames
    motion : Turning
        The attitude as a function of time.
    """

    angular_momentum: Array
    rms: float
    noise: float
    residuals: Array
    motion: Turning

    @property
    def tolerance(self) -> float:
        """Root mean square, rad, that residuals of a flight may have."""
        counted_noise = min(self.noise, float(np.deg2rad(0.5)))  # [rad] more noise is a fault, and excuses nothing
        return max(float(np.deg2rad(0.5)), NOISE_FACTOR * counted_noise)  # [rad] root mean square, whatever the noise


def fit_joints(times: Array, positions: Array, degree: int | None = None) -> JointFit:
    """Fit polynomials of a degree to all joints (K, J); generalised cross-validation chooses it where it is None.

    Of noise the degree must leave what no motion of a robot has; BIC and AICc choose far lower degrees.
    """
    count = len(times)
    begin = float(times[0])
    duration = float(times[-1] - times[0])
    x = 2.0 * (times - begin) / duration - 1.0
    best_score = np.inf
    best = np.zeros((1, positions.shape[1]))
    for tried in possible_degrees(count) if degree is None else (degree,):
        terms = np.polynomial.chebyshev.chebvander(x, tried)
        coefficients, *_ = np.linalg.lstsq(terms, positions, rcond=None)
        squares = float(((positions - terms @ coefficients) ** 2).sum())
        score = squares / (count - tried - 1) ** 2
        if score < best_score:
            best_score = score
            best = np.asarray(coefficients, np.float64)
    return JointFit(begin=begin, duration=duration, coefficients=best)


def possible_degrees(frames: int) -> tuple[int, ...]:
    """Degrees of polynomials that so many frames can tell."""
    low = tuple(degree for degree in FIT.degrees if degree <= frames - 2)
    high = tuple(degree for degree in FIT.higher_degrees if frames >= FIT.frames_per_coefficient * (degree + 1))
    return low + high


def nearest_turning(
    dynamics: SpatialDynamics, times: Array, positions: Array, attitudes: Array
) -> tuple[JointFit, RotationFit | None]:
    """Fit joints and turning; where residuals are a fault, with other degrees too: frames may not tell the best."""
    joints = fit_joints(times, positions)
    rotation = fit_turning(dynamics, joints, times, attitudes)
    possible = possible_degrees(len(times))
    chosen = possible.index(joints.degree)
    for step in FIT.other_degrees:
        if rotation is not None and rotation.rms <= rotation.tolerance:
            break
        if not 0 <= chosen + step < len(possible):
            continue
        other = fit_joints(times, positions, possible[chosen + step])
        other_rotation = fit_turning(dynamics, other, times, attitudes)
        if other_rotation is not None and (rotation is None or other_rotation.rms < rotation.rms):
            joints = other
            rotation = other_rotation
    return joints, rotation


def fit_turning(dynamics: SpatialDynamics, joints: JointFit, times: Array, attitudes: Array) -> RotationFit | None:
    """Fit takeoff attitude and angular momentum, by Gauss and Newton, to attitudes (K, 3, 3) at times (K,), s.

    None where no such motion can be integrated.
    """
    model = _TurningModel(dynamics, joints, times, attitudes)
    start = attitudes[0]
    momentum = model.mean_momentum()
    try:
        turning, residuals = model.turning(start, momentum)
        for _ in range(FIT.iterations):
            change = model.step(turning, residuals)
            length = 1.0
            least = float((residuals**2).sum())
            while length > FIT.shortest_step:
                next_start = exponential(length * change[None, :3])[0] @ start
                next_momentum = momentum + length * change[3:]
                next_turning, next_residuals = model.turning(next_start, next_momentum)
                if float((next_residuals**2).sum()) <= least:
                    break
                length *= 0.5
            else:
                break
            start = next_start
            momentum = next_momentum
            turning = next_turning
            residuals = next_residuals
            if float(np.linalg.norm(length * change[:3])) < FIT.converged:
                break
    except IntegrationError:
        return None
    freedom = max(3 * len(times) - 6, 1)
    return RotationFit(
        angular_momentum=momentum,
        rms=float(np.sqrt(3.0 * (residuals**2).sum() / freedom)),
        noise=frame_noise(residuals),
        residuals=residuals,
        motion=turning,
    )


class _TurningModel:
    """The turning of a flight for one motion of the joints, by its takeoff attitude and angular momentum (S1).

    Parameters
    ----------
    dynamics : SpatialDynamics
    joints : JointFit
    times : (K,) s, of the frames
    attitudes : (K, 3, 3), in the frames
    """

    def __init__(self, dynamics: SpatialDynamics, joints: JointFit, times: Array, attitudes: Array) -> None:
        self.grid = cells(FIT.cells, FIT.stages)
        self.instants = joints.begin + self.grid.s * joints.duration
        positions, velocities, _ = joints.at(self.instants)
        self.inertia, joint_map = dynamics.momentum_maps(positions)
        self.relative = np.einsum("kaj,kj->ka", joint_map, velocities)  # A q', kg m^2/s
        self.duration = joints.duration
        self.times = times
        self.s = np.clip((times - joints.begin) / joints.duration, 0.0, 1.0)
        self.attitudes = attitudes

    def turning(self, start: Array, momentum: Array) -> tuple[Turning, Array]:
        """The turning, and by what rotations (K, 3), rad, the frames' attitudes are off it."""
        turning = turn(self.grid, self.duration, self.inertia, self.relative, momentum, start)
        return turning, logarithm(self.attitudes @ np.swapaxes(turning.at(self.s), 1, 2))

    def step(self, turning: Turning, residuals: Array) -> Array:
        """The change (6,) of takeoff attitude, rad, and momentum by which the residuals should vanish.

        A rotation zeta of the world at takeoff makes it ``(1 + D [h]x) zeta`` later, where D is the derivative by h.
        """
        by_momentum = turning.turns_by_momentum(self.s)
        by_attitude = np.eye(3) + by_momentum @ cross_matrix(turning.angular_momentum[None])[0]
        slopes = np.concatenate((by_attitude, by_momentum), axis=2).reshape(-1, 6)
        change, *_ = np.linalg.lstsq(slopes, residuals.ravel(), rcond=None)
        return np.asarray(change)

    def mean_momentum(self) -> Array:
        """The mean angular momentum (3,) of the frames as they are: where the fit begins."""
        step = np.diff(self.times)
        turned = logarithm(np.swapaxes(self.attitudes[:-1], 1, 2) @ self.attitudes[1:])  # in the base's axes
        rates = turned / step[:, None]
        middle = 0.5 * (self.times[:-1] + self.times[1:])
        nearest = np.abs(self.instants[None] - middle[:, None]).argmin(axis=1)
        own = np.einsum("kab,kb->ka", self.inertia[nearest], rates) + self.relative[nearest]
        return np.asarray(np.einsum("kab,kb->ka", self.attitudes[:-1], own).mean(axis=0))
