"""A whole jump: stance, flight, stance, found by one program, with its flight planned and its stances made exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from floatplan.arguments import SEED, made, numbers, optional, whole
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.plans.plan import Plan
from floatplan.pool.threads import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.stance import in_file
from floatplan.stance.check import JumpCheck, check_jump
from floatplan.stance.exact import exact_side
from floatplan.stance.flight import flight_problem, planned_flight, takeoff_place
from floatplan.stance.model import casadi
from floatplan.stance.motion import JumpState, Stance, flight_state, joined
from floatplan.stance.program import JumpProgram, Solution
from floatplan.stance.request import JumpRequest
from floatplan.stance.setup import Room, Setup, jump_setup
from floatplan.tables import Range

ROOM = Room(0.9, 0.97, 0.7, 4)  # of the first program; the next depends on what its jump breaks
CORRECTIONS = 2  # [-] programs after the first
FINER = 1.4  # [-] times the nodes in each
STRICTER = 0.97  # [-] beyond what a figure shows
STARTS = 4
MOST_STARTS = Range(1, 1000, "")


@dataclass(frozen=True)
class JumpPhase:
    """A time of a jump in which contacts do not change.

    Attributes
    ----------
    kind : "stance" or "flight"
    contacts : names of all points that stand, followers' too
    begin, end : s, from the jump's start
    """

    kind: str
    contacts: tuple[str, ...]
    begin: float
    end: float


@dataclass(frozen=True, eq=False, repr=False)
class Jump:
    """A jump from standing to standing.

    Attributes
    ----------
    problem : Problem, as given
    request : JumpRequest
    status : "found" or "not_found"
    explanation : sentences for a person
    flight : the Plan in its middle, whose t = 0 is the takeoff; None where nothing was found
    before, after : stances of takeoff and landing, in order of time
    """

    problem: Problem
    request: JumpRequest
    status: str
    explanation: str
    flight: Plan | None = None
    before: tuple[Stance, ...] = ()
    after: tuple[Stance, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether a jump was found, and its stances passed the check."""
        return self.status == "found" and self.check.ok

    @cached_property
    @one_thread
    def check(self) -> JumpCheck:
        """The stances, judged at 2 kHz; see :func:`floatplan.stance.check.check_jump`."""
        if self.flight is None:
            return JumpCheck(False, {}, ("no jump was found",))
        return check_jump(self)

    @property
    def stances(self) -> tuple[Stance, ...]:
        """All stances."""
        return (*self.before, *self.after)

    @property
    def takeoff_time(self) -> float:
        """When the flight begins, s from the jump's start."""
        return self.before[-1].span[1] if self.before else 0.0

    @property
    def duration(self) -> float:
        """From standing to standing, s."""
        return self.after[-1].span[1] if self.after else 0.0

    @property
    def phases(self) -> tuple[JumpPhase, ...]:
        """Phases in order of time."""
        if self.flight is None:
            return ()
        before, after = (
            [JumpPhase("stance", tuple(n for c in each.contacts for n in c.names), *each.span) for each in side]
            for side in (self.before, self.after)
        )
        flight = JumpPhase("flight", (), self.takeoff_time, self.takeoff_time + self.flight.duration)
        return (*before, flight, *after)

    @one_thread
    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; at a change of contacts that of the phase before.

        Raises
        ------
        InputError
            A time is not a number or lies outside the jump; or no jump was found.
        """
        instants = np.atleast_1d(np.asarray(numbers(times, "times"), dtype=np.float64)).ravel()
        if self.flight is None:
            raise InputError("no jump was found", element="times")
        if not ((instants >= 0) & (instants <= self.duration)).all():
            raise InputError(f"a time lies outside the jump, [0, {self.duration:g}] s", element="times")
        phases = self.phases
        index = np.searchsorted([phase.end for phase in phases[:-1]], instants)
        stances = iter(self.stances)
        parts = []
        for number, phase in enumerate(phases):
            stance = None if phase.kind == "flight" else next(stances)
            chosen = np.flatnonzero(index == number)
            if len(chosen):
                within = instants[chosen]
                state = stance.at(within) if stance else flight_state(self.flight, within, self.takeoff_time)
                parts.append((chosen, state))
        return joined(instants, parts, [name for phase in phases for name in phase.contacts])

    def q(self, times: npt.ArrayLike) -> Array:
        """Configuration (..., nq) as of :meth:`floatplan.Plan.q`, m and rad; times as of :meth:`at`, of any shape."""
        return self._in_file(times, in_file.configurations)

    def v(self, times: npt.ArrayLike) -> Array:
        """Velocity (..., nv), m/s and rad/s, as of :meth:`floatplan.Plan.v`."""
        return self._in_file(times, in_file.velocities)

    def a(self, times: npt.ArrayLike) -> Array:
        """Acceleration (..., nv), m/s^2 and rad/s^2, as of :meth:`floatplan.Plan.a`."""
        return self._in_file(times, in_file.accelerations)

    def tau(self, times: npt.ArrayLike) -> Array:
        """Torques (..., nv), N m: 0 on the base, then each joint's own, also of followers and locked ones."""
        return self._in_file(times, in_file.torques)

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Forces (..., 3), N, in the world's axes, of every point that stands at some time; zero where it does not."""
        found = in_file.forces(self.problem.robot, self.at(times))
        return {name: values.reshape(*np.shape(times), 3) for name, values in found.items()}

    def _in_file(self, times: npt.ArrayLike, quantity: Callable[[Robot, JumpState], Array]) -> Array:
        values = quantity(self.problem.robot, self.at(times))
        return values.reshape(*np.shape(times), values.shape[1])

    def save(self, path: str | Path) -> Path:
        """Write ``jump.json``; see :mod:`floatplan.stance.jump_file`."""
        from floatplan.stance.jump_file import save_jump  # it reads jumps too

        return save_jump(self, path)

    def __repr__(self) -> str:
        checked = "" if self.flight is None else f", stances {'checked' if self.check.ok else 'not within limits'}"
        return f"Jump({self.status}{checked}, {self.duration:.3g} s)\n  {self.explanation[:300]}"


