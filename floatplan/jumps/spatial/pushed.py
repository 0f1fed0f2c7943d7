"""A robot on one sole: its base moves as the forces on its feet push it.

Points of one sole are near one another. There a motion that is interpolated between nodes takes forces that pull, next
to the flight above all, where there is little force. Forces that are linear between nodes stay inside the friction
cones, and the centre of pressure inside the sole. So they are taken as they are, and the base's pose is integrated from
the flight's end on; the legs that stand follow from it.
"""

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.motion import quintic_spline, refined, values
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.model import BASE


class PushedBase:
    """The differential equation of the base's pose at some instants.

    Attributes
    ----------
    mechanics : Mechanics
    motion : (3, 6+n, N) of the joints that do not stand
    forces : (N, F, 3) N on the feet
    places : of each foot, frame -> (3,) m
    """

    def __init__(self, mechanics: Mechanics, motion: Array, forces: Array, places: dict[str, Array]) -> None:
        self.mechanics = mechanics
        self.motion = motion
        self.forces = forces
        self.places = places

    def closed(self, index: int, pose: Array, rate: Array) -> Array:
        """The motion (3, 6+n, 1) at an instant, with a pose of the base (6,) and its rate, the feet standing."""
        at_instant = self.motion[:, :, [index]].copy()
        at_instant[0, :BASE, 0] = pose
        at_instant[1, :BASE, 0] = rate
        return self.mechanics.close(at_instant, self.places)

    def acceleration(self, index: int, pose: Array, rate: Array) -> Array:
        """The second derivative (6,) of the pose with which the feet bear what the motion takes."""
        # The wrench is affine in the base's accelerations: one column without, and one for each of the six.
        varied = np.repeat(self.closed(index, pose, rate), 1 + BASE, axis=2)
        varied[2, :BASE, 1:] += np.eye(BASE)
        varied = self.mechanics.unaccelerated(varied, list(self.places))
        wrenches = self.mechanics.base_wrench(varied)
        forces = self.forces[index]
        arms = np.array(list(self.places.values())) - pose[:3]
        borne = np.concatenate((forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)))
        change = np.linalg.solve((wrenches[1:] - wrenches[0]).T, borne - wrenches[0])
        return np.asarray(varied[2, :BASE, 0] + change)


def pushed_from(
    mechanics: Mechanics, times: Array, motion: Array, shares: Array, places: dict[str, Array], near: int
) -> Array:
    """The motion (3, 6+n, G) whose base is pushed by forces, from one end, 0 or -1, where it is as it is, to the other.

    Parameters
    ----------
    mechanics : Mechanics
    times : (G,) s
    motion : (3, 6+n, G)
    shares : (3 F, G) forces of the feet, N, linear between these times
    places : of the F feet, frame -> (3,) m
    near : of the end
    """
    direction = 1 if near == 0 else -1
    fine = refined(times, 2)  # each Runge-Kutta step needs its middle
    forces = np.stack([np.interp(fine, times, row) for row in shares]).T.reshape(len(fine), -1, 3)
    varied = values(quintic_spline(times, motion), np.clip(fine, times[0], times[-1]))
    base = PushedBase(mechanics, varied[:, :, ::direction], forces[::direction], places)
    steps = np.diff(fine[::direction][::2])
    pose = motion[0, :BASE, near].copy()
    rate = motion[1, :BASE, near].copy()
    columns = []
    for column in range(len(times)):
        at = 2 * column
        change = base.acceleration(at, pose, rate)
        pushed = base.closed(at, pose, rate)
        pushed[2, :BASE, 0] = change
        columns.append(mechanics.unaccelerated(pushed, list(places)))
        if column < len(steps):
            pose, rate = _runge_kutta(base, at, (pose, rate, change), float(steps[column]))
    return np.concatenate(columns[::direction], axis=2)


def _runge_kutta(base: PushedBase, begin: int, state: tuple[Array, Array, Array], step: float) -> tuple[Array, Array]:
    """Pose and rate (6,) two instants after ``begin``, where pose, rate and acceleration are those of ``state``."""
    pose, rate, first = state
    half = step / 2
    second_rate = rate + half * first
    second = base.acceleration(begin + 1, pose + half * rate, second_rate)
    third_rate = rate + half * second
    third = base.acceleration(begin + 1, pose + half * second_rate, third_rate)
    fourth_rate = rate + step * third
    fourth = base.acceleration(begin + 2, pose + step * third_rate, fourth_rate)
    next_pose = pose + step / 6 * (rate + 2 * second_rate + 2 * third_rate + fourth_rate)
    next_rate = rate + step / 6 * (first + 2 * second + 2 * third + fourth)
    return np.asarray(next_pose), np.asarray(next_rate)
