"""What an update computes: the expected state, the filter, the rest of the flight written anew and corrected. In NumPy.

:mod:`floatplan.inflight.compiled` computes the same in the compiled kernel.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.estimate import Estimate
from floatplan.inflight.law import Law
from floatplan.inflight.measurement import Expected, Measurement
from floatplan.inflight.motion import RemainingMotion, Rewriting
from floatplan.inflight.outlook import Outlook, Present, Views
from floatplan.motion.quadrature import gauss_legendre

MEMORY = 64  # [-] motions that are remembered, for measurements that come late
GAP_NODES = 5  # [-] of the quadrature between measurements


@dataclass(eq=False)
class Foreseen:
    """An outlook's motion that was chosen, its miss, rad, the worst of each block of rows, and the share of the
    correction taken.
    """

    outlook: Outlook
    miss: float
    worst: Array
    share: float

    @property
    def motion(self) -> RemainingMotion:
        """The joints' motion."""
        return self.outlook.motion


class Reckoning:
    """Of one flight at a time: ``motions`` are those of the joints so far, the last one holds now."""

    def __init__(self, views: Views, rewriting: Rewriting, law: Law) -> None:
        self.views, self._rewriting, self._law = views, rewriting, law
        self._gap = gauss_legendre(GAP_NODES)
        self.motions: deque[RemainingMotion] = deque(maxlen=MEMORY)

    def begin(self, estimate: Estimate) -> None:
        """Begin another flight, of which so much is known."""
        self.estimate = estimate
        self.motions.clear()
        self.remember(self._rewriting.first)

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return what is expected to be measured; the motion may change from ``now`` on, s."""
        inertial, began = self.estimate.inertial, self.estimate.time
        nodes = self._gap.nodes
        times = np.concatenate(
            (began + (measured.time - began) * nodes, (measured.time,), measured.time + (now - measured.time) * nodes)
        )
        self._gap_joints = self._joints(times)
        positions, velocities = (values[: GAP_NODES + 1] for values in self._gap_joints)
        maps = inertial.dynamics.momentum_map(positions)
        rates = (inertial.angular_momentum - (maps[:, 1:] * velocities).sum(axis=1)) / maps[:, 0]
        dt = measured.time - began
        turn = float(self._gap.weights @ rates[:GAP_NODES]) * dt
        self._inertia = inertia = maps[GAP_NODES]
        here, there, rate = positions[GAP_NODES], velocities[GAP_NODES], rates[GAP_NODES]
        with np.errstate(all="ignore"):  # whatever is measured
            aside = -float(inertia[1:] @ (measured.positions - here) / inertia[0])
            self._momentum = inertial.momentum(
                np.array([here, measured.positions]),
                np.array([there, measured.velocities]),
                np.array([rate, measured.orientation_rate]),
            )
        variance = inertial.orientation_variance(self._momentum[1] * (dt / inertia[0]))
        noise = float(inertia @ inertia / inertia[0] ** 2)
        return Expected(here, there, inertial.orientation + turn, float(rate), aside, variance, noise)

    def learn(self, measured: Measurement, expected: Expected) -> None:
        """Take in a measurement that is as it was expected."""
        inertial = self.estimate.inertial
        inertial.state[0] = expected.orientation
        dt = measured.time - self.estimate.time
        inertial.learn(measured.orientation - expected.aside, *self._momentum, self._inertia, dt)

    def turned(self, dt: float) -> float:
        """By how much the base turns in the ``dt`` s since the measurement that was learnt from last, rad."""
        if not dt:
            return 0.0
        inertial = self.estimate.inertial
        positions, velocities = (values[GAP_NODES + 1 :] for values in self._gap_joints)
        rates = inertial.dynamics.base_rate(positions, velocities, inertial.angular_momentum)
        return dt * float(self._gap.weights @ rates)

    def corrected(
        self, now: float, orientation: float, landing: float, evaluations: int, warm_start: Array | None = None
    ) -> Foreseen:
        """Return the present motion from ``now`` to the landing, s, corrected; it is the one that holds from now on."""
        present = Outlook(self.views, self._rewritten(now, landing), self.present(now, orientation))
        outlook, share = self._law.corrected(present, evaluations, warm_start)
        self.remember(outlook.motion)
        return Foreseen(outlook, outlook.miss, outlook.worst, share)

    def present(self, now: float, orientation: float) -> Present:
        """The robot at a time not before the last measurement, at which its orientation is known, rad."""
        estimate = self.estimate
        inertial = estimate.inertial
        return Present(now, orientation, inertial.angular_momentum, estimate.path_from(now), inertial.as_found())

    def _rewritten(self, now: float, landing: float) -> RemainingMotion:
        return self._rewriting.from_now(self.motions[-1], now, landing)

    def remember(self, motion: RemainingMotion) -> None:
        """Take a motion as the present one."""
        self.motions.append(motion)

    def _joints(self, times: Array) -> tuple[Array, Array]:
        """Positions and velocities (N, n) at ascending times, each of the motion that held then; at rest before."""
        parts, last = [], len(times)
        for motion in reversed(self.motions):
            first = int(times[:last].searchsorted(motion.begin)) if motion is not self.motions[0] else 0
            if first < last:
                parts.append(motion.p(times[first:last]))
            last = first
            if not last:
                break
        p, rate, _ = parts[0] if len(parts) == 1 else np.concatenate(parts[::-1], axis=1)
        motion, oldest = self.motions[-1], self.motions[0].begin
        velocities = motion.amplitude * np.cos(p) * rate
        if times[0] < oldest:
            velocities[times < oldest] = 0.0
        return motion.centre + motion.amplitude * np.sin(p), velocities
