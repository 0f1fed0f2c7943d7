"""The law of corrections: least miss at the landing, change of the accelerations, and breach of limits, softly.

With the miss c, the change y of the motion and the rows g of the limits that are near, a few Gauss-Newton steps on

    c^2 / sigma^2 + |y|^2 / (a^2 tau^4) + sum_j min(g_j - aim_j, 0)^2 / softness_j^2,

tau the time that remains. The second term makes the last corrections fade: what is left to correct and the time for it
both go to zero, and the minimal-norm correction's torque would grow like ``1 / tau^2``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.limits import Rows
from floatplan.inflight.outlook import Outlook
from floatplan.motion.sine_polynomial import CONDITIONS

EVALUATIONS = 1  # [-] of changed motions at most
EVALUATIONS_FAR = 6  # [-] the same where the landing is far from the goal
FAR = 0.06  # [rad]
WEIGHED = 10.0  # [-] sigmas of the landing at most, against limits: one that is farther is approached from where it is
SETTLED = 0.1  # [-] of sigma, and of the cost: less is not worth a step
SHORTER = 0.3  # [-] of a step that is no better
MOST_ROWS = 24  # [-] of a block that are looked at in a step
KEPT = 1e-3  # [-] a row that is less below zero counts as kept
SCALES = (0.5, 0.25)  # [-] shares of a correction that are tried where the whole breaks a limit


@dataclass(frozen=True)
class Law:
    """The weights of the law: ``sigma`` rad of the landing, ``acceleration`` rad/s^2 of a correction."""

    sigma: float
    acceleration: float
    rows: tuple[Rows, ...]

    def corrected(
        self, present: Outlook, evaluations: int = EVALUATIONS, warm_start: Array | None = None
    ) -> tuple[Outlook, float]:
        """Return the outlook after the correction, and the share of the correction that was taken.

        Changed motions are evaluated so many times at most, more often where the landing is far from the goal: then
        first as if the base were to reach it, see :meth:`Outlook.as_landed`. A warm start, a change (m, n) of the free
        coefficients, is where to begin if it lands nearer, and near the goal.
        """
        taken = 0.0
        if warm_start is not None:
            warm = present.moving_as(warm_start)
            if abs(warm.miss) < min(abs(present.miss), FAR) and self._keeps(warm, present):
                present, taken = warm, 1.0
        if self.rows and abs(present.miss) > FAR:
            evaluations = max(evaluations, EVALUATIONS_FAR)
            if present.has_distances:
                outlook = self._solved(present.as_landed(), evaluations)[0].as_it_is()
                if abs(outlook.miss) < abs(present.miss) and self._keeps(outlook, present):
                    return outlook, 1.0
                evaluations = EVALUATIONS
        outlook, best = self._solved(present, evaluations)
        if self._keeps(outlook, present):
            return outlook, 1.0
        for scale in SCALES:
            part = present.changed(scale * best)
            if self._keeps(part, present) and abs(part.miss) < abs(present.miss):
                return part, scale
        return present, taken

    def _solved(self, present: Outlook, evaluations: int) -> tuple[Outlook, Array]:
        """Return the least of the law, and its change y: Gauss-Newton steps, shorter ones where one is no better."""
        y = np.zeros(present.motion.amplitude.size * (len(present.motion.coefficients) - CONDITIONS))
        stiffness = 1 / (self.acceleration * present.motion.remaining**2) ** 2
        best, outlook, sigma = y, present, self._tolerance(present.miss)
        least = self._cost(present, y, stiffness, sigma)
        step, expected = self._step(outlook, best, stiffness, sigma)
        for left in reversed(range(evaluations)):
            if least - expected < SETTLED**2:
                break
            y = best + step
            tried = present.changed(y)
            cost = self._cost(tried, y, stiffness, sigma)
            if not cost < least:
                step = SHORTER * step
                if not np.isfinite(cost) or stiffness * (step @ step) < SETTLED**2:
                    break
                continue
            settled = cost - expected <= SETTLED * cost + SETTLED**2
            best, outlook, nearer = y, tried, self._tolerance(tried.miss)
            if settled and nearer > sigma / 2:
                break
            sigma = nearer
            least = self._cost(tried, y, stiffness, sigma)
            if left:
                step, expected = self._step(outlook, best, stiffness, sigma)
        return outlook, best

    def _tolerance(self, miss: float) -> float:
        """Sigma, rad; larger far from the goal, so that it does not outweigh the limits."""
        return max(self.sigma, abs(miss) / WEIGHED) if self.rows else self.sigma

    @staticmethod
    def _keeps(outlook: Outlook, present: Outlook) -> bool:
        """Whether a correction keeps what the present motion keeps; what that breaks, the cost has weighed."""
        kept = outlook.worst >= -KEPT
        return bool(kept.all() or (kept | (present.worst < -KEPT)).all())

    def _cost(self, outlook: Outlook, y: Array, stiffness: float, sigma: float) -> float:
        broken = sum(float(breach.below @ breach.below) for breach in outlook.breaches)
        return (outlook.miss / sigma) ** 2 + stiffness * float(y @ y) + broken

    def _step(self, outlook: Outlook, y: Array, stiffness: float, sigma: float) -> tuple[Array, float]:
        """One step, and the cost that it would have if everything were linear."""
        rows = [outlook.miss_by_y[None, :] / sigma]
        residual = [np.array([outlook.miss / sigma])]
        for block, instants, columns, below in outlook.breaches:
            worst = np.argpartition(-below, MOST_ROWS)[:MOST_ROWS] if below.size > MOST_ROWS else slice(None)
            rows.append(outlook.rows_by_y(block, instants[worst], columns[worst]) / block.softness)
            residual.append(-below[worst])
        jacobian, residuals = np.concatenate(rows), np.concatenate(residual)
        step = _least(jacobian, residuals, y, stiffness)
        after, following = residuals + jacobian @ step, y + step
        return step, float(after @ after + stiffness * (following @ following))


def _least(jacobian: Array, residuals: Array, y: Array, stiffness: float) -> Array:
    """Return the step (n m,) that makes ``|residuals + jacobian step|^2 + stiffness |y + step|^2`` least."""
    if len(residuals) == 1:  # no limit is near: in closed form
        row = jacobian[0]
        return np.asarray(row * ((row @ y - residuals[0]) / (stiffness + row @ row)) - y)
    hessian = jacobian.T @ jacobian
    hessian.flat[:: len(y) + 1] += stiffness
    return np.asarray(np.linalg.solve(hessian, -(jacobian.T @ residuals + stiffness * y)), dtype=np.float64)
