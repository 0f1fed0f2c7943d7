"""Whether a robot can bring itself to a plan's takeoff, or to rest after its landing: the least limits that do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from floatplan.arguments import SEED, made, one_of, optional, whole
from floatplan.arrays import Array
from floatplan.plans.plan import Plan, given_plan
from floatplan.pool.threads import one_thread
from floatplan.problem.jump import JumpRequest
from floatplan.stance.check import ROUNDING, judged, stance_figures
from floatplan.stance.contacts import Watched, heights_over_com
from floatplan.stance.exact import exact_stances
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.model import PlanarModel, casadi
from floatplan.stance.motion import Stance, flight_state
from floatplan.stance.program import FASTEST_TURN, JumpProgram, Solution, ipopt, roughness
from floatplan.stance.rows import Bound, NodeRows, Rows
from floatplan.stance.separation import Separation
from floatplan.stance.setup import Room, Setup, corrected, side_setup
from floatplan.tables import Range

STARTS = 3
MOST_STARTS = Range(1, 1000, "")
ROOM = Room(1.0, 1.0, 0.6, 4, 1.1)  # of the nodes: limits are those of the factor
AT_REST = 1e-6  # [m/s; over the time unit m/s^2] of the frame in flight
RANGE_ROOM = 0.02  # [rad] inside joint ranges, unless the flight's end is nearer to theirs
LIMITED = ("torque", "rates")  # how labels of what is divided by the factor begin
MOST = 20.0  # [-] the largest factor that is looked for
WORDS = {"torque": "torque of {}", "torque_speed": "torque-speed curve of {}", "velocity": "{}'s rate"}
SMOOTH_STEPS = 1e-5  # [-] of steps of accelerations beside the factor
SMOOTH = 1e-3  # [-] of squared torques beside the factor


@dataclass(frozen=True, eq=False)
class Launch:
    """A stance from rest to a takeoff, or from a landing to rest, with the least common factor on the limits.

    Attributes
    ----------
    ok : whether one was found within the limits, and holds at 2 kHz
    ratio : largest share of its limits that a torque or rate takes; infinite where none was found
    limit : "torque", "torque_speed" or "velocity": which share that is; "" where there is none
    joint : the motor whose share it is; "" where there is none
    sentences : for a person
    figures : as of :class:`floatplan.stance.check.JumpCheck`
    impossible : whether it is shown that there is none, because of what the flight itself asks
    """

    ok: bool
    ratio: float
    limit: str
    joint: str
    sentences: tuple[str, ...]
    figures: dict[str, float]
    impossible: bool = False


class _FactorRows(Rows):
    """Rows in which limits are multiplied by a factor."""

    def __init__(self, factor: Any) -> None:
        super().__init__()
        self.factor = factor

    def add(self, value: Any, low: float, high: float, label: str) -> None:
        if not label.startswith(LIMITED):
            super().add(value, low, high, label)
            return
        for sign in (1.0, -1.0):
            super().add(self.factor + sign * casadi().vec(value), 0.0, np.inf, label)

    def add_nodes(self, values: Any, bounds: Sequence[Bound], low: Array, high: Array, side: str) -> None:
        limited = [row for row, bound in enumerate(bounds) if bound[2].startswith(LIMITED)]
        if not limited:
            super().add_nodes(values, bounds, low, high, side)
            return
        nodes = np.flatnonzero(np.isfinite(high[limited]).all(axis=0)).tolist()
        self.add(values[limited, nodes], -1.0, 1.0, f"{LIMITED[0]} ({side})")
        low[limited], high[limited] = -np.inf, np.inf
        super().add_nodes(values, bounds, low, high, side)


@dataclass(frozen=True, eq=False)
class Meeting:
    """What a flight's end asks of a stance beside the posture.

    Attributes
    ----------
    rates : (n+1,) y', rad/s, where the frame is at rest; else nothing is asked of them
    accelerations : (n+1,) y'', rad/s^2, where the frame does not accelerate either
    flown : h, horizontal and vertical velocity of the centre of mass, kg m^2/s and m/s
    """

    rates: Array | None
    accelerations: Array | None
    flown: tuple[float, float, float]


class LaunchProgram(JumpProgram):
    """The program of one side's stances, whose least value is the factor; its last variable is that instead of h.

    Parameters
    ----------
    node : NodeRows, its ends the standing posture and the posture in flight, in order of time
    state : Meeting
    """

    def __init__(self, node: NodeRows, state: Meeting) -> None:
        super().__init__(node, Separation(node.model.robot))
        self._state = state
        self._seam = -1 if self.phases[0].side == "takeoff" else 0

    @cached_property
    def _scales(self) -> list[float]:
        return [*JumpProgram._scales.func(self)[:-1], 1.0]  # type: ignore[attr-defined]

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        sides = [self.split(side) for side in JumpProgram._box.func(self)]  # type: ignore[attr-defined]
        fast = np.append(FASTEST_TURN, MOST * self.node.bounds.velocity)[:, None]
        reached, edges = np.sort(self.ends, axis=0), self.node.bounds.position.T
        for sign, parts, edge, end in zip((-1.0, 1.0), sides, edges, reached, strict=True):
            nearer = np.maximum if sign > 0 else np.minimum
            parts[0][1:, 1:-1] = nearer(edge - sign * RANGE_ROOM, end[1:])[:, None]
            rest = parts[1][:, [-1 - self._seam]]
            parts[1][:] = sign * fast
            parts[1][:, [-1 - self._seam]] = rest
            parts[2][:, self._seam] = sign * np.inf
            for part, given in ((1, self._state.rates), (2, self._state.accelerations)):
                if given is not None:
                    parts[part][:, self._seam] = given
            parts[-1][:] = 0.0 if sign < 0 else MOST
        return self.join(sides[0]), self.join(sides[1])

    @cached_property
    def _solver(self) -> tuple[Any, Any, Rows]:
        ca = casadi()
        raw = ca.MX.sym("w", sum(rows * columns for rows, columns in self._shapes))
        y, v, a, *rest = self.split(raw)
        count = len(self.phases)
        forces, drifts, durations, factor = rest[:count], rest[count:-2], rest[-2], rest[-1]
        rows, total, rough = _FactorRows(factor), 0.0, 0.0
        for index, phase in enumerate(self.phases):
            if phase.side == "flight":
                continue
            nodes = slice(int(self.starts[index]), int(self.starts[index + 1]) + 1)
            parts = [each[:, nodes] for each in (y, v, a)]
            step = durations[index] * ca.DM(np.diff(phase.shares)).T
            cost = self._add_phase(rows, phase, parts, step, (forces[index], drifts[index]))
            self._add_rates(rows, [each[1:, :] for each in parts], step, phase.side)
            self._add_node_rates(rows, parts[1][1:, :], phase.side)
            total += ca.dot(step, (cost[:, :-1] + cost[:, 1:]) / 2)
            rough += roughness(parts, self.node.unit)
        if self._state.rates is None:
            self._add_state(rows, [each[:, self._seam] for each in (y, v, a)])
        goal = factor + SMOOTH * total / self.node.unit + SMOOTH_STEPS * rough
        return *ipopt(raw, goal, rows), rows

    def _add_node_rates(self, rows: Rows, rates: Any, side: str) -> None:
        fastest = self.node.bounds.velocity
        limited = np.flatnonzero(np.isfinite(fastest)).tolist()
        if limited:
            shares = casadi().mtimes(casadi().DM(np.diag(1 / fastest[limited])), rates[limited, :])
            rows.add(shares, -1.0, 1.0, f"rates ({side})")

    def guess(self, rng: np.random.Generator | None = None) -> Array:
        """From one end straight to the other; with random numbers perturbed."""
        durations = np.array([phase.duration for phase in self.phases])
        share = np.linspace(0.0, 1.0, self.nodes)
        share = share**2 * (3 - 2 * share)
        y = self.ends[0][:, None] + (self.ends[1] - self.ends[0])[:, None] * share
        if rng is not None:
            low, high = (np.array([phase.bounds[side] for phase in self.phases]) for side in (0, 1))
            durations = np.clip(durations * rng.uniform(0.75, 1.35, len(durations)), low, high)
            y[1:] += rng.uniform(-0.4, 0.4, (self.size - 1, 1)) * np.sin(np.pi * share)
        rest = [np.zeros(shape) for shape in self._shapes[3:-2]]
        return self.join([y, 0 * y, 0 * y, *rest, durations[:, None], np.ones((1, 1))])

    def _add_state(self, rows: Rows, state: Sequence[Any]) -> None:
        """Momentum and velocity of the centre of mass where the flight begins or ends."""
        model, node = self.model, self.node
        anchor = self.phases[-2 if self._seam else 1].anchor
        found = rows.calls(model.function("seam", [model.momentum(), *model.com_from(anchor.spots[0], 1)]), *state)
        scales = (node.momentum, node.model.gravity * node.unit, node.model.gravity * node.unit)
        for value, given, scale in zip(found, self._state.flown, scales, strict=True):
            rows.add((value - given) / scale, 0.0, 0.0, "velocity and momentum of the flight")


@one_thread
def launch(
    plan: Plan | str | Path,
    request: JumpRequest | None = None,
    *,
    end: Literal["takeoff", "landing"] = "takeoff",
    seed: int = 0,
    starts: int = STARTS,
) -> Launch:
    """Find the stance from rest that reaches a plan's takeoff with the least common factor on torque and rate limits.

    Posture, angular momentum and velocity of the centre of mass are the plan's; the joints' rates too, where its frame
    is at rest then, else those with which it is. Obstacles are not looked at. Contacts and friction are those of the
    request, else of the problem's jump, else the usual ones; margins do not count.

    Parameters
    ----------
    plan : Plan, or path of a plan file
    request : JumpRequest, optional
    end : "takeoff", or "landing": from the plan's landing to rest
    seed : of the starts after the first
    starts : how many are tried; the best counts

    Returns
    -------
    Launch
        Not ``ok`` is "none was found", never "there is none".

    Raises
    ------
    InputError
        The plan or the request is wrong, nothing can stand as asked, or CasADi is not installed.
    """
    casadi()
    plan = given_plan(plan)
    request = optional(made(JumpRequest))(request, "request") or plan.problem.jump or JumpRequest()
    end = one_of("takeoff", "landing")(end, "end")
    seed, starts = SEED(seed, "seed"), whole(MOST_STARTS)(starts, "starts")
    margins = replace(request, margin=dict.fromkeys(request.margin, 1.0))
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    setup = side_setup(plan.problem, margins, end, np.append(state.orientation, state.positions))
    met = _meeting(plan, setup, end)

    def program(room: Room) -> LaunchProgram:
        return LaunchProgram(_reaching(setup.node(room), end), met)

    best: tuple[float, Solution | None] = (np.inf, None)
    first = program(ROOM)
    for start in range(starts):
        rng = np.random.default_rng((seed, start)) if start else None
        solution = first.solve(first.guess(rng))
        if solution.converged and solution.momentum < best[0]:
            best = (solution.momentum, solution)
        if best[0] <= 1:
            break
    if best[1] is None:
        answer = Launch(False, np.inf, "", "", (f"{end.capitalize()}: no stance was found.",), {})
    else:
        answer = corrected(ROOM, margins, (first, best[1]), program, lambda *found: _answer(plan, request, end, *found))
    shown = _shown(plan, met, end)
    standing = zip(plan.robot.joints, setup.standing[0 if end == "takeoff" else -1, 1:], strict=True)
    posture = ", ".join(f"{name} {at:.4g}" for name, at in standing)
    told = f"Friction {request.friction:g}, at rest with {posture} rad."
    return replace(answer, sentences=(*answer.sentences, *shown, told), impossible=bool(shown))


def _meeting(plan: Plan, setup: Setup, end: str) -> Meeting:
    """What a plan's takeoff or landing asks; its rates and accelerations where they are those of a foot at rest."""
    full = flight_state(plan, np.array([0.0 if end == "takeoff" else plan.duration]), 0.0)
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    anchor, gravity = setup.phases[-2 if end == "takeoff" else 1].anchor, float(plan.problem.flight.gravity)
    model, y = PlanarModel(plan.robot, gravity), np.append(state.orientation, state.positions)
    v = np.append(state.orientation_rate, state.velocities)
    a = np.append(full.accelerations[0, 2], state.accelerations)
    from_com = [model.com_from(anchor.spots[0], order) for order in (1, 2)]
    rate, change = (np.array(model.function("moves", each)(y, v, a), np.float64).ravel() for each in from_com)
    unit = np.sqrt(1.0 / gravity)
    slides = float(np.abs(rate - state.com_velocity).max())
    pushed = float(np.abs(change + np.array([0.0, gravity])).max()) * unit
    horizontal, vertical = map(float, state.com_velocity)
    rests = slides < AT_REST
    flown = (plan.angular_momentum, horizontal, vertical)
    return Meeting(v if rests else None, a if rests and pushed < AT_REST else None, flown)


