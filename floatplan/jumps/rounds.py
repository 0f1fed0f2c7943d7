"""Which program follows a solution: rounds with rows for what it violates; then stricter margins, if its check fails.

The first are of programs in a plane, whose distances and efforts of locked joints have no rows at first. The second
are of all programs: these look at nodes only, a check in between as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.check import FIGURES
from floatplan.jumps.jump import Jump
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.rows import ExtraRows
from floatplan.jumps.separation import RESERVE, TOLERATED_SHORTFALL
from floatplan.jumps.variables import FOOT_LIFT, JumpSolution
from floatplan.problem.jump import JumpRequest
from floatplan.tables import POINT_FEET

CORRECTIONS = 2  # [-] programs after the first, each with more nodes and stricter margins
NEAR_FAILED = "no jump was found near the one at hand"


@dataclass(frozen=True)
class NodeMargins:
    """How much stricter the program is than the check, since it looks at its nodes alone.

    Attributes
    ----------
    torque, velocity, friction : factors on what the request allows, at most 1; that of torques on locked joints' too
    refinement : by which factor there are more nodes than usual
    clearance : in addition to the requested clearance, m
    range : from the ends of joint ranges, rad
    reserve : in addition to margins of obstacles and links, m
    least_force : vertical, over the weight, on each contact that stands, where several do; in space on any that stands
    rotated_landing : whether rows hold the robot above the ground where it lands rotated by the pitch error
        Most landings do without them, and a program with them is slower and finds fewer jumps. In space there are no
        such rows: with this the clearance makes up for them.
    lift : of feet in the middle of the flight, m
    dip : by which corners of feet may be in the ground at nodes, m; of jumps in space
    shank_height : of links to which feet are fixed, m over the ground, in jumps in space; 0 for no rows
        Most robots' shanks are high enough without.
    tilt : of the middle one of the base's angles, at most, rad; of jumps in space
    inside : least share of a sole's vertical force on each of its points; of jumps in space
        Where one bears nothing the sole's centre of pressure is on its edge, and beyond it between nodes.
    most_excess : by how many times a limit is taken that the next program allows for at once
        With 1 it hardly is stricter, and forces are pressed inwards only where more nodes have not mended the balance:
        stances between fixed ends have little to give.
    """

    torque: float
    velocity: float
    friction: float
    refinement: float = 1.0
    clearance: float = 0.0
    range: float = 0.1
    reserve: float = RESERVE
    least_force: float = 0.05
    rotated_landing: bool = False
    lift: float = FOOT_LIFT
    dip: float = POINT_FEET / 2
    shank_height: float = 0.0
    tilt: float = math.inf
    inside: float = 0.05
    most_excess: float = 1.25

    def tightened(self, request: JumpRequest, figures: Mapping[str, float]) -> NodeMargins:
        """More nodes, and less of what the figures of a check show too much of."""

        def share(name: str, used: float) -> float:
            over = figures.get(name, 0.0) / FIGURES[name].limit_of(request)
            if over <= 1:
                return used
            return used * 0.97 / min(over, self.most_excess)  # a little less than what would just do

        torque = min(share(name, self.torque) for name in ("torque", "torque_speed", "held_torque"))
        friction = share("friction", self.friction)
        # In space forces stay inside their cones; what these cannot bear is out of balance.
        is_out_of_balance = figures.get("residual", 0.0) > FIGURES["residual"].limit_of(request)
        if is_out_of_balance or figures.get("slip", 0.0) > FIGURES["slip"].limit_of(request):
            friction *= max(0.85, 0.97 / self.most_excess)  # where forces leave the cone between nodes
        # What bears next to nothing leaves it first: as much of the weight as jumps in a plane begin with is on a foot.
        # A sole's pressure leaves it likewise: its bounds move further inside.
        is_stricter = self.most_excess > 1.0 or self.refinement > 1.0
        inwards = 0.05 if is_out_of_balance and is_stricter else 0.0
        touchdown = figures.get("touchdown", 0.0)
        # Where it lands rotated, the rows come first.
        too_low = max(0.0, -figures.get("ground", 0.0), -touchdown if self.rotated_landing else 0.0)
        too_deep = max(0.0, FIGURES["feet"].limit_of(request) - figures.get("feet", 0.0))
        too_near = min(figures.get("obstacles", 0.0), figures.get("self_distance", 0.0), 0.0)
        return replace(
            self,
            torque=torque,
            velocity=share("velocity", self.velocity),
            friction=friction,
            refinement=1.4 * self.refinement,
            clearance=self.clearance + 1.5 * too_low,  # since the deepest point moves with the clearance
            reserve=self.reserve - too_near,
            lift=self.lift + 1.5 * too_deep,
            dip=max(0.0, self.dip - 1.5 * too_deep),
            least_force=max(self.least_force, inwards) + max(0.0, -figures.get("pull", 0.0)),
            rotated_landing=self.rotated_landing or touchdown < 0.0,
            inside=self.inside + inwards,
        )


def solve_in_rounds(
    first: JumpProgram, guess: Array, previous: JumpProgram | None = None
) -> tuple[JumpProgram, JumpSolution]:
    """Solve from a guess; again with rows for what the solution violates, until nothing is.

    Those are distances that are too small, where either way around is tried, and what else should have been a row. A
    solution whose distances fall short is where the next program begins, in which the shortfall costs more.

    Parameters
    ----------
    first : JumpProgram
    guess : (size,)
    previous : the program that the guess comes from, or one that failed
        Its distances and rows are required from the start.

    Returns
    -------
    program : the last
    solution : its own; not ``is_motion`` where something is violated
    """
    rounds = 8  # [-] at most after the first program
    least_progress = 0.7  # [-] of the shortfall is left by the next program at most, or no other is tried
    program = first
    if previous is not None and (previous.separation.lines or previous.node_rows.extra != ExtraRows()):
        separation = replace(first.separation, lines=previous.separation.lines).at(first.node_rows, first.motion(guess))
        program = first.extended(separation, previous.node_rows.extra)
    solution = program.solve(guess)
    for _ in range(rounds):
        if solution.overloaded:
            overloaded = ExtraRows(solution.overloaded)
            program = first.extended(program.separation, program.node_rows.extra | overloaded)
            solution = program.solve(first.resampled(solution, first.phases))
            continue
        shortfall = solution.shortfall
        if shortfall == np.inf:
            break
        start = first.resampled(solution, first.phases)
        wider = program.separation.wider(first.node_rows, first.motion(start), shortfall)
        motion = (solution.y, solution.v, solution.a)
        missing_rows = program.node_rows.missing_rows(motion, solution.forces, solution.factor)
        if not wider and missing_rows == ExtraRows():
            break
        extra = program.node_rows.extra | missing_rows
        candidates: list[tuple[JumpProgram, JumpSolution]] = []
        for separation in wider or [program.separation]:
            other = first.extended(separation, extra)
            candidates.append((other, other.solve(start)))
            if candidates[-1][1].is_motion:
                break
        program, solution = min(candidates, key=lambda candidate: candidate[1].shortfall)
        if shortfall > TOLERATED_SHORTFALL and solution.shortfall > least_progress * shortfall:
            break
    return program, solution


def solved_again(
    finer: JumpProgram, program: JumpProgram, solution: JumpSolution
) -> tuple[JumpProgram, JumpSolution] | None:
    """Return a finer program and its solution from that of another one; None where it has none."""
    solved = solve_in_rounds(finer, finer.resampled(solution, program.phases), program)
    return solved if solved[1].is_motion else None


Program = TypeVar("Program")
Solution = TypeVar("Solution")
Result = TypeVar("Result")


def refined_until_checked(
    margins: NodeMargins,
    request: JumpRequest,
    solved: tuple[Program, Solution],
    program_of: Callable[[NodeMargins], Program],
    complete: Callable[[Program, Solution], tuple[Result, Mapping[str, float] | None]],
    again: Callable[[Program, Program, Solution], tuple[Program, Solution] | None],
) -> Result:
    """Return the result of a solution; where its check fails, of one with more nodes, and stricter margins.

    Parameters
    ----------
    margins : of the program that is solved
    request : JumpRequest
    solved : that program, and its solution
    program_of : the same program with other margins
    complete : the result of a solution; and figures of its check, none where it came to no check, or None
        where nothing is to be mended: it holds, or more nodes do not help
    again : a program with its solution, from a coarser one and its solution; None where it has none
    """
    result, figures = complete(*solved)
    for _ in range(CORRECTIONS):
        if figures is None:
            break
        margins = margins.tightened(request, figures)
        refined = again(program_of(margins), *solved)
        if refined is None:
            break
        solved = refined
        result, figures = complete(*solved)
    return result


def saying_on(failed: Jump, say: Callable[[str], None]) -> Callable[[str], None]:
    """Return what says words of a search that goes on after a jump near one at hand, which failed: with its reason."""
    return lambda words: say(f"{NEAR_FAILED}. {failed.explanation} Searching on: {words}")
