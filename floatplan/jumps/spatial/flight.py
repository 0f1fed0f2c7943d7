"""The flight of a jump in space: an ordinary problem whose both ends are those of the stances."""

import itertools
from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.flight import obstacles_in
from floatplan.jumps.phases import grounds_below
from floatplan.jumps.spatial.coordinates import Mechanics, rotations_about
from floatplan.jumps.spatial.exact import FlightEnds
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.standing import Foot, Kinematics
from floatplan.problem.attitude import Attitude
from floatplan.problem.ground_step import GroundStep, edge_obstacles
from floatplan.problem.parts import Flight, Landing, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import MOST_DISTANCES
from floatplan.problem.spatial_obstacles import HalfSpace
from floatplan.robot.shapes.solids import frame_position


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
    takeoff = _frame_origin(mechanics, ends.motion[:, :, 0], before)
    landing = _frame_origin(mechanics, ends.motion[:, :, 1], after)
    request = problem.jump
    assert request is not None
    ground = float(solution.origin[2])
    others = (
        *obstacles_in(problem.obstacles, ends.duration, ground),
        *edge_obstacles(GroundStep.of(request, problem.takeoff.position, ground)),
    )
    most = max(1, MOST_DISTANCES // max(1, len(problem.robot.capsules)) - len(others))
    return replace(
        problem,
        start=postures[0],
        goal=postures[1],
        flight=Flight(
            ends.duration,
            angular_momentum=tuple(ends.momentum.tolist()),
            takeoff=Takeoff(before.frame, tuple(takeoff.tolist())),
            landing=Landing(after.frame, height=float(landing[2])),
            horizontal_velocity=tuple(ends.com_velocity[:2].tolist()),
            gravity=mechanics.gravity,
        ),
        obstacles=(*others, *_grounds(program, solution, mechanics, ends, most)),
        ground=False,
        written=None,
    )


def _frame_origin(mechanics: Mechanics, motion: Array, foot: Foot) -> Array:
    """Where the origin of a foot's frame is in a motion (3, 6+n) of base and joints, (3,) m."""
    y = motion[0]
    robot = mechanics.robot
    kinematics = Kinematics(robot)
    kinematics.pose(y[:3], rotations_about(mechanics.axes, y[3:BASE, None])[0], y[BASE:])
    return kinematics.point(*frame_position(robot.model, robot.joint_tree, foot.frame))


def _grounds(
    program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, ends: FlightEnds, most: int
) -> list[HalfSpace]:
    """Half-spaces below the links' capsules, one for each time of the flight: the plan's feet are lifted too.

    Each is as high as three quarters of the height that the lowest capsule has in the program, up to the program's
    lift; at both ends, where capsules that are thicker than what stands are in the ground, a little below them. Where
    it lands on other ground than it leaves, each of them counts as :func:`grounds_below` says.
    """
    progress = program.phases[program.flight].progress
    grounds = grounds_below(progress, 0.0, program.ends.rise)
    below = np.minimum(grounds[1:], grounds[:-1])  # of an interval
    motion = mechanics.from_centre(solution.com_motion[:, :, program.flight_nodes])
    motion[:, :, [0, -1]] = ends.motion
    ground = float(solution.origin[2])
    above = _lowest(program, mechanics, motion) - ground
    gap = 1e-3  # [m] below capsules in the ground, which may be as much lower between nodes
    share = np.full(len(below), 0.75)  # [-] of the program's height: polynomials have fewer variables than its nodes
    # Next to the change of grounds legs begin to reach for the other one, and feet stay less above the first.
    changes_soon = np.append(below[1:] != below[:-1], False) | np.insert(below[1:] != below[:-1], 0, False)
    share[changes_soon] = 0.25
    least = np.minimum(above[1:], above[:-1]) - below
    levels = np.where(least > 0, share * np.minimum(least, program.bounds.lift), least) - gap
    levels = (ground + below + levels).round(4)
    borders = np.linspace(0.0, float(solution.durations[program.flight]), len(above))
    changes = np.flatnonzero(np.diff(levels)) + 1
    runs = []  # of intervals of one level: begin, end, level
    for first, last in itertools.pairwise([0, *changes.tolist(), len(levels)]):
        runs.append((float(borders[first]), float(borders[last]), float(levels[first])))
    runs = merged_levels(runs, most)
    return [HalfSpace(point=(0.0, 0.0, level), window=(begin, end)) for begin, end, level in runs]


def merged_levels(runs: list[tuple[float, float, float]], most: int) -> list[tuple[float, float, float]]:
    """Return ``most`` runs of a level at most, each with begin and end: neighbours that differ least become one.

    It has the lower level of both.
    """
    merged = list(runs)
    while len(merged) > most:
        index = int(np.abs(np.diff([level for _, _, level in merged])).argmin())
        begin, _, level = merged[index]
        _, end, next_level = merged[index + 1]
        merged[index : index + 2] = [(begin, end, min(level, next_level))]
    return merged


def _lowest(program: SpatialProgram, mechanics: Mechanics, motion: Array) -> Array:
    """Heights (N,) of the lowest capsule's lowest point in a motion (3, 6+n, N) of base and joints, m."""
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
