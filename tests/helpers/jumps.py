"""Problems of jumps for tests, and one jump that many of them look at."""

import inspect
import math
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from once import made_once
from places import PROBLEMS, ROOT

import floatplan as fp
from floatplan.arrays import Array
from floatplan.jumps import planner as planner_in_a_plane
from floatplan.jumps.jump import Jump
from floatplan.jumps.launches import in_space
from floatplan.jumps.planner import MARGINS, jump
from floatplan.jumps.planner import checked_jump as checked_jump_in_plane
from floatplan.jumps.rounds import solve_in_rounds
from floatplan.jumps.setup import Setup, jump_setup
from floatplan.jumps.spatial import planner as planner_in_space
from floatplan.jumps.spatial import stance_search
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.jump import SpatialJump
from floatplan.jumps.spatial.planner import Start, checked_jump, jump_of_solution, solved_start
from floatplan.jumps.spatial.setup import SpatialSetup, spatial_setup
from floatplan.problem.file import as_problem, problem_text
from floatplan.simulation import jump_replay

SOLUTIONS = ROOT / "tests" / "jumps" / "cases"  # variables of programs, by the names of their problem files
BACKFLIP = "go2_backflip"  # in a plane
SEARCH_ANEW = "python tests/helpers/jumps.py searches anew"
COARSE = replace(planner_in_space.MARGINS, refinement=0.6)  # fewer nodes than usual take less time
# Programs of which there are solutions, with their margins: their checks hold at once. Between so few nodes joints of
# the G1, of which one sole stands, go beyond their ranges by a hundredth where these are 0.1 rad narrower at nodes.
# An A1 that jumps down is out of balance between fewer nodes than it has here.
STORED = {
    "go2_roll": COARSE,
    "g1_side_flip": replace(COARSE, range=0.12),
    "a1_down": replace(COARSE, refinement=0.7),
    "a1_down_high": COARSE,
}
GO2 = "example-robot-data:go2_description/urdf/go2.urdf"


@cache
def go2() -> fp.Robot:
    """A Go2 whose left and right legs move alike."""
    return fp.Robot.from_urdf(GO2, coupled="mirror", reference="standing")


def go2_problem(turns: int = -1) -> fp.Problem:
    """A Go2 that stands, turns so many times in flight, and stands."""
    robot = go2()
    standing = np.array(robot.resting)
    return fp.Problem(
        robot,
        fp.Posture(0.0, standing),
        fp.Posture(2 * math.pi * turns, standing),
        fp.Flight(0.4, angular_momentum="free", takeoff=fp.Takeoff("RL_foot")),
        fp.Motion(objective="torque"),
        fp.Limits(velocity="urdf", torque="urdf"),
        name="go2",
        jump=fp.JumpRequest(),
    )


def backflip() -> Jump:
    """The Go2's backflip: its program is solved from where a search ended, in a third of the time of that search."""

    def made() -> Jump:
        setup = setup_of_backflip()
        solved = solve_in_rounds(setup.program(MARGINS).warm(), stored_solution(BACKFLIP))
        assert solved[1].is_motion, f"the program has another solution now: {SEARCH_ANEW}"
        return checked_jump_in_plane(setup, solved, lambda margins: setup.program(margins).warm(), 0, lambda _: None)

    found: Jump = made_once("backflip of a Go2", made)
    return found


def setup_of_backflip() -> Setup:
    """The setup of the Go2's backflip."""
    problem = go2_problem()
    assert problem.jump is not None
    return jump_setup(problem, problem.jump)


def backflip_on_points() -> Jump:
    """The same, on feet that are points."""
    found: Jump = made_once("points", lambda: jump(go2_problem(), fp.JumpRequest(feet="points"), starts=1))
    return found


def planned_jump(name: str) -> Jump:
    """The jump of a problem file, by its path in ``problems/jumps/`` without the ending."""
    return jump_once(PROBLEMS / "jumps" / f"{name}.toml")


def find_jumps_once(patch: pytest.MonkeyPatch) -> None:
    """Let commands, ``init`` and Python find by :func:`jump_once` what they search for in this process."""
    for place in ("floatplan.jump", "floatplan.jumps.planner.jump", "floatplan.initial.flight.jump"):
        patch.setattr(place, jump_once)


def jump_once(problem: fp.Problem | str | Path, request: fp.JumpRequest | None = None, **options: Any) -> Jump:
    """What ``fp.jump`` returns; where any test has had the same problem, without a search and words about it.

    That of a robot whose legs are coupled is searched for on fewer nodes than usual: tests of what a search on the
    usual ones promises call ``fp.jump`` themselves.
    """
    given = inspect.signature(jump).bind(problem, request, **options)
    given.apply_defaults()
    if given.arguments["near"] is not None:
        return _searched(problem, request, **options)
    problem = as_problem(problem)
    options_asked = [given.arguments[name] for name in ("request", "seed", "starts", "helps")]
    if problem.robot.base == "free-flyer":  # on as many nodes as a test sets
        options_asked.append(planner_in_space.MARGINS)
    digest = sha256(f"{problem_text(problem, '/problem.toml')} {options_asked}".encode()).hexdigest()
    found: Jump = made_once(f"jump {digest}", lambda: _searched(problem, request, **options))
    return found


