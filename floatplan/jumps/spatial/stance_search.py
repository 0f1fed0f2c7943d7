"""A single stance between two fixed ends: the robot stands still there, meets a flight, or moves with fixed rates.

It is the program of a jump with the phases of one stance: before a flight ("takeoff"), after one ("landing"), or
between two ("step"). :func:`stance_setup` states it, :func:`planned_stance` solves it, makes it exact between the
nodes, and checks it 2000 times a second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.check import sentences_on, stance_figures, unlimited_figures
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.motion import quintic
from floatplan.jumps.rounds import NodeMargins, refined_until_checked
from floatplan.jumps.spatial.conflicts import shortfall
from floatplan.jumps.spatial.exact import Curve, exact_stances, stance_ends
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.nodes import SpatialEnds, SpatialSolution
from floatplan.jumps.spatial.phases import SpatialPhase
from floatplan.jumps.spatial.program import SpatialProgram, solved_again
from floatplan.jumps.spatial.setup import SpatialSetup
from floatplan.jumps.spatial.stance import SpatialStance, shared_forces
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem

# Of the first program.
MARGINS = NodeMargins(torque=0.95, velocity=0.97, friction=0.9, clearance=3e-3, least_force=0.0, most_excess=1.0)


@dataclass(frozen=True, eq=False)
class StanceEnd:
    """Where a stance begins or ends.

    Attributes
    ----------
    motion : (3, 6+n) the base's origin, m, its angles and planned joints, rad, in the world, with two derivatives
        Feet that stand there are at their places, and still. Accelerations that are NaN are left to the program.
    flies : whether a flight is met there: nothing bears the robot, and its accelerations are those of the flight
    settles : whether the robot stands still there, in any posture: the motion's is where the search begins
    """

    motion: Array
    flies: bool = False
    settles: bool = False

    @property
    def is_still(self) -> bool:
        """Whether the robot stands still there."""
        return not self.flies and not self.motion[1:].any()


@dataclass(frozen=True, eq=False)
class StanceResult:
    """What a search for a stance came to.

    Attributes
    ----------
    stances : of its phases, in order of time; none where there is no solution
    figures : of their check; see :class:`~floatplan.jumps.check.JumpCheck`
    broken : sentences on what stands in the way, or does not hold at 2 kHz; empty where the stance holds
    """

    stances: tuple[SpatialStance, ...]
    figures: dict[str, float]
    broken: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether there is a stance, and it holds."""
        return not self.broken


def stance_setup(
    problem: Problem,
    request: JumpRequest,
    axes: str,
    phases: Sequence[SpatialPhase],
    ends: tuple[StanceEnd, StanceEnd],
    places: Mapping[str, Array],
) -> SpatialSetup:
    """State the search for a stance between two ends.

    Parameters
    ----------
    problem : whose robot, limits and gravity count; its obstacles do not
    request : friction, margins and clearance
    axes : of the base's angles in the ends
    phases : of the stance, all of one side: "takeoff", "landing" or "step"
    ends : StanceEnd of its begin and its end
    places : (3,) m, in the world, of the points of all feet that stand in it, by their names
    """
    setup = SpatialSetup(
        replace(problem, obstacles=(), self_clearances=()),
        request,
        axes,
        tuple(phases),
        SpatialEnds(np.empty((2, 0)), {}),
        np.zeros(3),
    )
    mechanics = setup.mechanics
    motion = np.stack([end.motion for end in ends], axis=2)
    centres, _ = mechanics.centre(np.nan_to_num(motion))
    com_motion = motion.copy()
    com_motion[:, :3] = np.where(np.isfinite(motion[:, :3]), centres, np.nan)
    foot = setup.feet[0]
    origin = np.array([*centres[0, :2, 0], places[foot.name][2] - foot.depth])
    com_motion[0, :3] -= origin[:, None]
    y, v, a = com_motion.transpose(0, 2, 1)
    of_side = {}
    for name, position in places.items():
        of_side[name] = position - origin
    spatial_ends = SpatialEnds(
        y=y,
        places={setup.phases[0].side: of_side},
        displacement=y[1, :2],
        v=v,
        a=a,
        flies=(ends[0].flies, ends[1].flies),
        settles=(ends[0].settles, ends[1].settles),
    )
    return replace(setup, ends=spatial_ends, origin=origin)


def planned_stance(
    setup: SpatialSetup,
    curve: Curve | None = None,
    *,
    is_reference: bool = False,
    begin: float = 0.0,
    margins: NodeMargins = MARGINS,
) -> StanceResult:
    """Search for the stance of a setup, and check it at 2 kHz.

    Parameters
    ----------
    setup : of :func:`stance_setup`
    curve : a motion of base and joints where the search begins, whose legs may miss their feet; a quintic between both
        ends if left out
    is_reference : whether the stance is to be near to the curve's attitudes and joints
    begin : s, when it begins in the time of what is returned
    margins : of the program

    Returns
    -------
    StanceResult
    """
    curve = curve or _between(setup)
    reference = curve if is_reference else None
    program = _program(setup, margins, reference)
    solution = program.solve(_guess(setup, program, curve))
    if not solution.converged:
        return StanceResult((), {}, (shortfall(program, solution, setup.problem, setup.request),))

    def finer(margins: NodeMargins) -> SpatialProgram:
        return _program(setup, margins, reference)

    def complete(program: SpatialProgram, solution: SpatialSolution) -> tuple[StanceResult, Mapping[str, float] | None]:
        result = _completed(setup, program, solution, begin)
        return result, None if result.ok or _is_beyond_mending(result) else result.figures

    return refined_until_checked(margins, setup.request, (program, solution), finer, complete, solved_again)


