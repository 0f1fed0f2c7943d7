"""The flight of a jump in space: an ordinary problem whose both ends are those of the stances."""

from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.flight import obstacles_in
from floatplan.jumps.spatial.coordinates import Mechanics, rotations_about
from floatplan.jumps.spatial.exact import FlightEnds
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.program import SpatialProgram, SpatialSolution
from floatplan.jumps.spatial.standing import Kinematics
from floatplan.problem.attitude import Attitude
from floatplan.problem.parts import Flight, Landing, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.problem.spatial_obstacles import HalfSpace
from floatplan.tables import POINT_FEET


def flight_problem(
    problem: Problem, program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, ends: FlightEnds
) -> Problem:
    """Return the problem of the flight between the stances of a solution, its ends pinned with two derivatives."""
    postures = []
    for column in range(2):
        y, v, a = ends.motion[:, :, column]
        attitude = Attitude(angles=tuple(y[3:BASE].tolist()), axes=mechanics.axes)
        postures.append(Posture(attitude, y[BASE:].copy(), v[BASE:].copy(), a[BASE:].copy()))
    before = program.phases[program.flight - 1].feet[0]
    after = program.phases[program.flight + 1].feet[0]
    places, _ = mechanics.feet(ends.motion[:, :, :1], [before.frame])
    landing_places, _ = mechanics.feet(ends.motion[:, :, 1:], [after.frame])
    return replace(
        problem,
        start=postures[0],
        goal=postures[1],
        flight=Flight(
            ends.duration,
            angular_momentum=tuple(ends.momentum.tolist()),
            takeoff=Takeoff(before.frame, tuple(places[0, 0, 0].tolist())),
            landing=Landing(after.frame, height=float(landing_places[0, 0, 0, 2])),
            horizontal_velocity=tuple(ends.com_velocity[:2].tolist()),
            gravity=mechanics.gravity,
        ),
        obstacles=(
            *obstacles_in(problem, ends.duration, float(solution.origin[2])),
            *_grounds(program, solution, mechanics),
        ),
        ground=False,
        written=None,
    )


def _grounds(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics) -> list[HalfSpace]:
    """Half-spaces below the links' capsules, which are thicker than what stands: as deep as these are at both ends.

    Another is as high as the ground, while the program's capsules are well above it: while its feet are lifted.
    """
    columns = slice(program.borders[program.flight], program.borders[program.flight + 1] + 1)
    motion = mechanics.from_centre(np.stack((solution.y, solution.v, solution.a))[:, :, columns])
    heights = _lowest(program, mechanics, motion)
    ground = float(solution.origin[2])
    dip = 5e-4  # [m] of feet next to the ground, so that their shapes, inside the capsules, stay within POINT_FEET
    level = ground + min(0.0, heights[0] - ground, heights[-1] - ground) - dip
    grounds = [HalfSpace(point=(0.0, 0.0, round(level, 4)))]
    clearly = 0.03  # [m] above the ground is in the air for sure, also where the robot lands a little early
    above = heights - ground
    lifted = np.flatnonzero(above > np.clip(above.max() / 2, POINT_FEET, clearly))
    if len(lifted) > 1:
        first, last = lifted[[0, -1]]
        level = ground + min(0.0, above[first : last + 1].min() - POINT_FEET)
        duration = float(solution.durations[program.flight])
        shares = np.linspace(0.0, duration, len(heights))
        grounds.append(HalfSpace(point=(0.0, 0.0, round(level, 4)), window=(shares[first], shares[last])))
    return grounds


def _lowest(program: SpatialProgram, mechanics: Mechanics, motion: Array) -> Array:
    """Heights (N,) of the lowest capsule's lowest point in a motion (3, 6+n, N), m."""
    kinematics = Kinematics(program.model.robot)
    rotations = rotations_about(mechanics.axes, motion[0, 3:BASE])
    lowest = []
    for column, rotation in enumerate(rotations):
        kinematics.pose(motion[0, :3, column], rotation, motion[0, BASE:, column])
        of_capsules = []
        for capsule in program.model.robot.solid_capsules:
            ends = [kinematics.point(capsule.body, end)[2] for end in (capsule.start, capsule.end)]
            of_capsules.append(min(ends) - capsule.radius)
        lowest.append(min(of_capsules))
    return np.array(lowest)