def _reaching(node: NodeRows, end: str) -> NodeRows:
    """Rows in which what is watched may be as near to the ground as the flight's end has it."""
    y, anchor = node.ends[-1 if end == "takeoff" else 0], node.phases[-2 if end == "takeoff" else 1].anchor
    if not node.watched.spots:
        return node
    robot, spots = node.model.robot, [anchor.spots[0], *node.watched.spots]
    heights = heights_over_com(robot, spots, y).imag
    least = np.minimum(node.watched.least, heights[1:] - heights[0] + anchor.depth - ROUNDING)
    return NodeRows(node.model, node.phases, Watched(node.watched.spots, least), node.bounds, node.ends)


def _answer(
    plan: Plan, request: JumpRequest, end: str, program: JumpProgram, solution: Solution
) -> tuple[Launch, dict[str, float] | None]:
    """What a solution comes to; and the figures of its check where more nodes may mend what they show."""
    node = -1 if end == "takeoff" else 0
    com = complex(*plan.at(0.0 if end == "takeoff" else plan.duration).com_position)
    stances = exact_stances(program, solution, end, solution.y[:, node], float(solution.v[0, node]), com)
    sides = (stances, ()) if end == "takeoff" else ((), stances)
    motion = JumpMotion(plan.problem, request, plan, *sides)
    figures = stance_figures(motion)
    shares = {name: figures[name] for name in ("torque", "torque_speed", "velocity")}
    limit = max(shares, key=lambda name: shares[name])
    ratio = shares[limit]
    joint = _joint(plan, stances, limit)
    figures.pop("obstacles", None)  # those of a flight may be where it begins: a ground a little below its feet
    rest = {name: value for name, value in figures.items() if name not in shares}
    said, _ = judged(request, rest)
    broken = [", ".join(words) for words in said]
    named = WORDS[limit].format(joint)
    if ratio <= 1 and not broken:
        first = f"reachable, with {1 - ratio:.0%} to spare ({named})" if ratio > 0 else "reachable; nothing is limited"
    elif broken:
        first = "no stance was found that holds between the program's nodes"
    else:
        first = f"no stance was found within the limits (least factor {ratio:.2f}, {named})"
    sentences = (f"{end.capitalize()}: {first}.", *broken)
    return Launch(ratio <= 1 and not broken, ratio, limit, joint, sentences, figures), rest if broken else None


