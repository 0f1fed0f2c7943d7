"""The plainest stance that meets a flight which is known, from which the search for a better one begins."""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array
from floatplan.stance.exact import StanceDynamics
from floatplan.stance.motion import Grid, Stance, hermite, values
from floatplan.stance.phases import Meeting, instants
from floatplan.stance.program import JumpProgram

SHORTER, DRAWN = 0.8, (0.3, 1.3)  # [-] of the usual durations; and of these, each at random
FARTHEST = 2.0  # [rad] that a joint may be off for feet to be where they stand
FACTOR = 3.0  # [-] on limits, so that the guess is within most of them


def plainest(program: JumpProgram, met: Meeting, v: Array, rng: np.random.Generator | None = None) -> Array:
    """Return a guess (size,) of the program of one side, whose motion is a quintic from rest to the flight.

    Legs that stand follow from where their feet are; forces are those that balance the moments.

    Parameters
    ----------
    met : where the flight is met, with rates ``v`` (n+1,) rad/s
    rng : draws other durations
    """
    takes_off, way = met.node == 0, 1 if met.node == 0 else -1
    home, plain = program.ends[0 if takes_off else 1], program.split(program.guess())
    stances = [index for index, phase in enumerate(program.phases) if phase.contacts][::way]
    shares = SHORTER * (1.0 if rng is None else rng.uniform(*DRAWN, len(stances)))
    plain[-3][stances, 0] *= shares
    times = instants(program.phases, plain[-3].ravel())
    inner = StanceDynamics(program.model, program.phases[stances[-1]], home)
    a = inner.released(met.y, v, 0 * v if met.a is None else met.a)
    rest, flies = np.stack((home, 0 * home, 0 * home)), np.stack((met.y, v, a))
    motion = _quintic((rest, flies)[::way], times)
    for index in stances:
        phase, dynamics = program.phases[index], StanceDynamics(program.model, program.phases[index], home)
        nodes = slice(int(program.starts[index]), int(program.starts[index + 1]) + 1)
        try:
            closed = np.stack(dynamics.close(*motion[:, :, nodes]))
        except np.linalg.LinAlgError:  # a leg is straight
            break
        if not np.abs(closed - motion[:, :, nodes])[0].max() < FARTHEST:
            break
        motion[:, :, nodes] = closed
        if index != stances[-1]:  # from where the other feet leave, or to where they come
            rows, seam = dynamics.dependent, closed[:, :, -1 if takes_off else 0]
            beyond = slice(nodes.stop - 1, None) if takes_off else slice(0, nodes.start + 1)
            motion[:, rows, beyond] = _quintic((seam, flies)[::way], times[beyond])[:, rows]
        grid = Grid(times[nodes], closed[0], closed[1], closed[2], np.zeros((len(phase.others), closed.shape[2])))
        forces = Stance(program.model.robot, program.model.gravity, phase.contacts, 0j, grid).at(grid.times).forces
        for row, contact in enumerate(phase.others):
            plain[3 + index][2 * row : 2 * row + 2] = np.sum([forces[name] for name in contact.names], axis=0).T
    plain[-1][:] = FACTOR
    return program.join([*motion, *plain[3:]])


def _quintic(ends: tuple[Array, ...], times: Array) -> Array:
    """Values and two derivatives (3, n+1, N) of quintics between these (3, n+1) at the first and the last time."""
    return np.stack(values(hermite(times[[0, -1]], *np.stack(ends, axis=2)), times))