def _is_beyond_mending(result: StanceResult) -> bool:
    """Whether forces are so far from what the motion takes that more nodes leave them so.

    Where no motion meets both ends some solutions hold at the nodes and nowhere else: their accelerations change their
    sign from node to node, the more so the more nodes there are.
    """
    most = 0.1  # [-] of the weight: a G1's stances that more nodes mended start from 0.005 at most, others from 0.21
    return result.figures.get("residual", 0.0) > most


def _program(setup: SpatialSetup, margins: NodeMargins, reference: Curve | None) -> SpatialProgram:
    """The program with some margins, near to a reference where there is one."""
    program = setup.program(margins)
    if reference is None:
        return program
    motion = reference(program.times(_durations(setup)))
    return replace(program, reference=_com_motion(setup, motion)[0])


def _durations(setup: SpatialSetup) -> Array:
    return np.array([phase.duration for phase in setup.phases])


def _com_motion(setup: SpatialSetup, motion: Array) -> Array:
    """A motion (3, 6+n, N) of the base's origin as one of the centre of mass, in the program's world."""
    com_motion = motion.copy()
    com_motion[:, :3] = setup.mechanics.centre(motion)[0]
    com_motion[0, :3] -= setup.origin[:, None]
    return com_motion


def _between(setup: SpatialSetup) -> Curve:
    """Quintics from end to end."""
    ends = setup.ends
    com_motion = np.nan_to_num(np.stack((ends.y, ends.v, ends.a)).transpose(0, 2, 1))
    com_motion[0, :3] += setup.origin[:, None]
    motion = setup.mechanics.from_centre(com_motion)
    span = np.array([0.0, _durations(setup).sum()])
    return lambda times: quintic(np.clip(times, *span), span, motion[:, :, 0], motion[:, :, 1])


def _guess(setup: SpatialSetup, program: SpatialProgram, curve: Curve) -> Array:
    """The guess (size,) of a motion: its legs bent to where their feet stand, with the forces that this takes."""
    farthest = 1.0  # [rad] by which legs are bent to their feet: those that do not reach them are left as they are
    mechanics = setup.mechanics
    durations = _durations(setup)
    motion = curve(program.times(durations))
    for index, phase in enumerate(program.phases):
        nodes = slice(int(program.borders[index]), int(program.borders[index + 1]) + 1)
        closed = mechanics.close(motion[:, :, nodes], _places(setup, phase))
        if np.abs(closed[0] - motion[0, :, nodes]).max() < farthest:
            motion[:, :, nodes] = closed
    wrench = mechanics.base_wrench(motion)
    com_motion = _com_motion(setup, motion)
    n = program.model.size
    raw = np.zeros(program.size)
    for node, kind in enumerate(program.kinds):
        at = program.begins[node]
        raw[at : at + 3 * n] = com_motion[:, :, node].ravel()
        if kind.bearing:
            names = [foot.name for foot in kind.bearing]
            points = mechanics.feet(motion[:, :, [node]], names)
            arms = points[0] - motion[0, :3, node]
            even = np.zeros((1, len(names), 3))
            even[:, :, 2] = max(wrench[node, 2], 0.0) / len(names)
            forces = shared_forces(wrench[[node]], arms, even, program.weight, program.friction)
            raw[at + 3 * n : program.begins[node + 1]] = forces.ravel() / program.weight
    raw[program.size - len(program.phases) :] = durations
    return raw


def _places(setup: SpatialSetup, phase: SpatialPhase) -> dict[str, Array]:
    """Where the feet of a phase stand, by their names, (3,) m, in the world."""
    places = setup.ends.places[phase.side]
    return {name: places[name] + setup.origin for name in phase.names}


def _completed(setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, begin: float) -> StanceResult:
    """The stance of a solution, exact between the nodes, and its check."""
    mechanics = setup.mechanics
    moved = solution.moved(setup.origin)
    try:
        ends = stance_ends(program, moved, mechanics)
        stances = exact_stances(program, moved, mechanics, setup.phases[0].side, ends, begin)
    except (NoExactStanceError, np.linalg.LinAlgError) as error:
        return StanceResult((), {}, (f"between the program's nodes there is no stance: {error}",))
    sides = (tuple(stances), ()) if setup.phases[0].side == "takeoff" else ((), tuple(stances))
    figures = stance_figures(SpatialJumpMotion(setup.problem, setup.request, None, *sides))
    failing, _ = sentences_on(setup.request, figures, unlimited_figures(setup.problem))
    return StanceResult(tuple(stances), figures, tuple(", ".join(words) for words in failing))
