"""Replay of whole jumps: perturbed robots fly one in MuJoCo with contact, with corrections in flight and without."""

import itertools
import math
import time as clock
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import SEED, function, made, number, optional, positive, whole
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.jumps.jump import Jump, load_jump
from floatplan.pool import one_thread
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.simulation.closed_loop import BUDGET, MOST_FLIGHTS, MOST_PERIODS
from floatplan.simulation.flown_jump import STANDING, FlownJump
from floatplan.simulation.gains import Gains, first_gains, joint_inertia
from floatplan.simulation.jump_flight import PERIOD, JumpControl
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.simulation.results import Flight, JumpLandings, JumpReplay
from floatplan.tables import Range

MULTIPLES = (1.1, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5)  # of gains
SEARCH = 977  # seed of the flights by which gains are judged
CORRECTED = 250.0  # [Hz]
TO_SPARE = 0.2  # [-] of friction
MASSES = 0.05  # [-] of all bodies together, more or less
FALLEN = 1.0  # [rad] of tilt: more is no worse
ROTORS = 2.5  # [-] armature that may be there, over the least inertia that a joint turns where the robot stands


def search_gains(jump: Jump, progress: Callable[[str, int, int], None] | None = None) -> tuple[Array, int]:
    """Return gains (2, J) with which robots land that measure late, whatever they weigh, and how many were tried.

    Low gains lag behind heavy rotors and let the robot fall, high ones ring with light rotors; what lands every robot
    that was tried may be next to either. So each of some multiples of :func:`first_gains` is flown with the extremes:
    no rotors and the heaviest, all bodies lighter and heavier, with corrections in flight and without. The answer is
    the middle of the neighbours of which each two together land most of these on their feet alone; of several such
    ranges that of most neighbours, of equals the one whose trunks stay nearest to their path from the landing on (mean
    square).
    """
    first = first_gains(jump)
    control = JumpControl(jump, first, CORRECTED)
    heaviest = ROTORS * float(joint_inertia(control.robot.model, control.wanted.positions[0]).min())
    late, friction = Perturbation(noise=math.radians(0.1), delay=4e-3), jump.request.friction + TO_SPARE
    bodies, found = np.ones(control.robot.model.njoints), []
    for trial, multiple in enumerate(MULTIPLES, start=1):
        control.gains = multiple * first
        ends = []
        for rotors, mass, correct in itertools.product((0.0, heaviest), (1 - MASSES, 1 + MASSES), (False, True)):
            chosen: dict[str, Any] = {"armature": rotors, "mass": mass * bodies, "inertia": mass * bodies}
            end = control.fly(late, friction, (SEARCH, 0), correct, **chosen).landing
            ends.append((end["stands"] and not end["touched"], -(min(end["tilt"], FALLEN) ** 2)))
        found.append(np.sum(ends, axis=0))
        if progress is not None:
            progress("gains", trial, len(MULTIPLES))
    return middle_of_the_widest(np.array(found)) * first, len(MULTIPLES)


def middle_of_the_widest(found: Array) -> float:
    """Return the middle of those multiples that land most flights, of which ``found`` (M, 2) says so; see above.

    The second column is minus the sum of squared tilts, rad^2.
    """
    pairs = found[:-1] + found[1:]
    best, ranges = pairs[:, 0].max(), []
    for is_best, group in itertools.groupby(range(len(pairs)), lambda pair: pairs[pair, 0] == best):
        if is_best:
            same = list(group)
            ranges.append((len(same), pairs[same, 1].max(), MULTIPLES[same[0]] + MULTIPLES[same[-1] + 1]))
    return float(max(ranges)[2] / 2)


@one_thread
def replay_jump(
    jump: Jump | str | Path,
    replan: float | None = None,
    *,
    perturb: str | Perturbation = "",
    flights: int = 1,
    seed: int = 0,
    friction: float | None = None,
    gains: Gains = (None, None),
    budget: float | None = BUDGET,
    progress: Callable[[str, int, int], None] | None = None,
) -> JumpReplay:
    """Fly a jump in MuJoCo with contact, from standing to a second after its end.

    Parameters
    ----------
    jump : Jump, or path of a jump file
    replan : float, optional
        Corrections in flight per second, Hz: each robot then flies with them and without.
    perturb : str or Perturbation
        Such as ``"mass=5%,friction=20%,armature=0.01,torque=5%,noise=0.1deg,delay=4ms"``. Delays are rounded to 2 ms.
    flights : int
    seed : int
        The same seed, the same flights.
    friction : float, optional
        Of the ground; left out, that of which the jump is planned.
    gains : two floats or mappings, optional
        Of all joints or of some by name: :func:`first_gains`. Without any they are searched: :func:`search_gains`.
    budget : float, optional
        Time, s, after which no new flight begins. None: no end.
    progress : callable, optional
        Told what is counted, "gains" that are searched or "flight", how many are done, and of how many.

    Raises
    ------
    InputError
        No jump was found, or its check does not hold; a number is wrong, a perturbation makes no sense, or MuJoCo is
        not installed.
    """
    began = clock.perf_counter()
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    replan = optional(positive(1 / PERIOD, "Hz"))(replan, "replan")
    seed, budget = SEED(seed, "seed"), optional(positive(unit="s"))(budget, "budget")
    progress = optional(function)(progress, "progress")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a jump's takeoff is what its stance makes of it", "leave it out")
    jump = _jump_to_fly(jump)
    friction = jump.request.friction if friction is None else number(Range(0.0, 10.0, ""))(friction, "friction")
    import_mujoco()
    chosen, tried = search_gains(jump, progress) if gains == (None, None) else (first_gains(jump, gains), 0)
    control = JumpControl(jump, chosen, replan)
    corrected: list[Flight[FlownJump]] = []
    uncorrected: list[Flight[FlownJump]] = []
    for flight in range(flights):
        if budget is not None and flight and clock.perf_counter() - began > budget:
            break
        uncorrected.append(control.fly(perturbation, friction, (seed, flight), correct=False, record=not flight))
        if replan is not None:
            corrected.append(control.fly(perturbation, friction, (seed, flight), correct=True, record=not flight))
        if progress is not None:
            progress("flight", flight + 1, flights)
    return JumpReplay(
        flights=len(uncorrected),
        asked=flights,
        seed=seed,
        perturbation=perturbation,
        friction=friction,
        period=PERIOD,
        joints=control.joints,
        kp=read_only(chosen[0]),
        kd=read_only(chosen[1]),
        tried=tried,
        rate=replan,
        uncorrected=JumpLandings.of(uncorrected),
        corrected=JumpLandings.of(corrected) if corrected else None,
        statuses=dict(sum((each.statuses for each in corrected), Counter[str]())),
        balanced=uncorrected[0].balanced,
        motion=(corrected or uncorrected)[0].motion,
        seconds=clock.perf_counter() - began,
    )


def _jump_to_fly(jump: Jump | str | Path) -> Jump:
    """The jump, or that of a file; an error where its check does not hold, or where it lasts too long."""
    jump = made(Jump)(jump, "jump") if not isinstance(jump, str | Path) else load_jump(jump)
    jump.refuse_unless_ok("fly")
    if jump.duration + STANDING > MOST_PERIODS * PERIOD:
        raise InputError(f"a jump of {jump.duration:g} s is too long to be flown: at most {MOST_PERIODS * PERIOD:g} s")
    return jump
