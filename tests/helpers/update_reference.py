"""The filter of an update, written a second time."""

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.inflight import estimate


def filtered(replanner: fp.Replanner, t: float, orientation: float, rate: float, *joints: Array) -> tuple[Array, Array]:
    """Return state and covariance after a measurement, a Kalman filter's of ``h = D . (theta0', q')``, D by masses.

    The joints' positions and velocities (n,) are those measured. The motion is one since the last measurement.
    """
    inertial, began, tree = replanner._estimate.inertial, replanner._estimate.time, replanner.plan.robot.tree
    dynamics = estimate.adapted(tree, inertial.state[2:])
    state, bodies, nodes = (
        inertial.state.copy(),
        len(replanner.plan.robot.tree.mass),
        np.polynomial.legendre.leggauss(40),
    )
    times = began + (t - began) * (nodes[0] + 1) / 2
    positions, velocities, _ = replanner.motion.at(times)
    state[0] += (t - began) / 2 * (nodes[1] @ dynamics.base_rate(positions, velocities, state[1]))
    (here,), (there,), _ = replanner.motion.at(t)
    inertia = dynamics.momentum_map(here[None])[0]
    maps = [estimate.adapted(tree, errors) for errors in np.vstack((np.zeros(2 * bodies), np.eye(2 * bodies)))]

    def momenta(positions: Array, velocities: Array, rate: float) -> Array:
        """Of the plan's masses, then of each of them doubled."""
        return np.array([dynamics.momentum_map(positions[None])[0] @ np.append(rate, velocities) for dynamics in maps])

    expected = momenta(here, there, (state[1] - inertia[1:] @ there) / inertia[0])
    row = np.concatenate(([0.0, 1.0], expected[0] - expected[1:]))
    dt, noise = t - began, float(inertia @ inertia)
    turn = np.eye(len(state))
    turn[0] += row * dt / inertia[0]
    covariance = turn @ (inertial.covariance + dt * np.diag(inertial.wander)) @ turn.T
    aside = inertia[1:] @ (joints[0] - here) / inertia[0]
    angle = np.eye(len(state))[0]
    for h, value, variance in (
        (angle, orientation + aside, replanner._update.options.angle_noise**2 * noise / inertia[0] ** 2),
        (row, momenta(joints[0], joints[1], rate)[0], replanner._update.options.rate_noise**2 * noise),
    ):
        gain = covariance @ h / (h @ covariance @ h + variance)
        state += gain * (value - h @ state)
        covariance = covariance - np.outer(gain, h @ covariance)
    state[2:] = np.clip(state[2:], -replanner._update.options.largest_error, replanner._update.options.largest_error)
    return state, covariance