@one_thread
def jump(
    problem: Problem | str | Path,
    request: JumpRequest | None = None,
    *,
    seed: int = 0,
    starts: int = STARTS,
    progress: Callable[[str], None] | None = None,
) -> Jump:
    """Plan a whole jump: from standing through a flight to standing again.

    The goal's orientation fixes the whole turns; postures, durations and momentum of the flight are optimised unless
    the request fixes them. The sum of the motors' squared torques is least.

    Parameters
    ----------
    problem : Problem, or path of a problem file
    request : JumpRequest, optional
    seed : int
        Of the starts after the first, which is generic, and of the flight's plan.
    starts : int
        How many are tried, until one is found.
    progress : callable, optional
        Told in a few words what is done.

    Returns
    -------
    Jump
        Always: ``ok``, ``status``, ``explanation``.

    Raises
    ------
    InputError
        The problem or the request is wrong, nothing can stand as asked, or CasADi is not installed.
    """
    casadi()
    problem = given_problem(problem)
    request = optional(made(JumpRequest))(request, "request") or JumpRequest()
    seed, starts = SEED(seed, "seed"), whole(MOST_STARTS)(starts, "starts")
    say = progress or (lambda _: None)
    setup = jump_setup(problem, request)
    best: tuple[float, str] = (np.inf, "")
    answer: Jump | None = None
    program = setup.program(ROOM)
    for start in range(starts):
        say(f"start {start + 1} of {starts}")
        rng = np.random.default_rng((seed, start)) if start else None
        solution = program.solve(program.guess(rng))
        if not solution.converged:
            best = min(best, solution.worst)
            continue
        answer = _corrected(setup, program, solution, seed)
        if answer.ok:
            return answer
    if answer is not None:
        return answer
    return Jump(
        problem,
        request,
        "not_found",
        f"No jump was found in {starts} starts: {best[1]} stands in the way, by {best[0]:.2g}.",
    )


def _corrected(setup: Setup, program: JumpProgram, solution: Solution, seed: int) -> Jump:
    """The jump of a solution, or of one with more nodes, stricter where the check fails."""
    room, answer = ROOM, completed(setup, program, solution, seed)
    for _ in range(CORRECTIONS):
        if answer.ok:
            break
        room = _stricter(room, answer)
        finer = setup.program(room)
        again = finer.solve(finer.resampled(solution, program.phases))
        if not again.converged:
            break
        program, solution = finer, again
        answer = completed(setup, program, solution, seed)
    return answer


def _stricter(room: Room, answer: Jump) -> Room:
    """More nodes, and less of what the check finds too much of."""
    margin, figures = answer.request.margin, answer.check.figures

    def share(name: str, limit: float, now: float) -> float:
        over = figures.get(name, 0.0) / limit
        return now if over <= 1 else now * STRICTER / min(over, 1.25)

    torque = min(share("torque", margin["torque"], room.torque), share("torque_speed", margin["torque"], room.torque))
    velocity = share("velocity", margin["velocity"], room.velocity)
    friction = share("friction", answer.request.friction, room.friction)
    return Room(torque, velocity, friction, 2 * room.directions, FINER * room.finer)


def completed(setup: Setup, program: JumpProgram, solution: Solution, seed: int) -> Jump:
    """Return the jump of a solution: its flight planned, its stances exact from the flight's ends."""
    problem, request = setup.problem, setup.request
    try:
        plan = planned_flight(flight_problem(problem, program, solution), seed)
    except InputError as error:
        return Jump(problem, request, "not_found", f"The flight between the stances cannot be planned: {error}")
    if not plan.ok:
        return Jump(problem, request, "not_found", f"No flight between the stances was found: {plan.explanation}")
    sides = {side: exact_side(program, solution, plan, side) for side in ("takeoff", "landing")}
    model = program.model
    end = plan.at(plan.duration)
    landing = program.phases[program.flight + 1].anchor
    tree, (body, local) = model.robot.tree, landing.spots[0]
    turned = tree.rotations(tree.absolute_angles(np.asarray(end.orientation), end.positions))
    from_com = turned @ tree.point_weights(np.array([body]), np.array([local], np.complex128))[0]
    places = {"takeoff": takeoff_place(program, solution), "landing": complex(*end.com_position) + complex(from_com)}
    stances = {
        side: tuple(
            Stance(model.robot, model.gravity, phase.contacts, places[side], grid)
            for phase, grid in zip([each for each in program.phases if each.side == side], sides[side], strict=True)
        )
        for side in sides
    }
    found = Jump(problem, request, "found", "", plan, stances["takeoff"], stances["landing"])
    return replace(found, explanation=_explained(found))


def _explained(found: Jump) -> str:
    if found.check.ok:
        return "The stances hold at 2 kHz."
    return f"The stances do not hold between the program's nodes: {found.check.sentences[0]}."