def _searched(problem: fp.Problem | str | Path, request: fp.JumpRequest | None, **options: Any) -> Jump:
    """What ``fp.jump`` returns; of legs in pairs, on fewer nodes than usual, by which chains gain nothing.

    On fewer nodes no jump down from a box is found, and one that begins in motion only after a longer search.
    """
    problem = as_problem(problem)
    asked = request or problem.jump or fp.JumpRequest()
    with pytest.MonkeyPatch.context() as patch:
        if problem.robot.coupled and not asked.takeoff.height and not asked.takeoff.in_motion:
            plan_on_fewer_nodes_in_a_plane(patch)
        return jump(problem, request, **options)


def plan_on_fewer_nodes(patch: pytest.MonkeyPatch, share: float = 0.6) -> None:
    """Let programs of jumps in space, and of stances there, begin on such a share of their usual nodes."""
    patch.setattr(planner_in_space, "MARGINS", replace(planner_in_space.MARGINS, refinement=share))
    coarse = replace(stance_search.MARGINS, refinement=share)
    patch.setattr(in_space, "planned_stance", partial(stance_search.planned_stance, margins=coarse))


def plan_on_fewer_nodes_in_a_plane(patch: pytest.MonkeyPatch) -> None:
    """Let programs of jumps in a plane begin on fewer nodes, which takes a third to two thirds of the time."""
    patch.setattr(planner_in_a_plane, "MARGINS", replace(planner_in_a_plane.MARGINS, refinement=0.6))


def try_few_gains(patch: pytest.MonkeyPatch, multiples: tuple[float, ...] = (1.1, 1.0)) -> None:
    """Let a search for gains try few of them, with bodies of one mass: each is flown four times, not eight."""
    patch.setattr(jump_replay, "MULTIPLES", multiples)
    patch.setattr(jump_replay, "MASSES", (1.05,))


def stored_jump(name: str) -> SpatialJump:
    """The jump of a problem file in space whose program's solution is in a file: flight, stances and check are anew."""
    return _completed(name)[0]


def violated_row(name: str) -> tuple[float, str]:
    """By how much that solution violates a row of the program as it is now, and which it is."""
    return _completed(name)[1]


def roll() -> SpatialJump:
    """The Go2's roll, in space, from its right legs to its left ones."""
    return stored_jump("go2_roll")


def _completed(name: str) -> tuple[SpatialJump, tuple[float, str]]:
    def made() -> tuple[SpatialJump, tuple[float, str]]:
        setup = setup_in_space(name)
        program = setup.program(STORED[name])
        raw = stored_solution(name)
        assert raw.shape == (program.size,), f"the program has other variables now: {SEARCH_ANEW}"
        solution = program.solution(raw, iterations=0, converged=True)
        return jump_of_solution(setup, program, solution, seed=0), solution.worst

    found: tuple[SpatialJump, tuple[float, str]] = made_once(f"stored {name}", made)
    return found


def stored_solution(name: str) -> Array:
    """The variables (size,) of a program that was solved."""
    solution: Array = np.load(SOLUTIONS / f"{name}.npy")
    return solution


def searched_roll() -> tuple[SpatialJump, int]:
    """The roll as a search finds it, and its iterations: half of the daily tests of jumps would wait for it."""

    def made() -> tuple[SpatialJump, int]:
        start = search("go2_roll")
        return checked_jump(start, seed=0), start.solution.iterations

    found: tuple[SpatialJump, int] = made_once("searched roll", made)
    return found


def search(name: str) -> Start:
    """Where the search of such a program ends, on few nodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner_in_space, "MARGINS", STORED[name])
        return solved_start(setup_in_space(name), seed=0, number=0)


def coarse_quarter_turn() -> Array:
    """Where the first stage of a search on hardly any nodes ends, as its program's variables (size,)."""
    setup = setup_in_space("go2_quarter_turn")
    program = setup.program(replace(COARSE, refinement=0.15))
    return program.solve(guess(program), tight_solves=0).raw


@cache
def setup_in_space(name: str) -> SpatialSetup:
    """The setup of a problem file, by its name in ``problems/jumps/space/``, with the expressions that it has made."""
    problem = fp.load_problem(PROBLEMS / "jumps" / "space" / f"{name}.toml")
    assert problem.jump is not None
    return spatial_setup(problem, problem.jump)


if __name__ == "__main__":
    for name in STORED:
        start = search(name)
        assert start.solution.converged, name
        np.save(SOLUTIONS / f"{name}.npy", start.solution.raw)
    first = setup_of_backflip().program(MARGINS)
    program, solution = solve_in_rounds(first, first.guess())
    assert solution.is_motion, BACKFLIP
    np.save(SOLUTIONS / f"{BACKFLIP}.npy", program.resampled(solution, program.phases))
