"""Sine polynomials (12) on cells of time: positions, rates and accelerations of the planned joints in Taylor models."""

from __future__ import annotations

import flint
import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.cells import ORDER, TimeCells, recentred
from floatplan.certificate.enclosure import ROUND, Balls, Taylor, cos_sin, products, up
from floatplan.plans.record import PlanRecord


def joint_motion(record: PlanRecord, cells: TimeCells) -> tuple[Taylor, Taylor, Taylor]:
    """Positions, rates and accelerations (K, cells, n); p comes from the plan file's polynomials, recentred in Arb."""
    p, dp, ddp = _polynomials(record, cells)
    amplitude = Balls.exact(record.amplitude)
    cosine, sine = cos_sin(p)
    q = sine.times(amplitude) + Taylor.constant(Balls.exact(record.centre).broadcast(p.e.shape), ORDER)
    speed_share, speed, push = products([(cosine, dp), (dp, dp), (cosine, ddp)])
    dq = speed_share.times(amplitude)
    ddq = (push - sine * speed).times(amplitude)
    return q, dq, ddq


def _polynomials(record: PlanRecord, cells: TimeCells) -> tuple[Taylor, Taylor, Taylor]:
    """p, p' and p'' of (12) on the cells, recentred in Arb."""
    polynomials = list(map(flint.arb_poly, record.coefficients.tolist()))
    length = record.coefficients.shape[1]
    balls = recentred(polynomials, cells, length)
    c = balls.mid
    e = balls.rad
    p = Taylor.polynomial(c, e, ORDER)
    # half a cell of 1e-100 s is an instant: nothing can be divided by its length
    if (cells.half.mid < 1e-100).any():
        rates = [polynomial.derivative() for polynomial in polynomials]
        accelerations = [rate.derivative() for rate in rates]
        of_rates = recentred(rates, cells, length)
        of_accelerations = recentred(accelerations, cells, length)
        dp = Taylor.polynomial(of_rates.mid, of_rates.rad, ORDER)
        ddp = Taylor.polynomial(of_accelerations.mid, of_accelerations.rad, ORDER)
        return p, dp, ddp
    inverse = Balls(1.0 / cells.half.mid, up(4.0 * (ROUND + cells.half.rad / cells.half.mid) / cells.half.mid))
    first = _derivative(c, e)
    dp = Taylor.polynomial(*first, ORDER).times(inverse[:, None])
    ddp = Taylor.polynomial(*_derivative(*first), ORDER).times(inverse[:, None])
    return p, dp, ddp.times(inverse[:, None])


def _derivative(c: Array, e: Array) -> tuple[Array, Array]:
    """Coefficients and radii of the derivative by u; one coefficient at least."""
    if len(c) == 1:
        return np.zeros_like(c), np.zeros_like(e)
    degrees = np.arange(1, len(c)).reshape(-1, 1, 1)
    return c[1:] * degrees, up(e[1:] * degrees + ROUND * np.abs(c[1:]) * degrees)
