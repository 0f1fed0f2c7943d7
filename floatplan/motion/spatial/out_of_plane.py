"""What a plan in a plane leaves out: how the robot turns in space when it moves its joints as planned.

Planar theory takes robots for their own mirror images in the plane. Those that are not quite make momentum out of it,
and one that turns about its middle axis of inertia multiplies what little that is.
"""

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.motion.planar.whole import PlanarMotion
from floatplan.motion.spatial.attitude import IntegrationError, cells, turn
from floatplan.robot.leak import centroidal_maps


def missed_in_space(motion: PlanarMotion) -> Array:
    """Vector of rotation (3,), rad, from the planned attitude at landing to that in space, in the base's axes.

    About the plane's horizontal, its vertical, and its normal, along which the angular momentum is in space too. NaN
    where the motion is too wild to be integrated, or the robot has no inertia about some axis.
    """
    robot = motion.problem.robot
    duration = motion.problem.flight.duration
    grid = cells(count=32, stages=8)
    plane = robot.plane
    momentum = motion.angular_momentum * robot.plane.normal
    positions, velocities, _ = motion.joints.at(grid.s * duration)
    inertia, maps = centroidal_maps(robot, positions)
    relative = np.einsum("kan,kn->ka", maps @ robot.selection, velocities)
    start = pin.exp3(motion.problem.initial.orientation * plane.normal)
    planned = pin.exp3(motion.final_orientation * plane.normal)
    try:
        end = turn(grid, duration, inertia, relative, momentum, start).ends[-1]
    except (IntegrationError, np.linalg.LinAlgError):
        return np.full(3, np.nan)
    axes = np.stack((plane.horizontal, plane.vertical, plane.normal))
    return np.asarray(axes @ pin.log3(planned.T @ end))