def _shown(plan: Plan, met: Meeting, end: str) -> tuple[str, ...]:
    """A sentence where the flight itself turns a joint faster there than its limit: no stance then is within limits."""
    if met.rates is None:
        return ()
    shares = np.abs(met.rates[1:]) / plan.problem.velocity_limits
    joint, most = plan.robot.joints[int(shares.argmax())], float(shares.max())
    return (f"None can be: at {end} {joint} turns at {most:.2f} of its limit whatever the stance.",) if most > 1 else ()


def _joint(plan: Plan, stances: Sequence[Stance], limit: str) -> str:
    """The motor whose share of a limit is the largest at the stances' instants."""
    problem, robot = plan.problem, plan.robot
    states = [stance.at(stance.grid.times) for stance in stances]
    torques = np.abs(np.concatenate([state.torques for state in states]) @ robot.transmission)
    joints = np.concatenate([stance.grid.v[1:].T for stance in stances])
    rates = np.abs(joints @ robot.motor_ratios.T)
    if limit == "torque":
        shares = torques / problem.motor_torque_limits
    elif limit == "torque_speed":
        shares = (torques + problem.motor_slope * rates) / problem.motor_stall
    else:
        return robot.joints[int((np.abs(joints) / problem.velocity_limits).max(axis=0).argmax())]
    return robot.motors[int(shares.max(axis=0).argmax())]
