"""Corrections while the robot is in the air: :class:`Replanner`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from operator import sub
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arguments import Outlined, optional, outline, positive
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.inflight.estimate import Estimate, Identification
from floatplan.inflight.measurement import PLAUSIBLE, Measurement, Plausibility, Recovery, read
from floatplan.inflight.orientation import Orientations
from floatplan.inflight.prediction import Views
from floatplan.inflight.remaining_motion import RemainingMotion, Rewriting
from floatplan.inflight.update import Prediction, Update
from floatplan.inflight.warm_starts import WarmStarts
from floatplan.kernel.tolerances import CORRECTION_OPTIONS
from floatplan.motion.quadrature import gauss_legendre
from floatplan.plans.plan import Plan, as_plan
from floatplan.pool import one_thread

REACHED = 0.01  # [rad] of the goal: a landing within half a degree

Status: TypeAlias = Literal["applied", "limited", "refused", "invalid"]
LARGEST = 1e12  # [SI] sigma and acceleration
FAR_OFF = "too far from what is expected"


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Outlined):
    """The result of a measurement.

    Attributes
    ----------
    status : "applied", "limited", "refused" or "invalid"
        The motion was corrected, satisfies all limits and lands within ``REACHED`` of the goal; it was corrected by a
        share, or lands further off, or exceeds a limit that the last one exceeds too; no share of a correction
        satisfies the limits and the last motion stays; the measurement cannot be one, or is late, and changes nothing.
    reason : why it is not "applied"
    landing : s
        When the robot lands.
    angular_momentum : kg m^2/s, in space (3,) in the world's axes
        As it is estimated.
    motion : RemainingMotion
        The joints' from now on.
    predicted_miss : rad, in space (3,)
        Orientation at landing less the goal, under that motion; in space the vector of the rotation from the goal to
        that attitude, in the goal's axes.
    torque_peak : (m,) N m
        Largest magnitude of each motor's torque for the rest of the flight, in the order of ``robot.motors``.
    """

    status: Status
    reason: str
    landing: float
    angular_momentum: Any
    motion: RemainingMotion
    predicted_miss: Any
    torque_peak: Array
    shown: ClassVar[Sequence[str]] = ("status", "reason", "predicted_miss", "landing", "angular_momentum")


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Outlined):
    """What the joints are to do at a time.

    Attributes
    ----------
    positions, velocities, accelerations : (n,) rad, rad/s, rad/s^2
    feedforward : (n,) N m
        Generalised torques: a leader's moves its followers too.
    motors : (m,) N m
        Each motor's own torque, in the order of ``robot.motors``.
    """

    positions: Array
    velocities: Array
    accelerations: Array
    feedforward: Array
    motors: Array


class Replanner:
    """Corrects a plan's motion in flight, so that the robot lands as planned with what it really took off with.

    The joints' motion stays continuous to the accelerations and inside the joint ranges whatever is measured.
    The flight is one in a plane or in space. One object per flight and thread; copies, also pickled ones, go on from
    where it is, each by itself.

    Parameters
    ----------
    plan : Plan, or path of a plan file
    rate : float
        Corrections per second at most, Hz; calls between them measure only.
    sigma : float
        Miss of the orientation, rad, that is worth a correction by ``acceleration``.
    acceleration : float, optional
        rad/s^2; left out, the root mean square of the plan's joint accelerations.

    Raises
    ------
    InputError
        The plan reaches no goal, or a number is wrong.
    """

    @one_thread
    def __init__(
        self, plan: Plan | str | Path, rate: float = 200.0, sigma: float = 0.001, acceleration: float | None = None
    ) -> None:
        plan = as_plan(plan)
        rate = positive(1e5, "Hz")(rate, "rate")
        sigma = positive(LARGEST)(sigma, "sigma")
        acceleration = optional(positive(LARGEST))(acceleration, "acceleration")
        if not plan.ok:
            raise InputError("the plan does not reach its goal", element="plan", advice="plan again")
        self.plan = plan
        self.rate = float(rate)
        rewriting = Rewriting(plan)
        self.views = Views(plan, rewriting.form)
        scale = _rms_acceleration(plan) if acceleration is None else float(acceleration)
        fastest = float(np.abs(rewriting.first.at(plan.duration)[1]).max())
        # Peak acceleration of a quintic that moves by 1 in a time of 1, with rates of 0 at both ends.
        quintic = 10 / math.sqrt(3)
        self._pace = scale / (quintic * fastest) if fastest else math.inf
        self._update = Update(self.views, rewriting, float(sigma), scale)
        self._orientations: Orientations = self.views.flying.orientations
        self._plausible = Plausibility(plan)
        self._landing_height = float(plan.ballistics.positions(np.array([plan.duration]))[0, -1])
        self.reset()
        self._update.aim_as_planned()
        self._warm_starts = WarmStarts(self.motion, self._corrected_at_takeoff, self._along(plan.angular_momentum))
        positions, velocities, _ = self.motion.at(0.0)
        turning = self.views.flying.base_rate(positions, velocities)
        orientation = plan.at(0.0).orientation
        # A first update, so that caches are filled before takeoff.
        self.update(0.0, orientation, turning, positions[0], velocities[0])
        self.reset()

    def __copy__(self) -> Replanner:
        """Return another that flies on by itself: measurements of one do not change the other."""
        return deepcopy(self)

    def __repr__(self) -> str:
        """The plan that it corrects, how often, and when the robot lands as it is estimated."""
        rows = [("plan", repr(self.plan.problem).partition("\n")[0]), ("landing", f"{self.landing:.4g} s")]
        return outline(f"Replanner({self.rate:g} Hz)", rows)

    @one_thread
    def reset(self) -> None:
        """Forget all measurements and corrections: for another flight of the same plan."""
        plan = self.plan
        path = plan.ballistics
        momentum = plan.angular_momentum
        inertial = self.identification(momentum)
        self._recovery = Recovery(self._orientations)
        self._estimate = Estimate(0.0, inertial, path.position0, path.velocity0, path.gravity)
        self._measured = -math.inf
        self._now = 0.0
        self._corrected = -math.inf
        self._landing = plan.duration
        self._update.begin(self._estimate)
        corrected = self._update.predicted(self.motion)
        self._last = _correction("applied", "", corrected, plan.duration, momentum)

    def identification(self, angular_momentum: Any) -> Identification:
        """Return the filter's state at takeoff, with an angular momentum, kg m^2/s, in space (3,)."""
        return self.views.flying.identification(angular_momentum)

    def _along(self, angular_momentum: Any) -> float:
        """The component of an angular momentum along the plan's, kg m^2/s; in a plane itself."""
        return float(self.views.flying.direction @ np.atleast_1d(angular_momentum))

    def _corrected_at_takeoff(self, motion: RemainingMotion, angular_momentum: float, evaluations: int) -> Prediction:
        """Return a motion from takeoff, corrected for an angular momentum along the plan's, kg m^2/s."""
        self.reset()
        inertial = self._estimate.inertial
        inertial.state[inertial.size : 2 * inertial.size] = angular_momentum * self.views.flying.direction
        self._update.remember(motion)
        return self._update.corrected(0.0, self.plan.duration, evaluations)

    @property
    def motion(self) -> RemainingMotion:
        """The joints' motion from the last correction on."""
        return self._update.motions[-1]

    def rest(self, time: float) -> RemainingMotion:
        """Return the present motion rewritten from ``time``, s, to the landing; corrections are not changed."""
        return self._update.rewritten(time, self._landing)

    @property
    def landing(self) -> float:
        """When the robot lands, s since takeoff, as it is estimated."""
        return self._landing

    def reference(self, t: float) -> Reference:
        """Return what the joints are to do at a time, s since takeoff; nothing but the goal's posture after landing."""
        time = _time(t)
        motions = self._update.motions
        motion = motions[-1 if math.isnan(time) else 0]
        for later in reversed(motions):
            if later.begin <= time:
                motion = later
                break
        positions, velocities, accelerations = motion.at(time if math.isfinite(time) else self._now)
        torques = self._update.torques(positions[0], velocities[0], accelerations[0])
        n = positions.shape[1]
        return Reference(positions[0], velocities[0], accelerations[0], torques[:n], torques[n:])

    def update(
        self,
        t: float,
        orientation: npt.ArrayLike,
        orientation_rate: npt.ArrayLike,
        positions: npt.ArrayLike,
        velocities: npt.ArrayLike,
        now: float | None = None,
        com_position: npt.ArrayLike | None = None,
        com_velocity: npt.ArrayLike | None = None,
    ) -> Correction:
        """Process a measurement and correct the motion; raises nothing.

        Between corrections the measurement is only learnt from, and the last correction is returned again, with its
        status.

        Parameters
        ----------
        t : s since takeoff, of the measurement; later than that of the last one
        orientation, orientation_rate : rad, rad/s
            Whole turns more or less do not matter. In space a quaternion (4,) x, y, z, w, of either sign, and the
            angular velocity (3,) in the base's axes.
        positions, velocities : (n,) rad, rad/s
            Of the planned joints.
        now : s since takeoff
            From when on the motion may change; left out, ``t``. It is later where measurements arrive with a delay.
        com_position, com_velocity : (2,) m, m/s, in space (3,), optional
            Of the centre of mass; with both, the time of the landing is estimated again.
        """
        size = len(self.plan.robot.joints)
        joints = positions, velocities
        com = com_position, com_velocity
        measured = read(self._orientations, t, orientation, orientation_rate, joints, com, size)
        if measured is None:
            return self._unchanged("invalid", "not finite numbers of the right shapes")
        present = _time(measured.time if now is None else now)
        if not measured.time > self._measured:
            return self._unchanged("invalid", "not later than the last measurement")
        if not max(measured.time, self._now) <= present < self._landing:
            return self._unchanged("invalid", "not between the last call and the landing")
        longest_delay = 0.25  # [s] of a measurement
        if not measured.time >= max(self._update.motions[0].begin, present - longest_delay, 0.0):
            return self._unchanged("invalid", "measured too long ago")
        wrong = self._learn(measured, present)
        if wrong:
            return self._unchanged("invalid", wrong)
        self._now = present
        # A correction that comes too early by a tenth of the time between two is made all the same.
        if present - self._corrected < 0.9 / self.rate:
            return self._last
        return self._correct(present)

    def _learn(self, measured: Measurement, now: float) -> str:
        """Learn from a measurement; return why it was not learnt from, or ``""``."""
        estimate = self._estimate
        plausible = self._plausible
        if measured.com_position is not None and not plausible.com(measured, *estimate.com_at(measured.time)):
            return FAR_OFF
        expected = self._update.expected(measured, now)
        orientations = self._orientations
        difference = orientations.difference(measured.orientation, expected.orientation)
        mistake = plausible.mistaken(measured, expected)
        if not mistake and max(map(abs, difference)) > orientations.suspicious:
            mistake = orientations.misread(measured.orientation, expected.orientation, max(expected.allowed))
        if mistake:
            return mistake
        measured.orientation = orientations.unwrapped(measured.orientation, difference, expected.offset)
        off = [*map(abs, map(sub, difference, expected.offset))]
        base = plausible.base(off, expected)
        if base and plausible.joints(expected):
            self._recovery.believe(measured)
        elif not (max(off) <= PLAUSIBLE.orientation and self._recovery.believes(measured)):
            return FAR_OFF
        elif not base:
            estimate.inertial.forget()
        self._update.learn(measured)
        estimate.add(measured)
        self._measured = measured.time
        return ""

    def _correct(self, now: float) -> Correction:
        first = self._corrected < 0.0
        self._corrected = now
        landing = self._landing_estimate(now)
        if landing - now <= 1e-4 * self.plan.duration:
            return self._unchanged("refused", "too late to correct anything")
        momentum = self._estimate.inertial.angular_momentum
        warm_start = self._warm_starts.at(now, self._along(momentum)) if first else None
        evaluations = 8 if first else CORRECTION_OPTIONS.evaluations_near  # the first correction is the largest
        corrected = self._update.corrected(now, landing, evaluations, warm_start)
        self._landing = landing
        self._last = _correction(*_judged(corrected), corrected, landing, momentum)
        return self._last

    def _landing_estimate(self, now: float) -> float:
        """When the robot lands, s; moved by a share of the remaining time at most, and as far as joints can follow."""
        estimate = self._estimate
        landing = estimate.landing(self._landing_height) if estimate.com_measurements else None
        if landing is None:
            return self._landing
        remaining = self._landing - now
        most = min(0.3 * remaining, self._pace * remaining * remaining)
        return min(max(landing, self._landing - most), self._landing + most)

    def _unchanged(self, status: Status, reason: str) -> Correction:
        return replace(self._last, status=status, reason=reason)


def _time(value: object) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except Exception:  # whatever a caller's object raises: the flight goes on
        return math.nan


def _correction(status: Status, reason: str, corrected: Prediction, landing: float, momentum: Any) -> Correction:
    return Correction(
        status=status,
        reason=reason,
        landing=landing,
        angular_momentum=momentum,
        motion=corrected.motion,
        predicted_miss=corrected.miss,
        torque_peak=corrected.torque_peak,
    )


def _judged(corrected: Prediction) -> tuple[Status, str]:
    if corrected.share == 0.0:
        return "refused", "any correction breaks a limit"
    if corrected.share < 1.0:
        return "limited", "the whole correction breaks a limit"
    if corrected.breaks_a_limit:
        return "limited", "a limit will be broken, as without the correction"
    if not corrected.missed <= REACHED:
        return "limited", f"it lands more than {REACHED:g} rad from the goal"
    return "applied", ""


def _rms_acceleration(plan: Plan) -> float:
    quadrature = gauss_legendre(64)
    _, _, accelerations = plan.joint_motion(quadrature.nodes * plan.duration)
    mean = float(quadrature.weights @ (accelerations**2).mean(axis=1))
    return max(math.sqrt(mean), 1 / plan.duration**2)
