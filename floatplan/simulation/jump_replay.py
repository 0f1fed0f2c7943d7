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
from floatplan.jumps.jump import Jump
from floatplan.jumps.reading import load_jump
from floatplan.pool import one_thread
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.simulation.closed_loop import BUDGET, MOST_FLIGHTS, MOST_PERIODS
from floatplan.simulation.contact.tracked_motion import PERIOD
from floatplan.simulation.gains import FASTEST, Gains, fastest_bandwidth, first_gains, gains_by_phase, joint_inertia
from floatplan.simulation.jump_flight import JumpControl
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.simulation.results import JumpLandings, JumpReplay, SimulatedFlight
from floatplan.simulation.simulated_jump import STANDING, SimulatedJump
from floatplan.tables import Range

MULTIPLES = (1.1, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5)  # [-] of gains


def search_gains(jump: Jump, progress: Callable[[str, int, int], None] | None = None) -> tuple[Array, int]:
    """Return gains (2, J) with which robots land that measure late, whatever they weigh, and how many were tried.

    Low gains lag behind heavy rotors and let the robot fall, high ones ring with light rotors; what lands every robot
    that was tried may be next to either. So each of some multiples of :func:`first_gains` is simulated with the
    extremes: no rotors and the heaviest, all bodies lighter and heavier, with corrections in flight and without. The
    result is the middle of the neighbours of which each pair lands most of these on their feet alone; of several such
    ranges that of most neighbours, of equals the one whose trunks stay nearest to their path from the landing on (mean
    square).
    """
    first = first_gains(jump)
    control = JumpControl(jump, first, rate=250.0)
    # Armature that may be there, over the least inertia that a joint accelerates where the robot stands.
    heaviest = 2.5 * float(joint_inertia(control.robot.model, control.planned.positions[0]).min())
    late = Perturbation(noise=math.radians(0.1), delay=4e-3)
    friction = jump.request.friction + 0.2  # more than planned: gains, not the ground, are compared
    bodies = np.ones(control.robot.model.njoints)
    fallen = 1.0  # [rad] of tilt: more is no worse
    seed = 977  # of all these flights
    scores = []
    for trial, multiple in enumerate(MULTIPLES, start=1):
        control.gains = multiple * first
        of_multiple = []
        for rotors, mass, correct in itertools.product((0.0, heaviest), (0.95, 1.05), (False, True)):
            fixed: dict[str, Any] = {"armature": rotors, "mass": mass * bodies, "inertia": mass * bodies}
            landing = control.fly_jump(late, friction, seed, 0, correct, **fixed).landing
            on_feet = landing["stands"] and not landing["touched"]
            of_multiple.append((on_feet, -(min(landing["tilt"], fallen) ** 2)))
        scores.append(np.sum(of_multiple, axis=0))
        if progress is not None:
            progress("gains", trial, len(MULTIPLES))
    return middle_of_the_widest(np.array(scores)) * first, len(MULTIPLES)


def middle_of_the_widest(scores: Array) -> float:
    """Return the middle of those multiples that land most flights, by scores (M, 2); see :func:`search_gains`.

    The first column is the number of flights that land, the second minus the sum of squared tilts, rad^2.
    """
    pairs = scores[:-1] + scores[1:]
    best = pairs[:, 0].max()
    ranges = []
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
    gains: Gains | float = (None, None),
    budget: float | None = BUDGET,
    progress: Callable[[str, int, int], None] | None = None,
) -> JumpReplay:
    """Fly a jump in MuJoCo with contact, from standing to a second after its end.

    Parameters
    ----------
    jump : Jump, or path of a jump file
    replan : float, optional
        Corrections in flight per second at most, Hz, whole periods apart: each robot then flies with them and without.
    perturb : str or Perturbation
        Such as ``"mass=5%,friction=20%,armature=0.01,torque=5%,noise=0.1deg,delay=4ms"``. Delays are rounded to 2 ms.
    flights, seed : int
        The same seed, the same flights.
    friction : float, optional
        Of the ground; left out, that of which the jump is planned.
    gains : two floats or mappings, or one float, optional
        Stiffness and damping, of all joints or of some by name: :func:`first_gains`; or a bandwidth, rad/s:
        :func:`gains_by_phase`. Left out they are searched: :func:`search_gains`.
    budget : float, optional
        Time, s, after which no new flight begins. None: no end.
    progress : callable, optional
        Called with what is counted, "gains" that are searched or "flight", how many are done, and of how many.

    Raises
    ------
    InputError
        There is no jump, its check fails, a number or a perturbation is wrong, or MuJoCo is not installed.
    """
    start_time = clock.perf_counter()
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    replan = optional(positive(1 / PERIOD, "Hz"))(replan, "replan")
    seed = SEED(seed, "seed")
    budget = optional(positive(unit="s"))(budget, "budget")
    progress = optional(function)(progress, "progress")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a jump's takeoff is what its stance makes of it", "leave it out")
    jump = _jump_to_fly(jump)
    friction = jump.request.friction if friction is None else number(Range(0.0, 10.0, ""))(friction, "friction")
    control, tried = _control(jump, gains, replan, perturbation, progress)
    corrected: list[SimulatedFlight[SimulatedJump]] = []
    uncorrected: list[SimulatedFlight[SimulatedJump]] = []
    for flight in range(flights):
        if budget is not None and flight and clock.perf_counter() - start_time > budget:
            break
        uncorrected.append(control.fly_jump(perturbation, friction, seed, flight, correct=False, record=not flight))
        if replan is not None:
            corrected.append(control.fly_jump(perturbation, friction, seed, flight, correct=True, record=not flight))
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
        feedback=gains if isinstance(gains, int | float) else None,
        kp=read_only(control.gains[0]),
        kd=read_only(control.gains[1]),
        phase_gains=control.phase_gains,
        tried=tried,
        rate=replan,
        uncorrected=JumpLandings.of(uncorrected),
        corrected=JumpLandings.of(corrected) if corrected else None,
        statuses=dict(sum((flight.statuses for flight in corrected), Counter[str]())),
        balanced=uncorrected[0].balanced,
        motion=(corrected or uncorrected)[0].motion,
        seconds=clock.perf_counter() - start_time,
    )


def _control(
    jump: Jump,
    gains: Gains | float,
    rate: float | None,
    perturbation: Perturbation,
    progress: Callable[[str, int, int], None] | None,
) -> tuple[JumpControl, int]:
    """The control of a jump with gains as requested, and how many were tried; errors as of :func:`replay_jump`."""
    import_mujoco()
    if not isinstance(gains, int | float):
        of_joints, tried = search_gains(jump, progress) if gains == (None, None) else (first_gains(jump, gains), 0)
        return JumpControl(jump, of_joints, rate), tried
    bandwidth = positive(FASTEST, "rad/s")(gains, "feedback")
    delay = round(perturbation.delay / PERIOD) * PERIOD
    most = fastest_bandwidth(delay, PERIOD)
    if bandwidth > most:
        reason = f"{bandwidth:g} rad/s ring where measurements are {1e3 * delay:g} ms late"
        raise InputError(
            reason, element="feedback", advice=f"give {0.8 * most:.3g} or less: from {most:.3g} on all ring"
        )
    by_phase = gains_by_phase(jump, bandwidth)
    flight = [phase.kind for phase in jump.phases].index("flight")
    return JumpControl(jump, by_phase[flight], rate, by_phase), 0


def _jump_to_fly(jump: Jump | str | Path) -> Jump:
    """The jump, or that of a file; an error where its check does not hold, or where it lasts too long."""
    jump = made(Jump)(jump, "jump") if not isinstance(jump, str | Path) else load_jump(jump)
    jump.refuse_unless_ok("fly")
    if jump.duration + STANDING > MOST_PERIODS * PERIOD:
        raise InputError(f"a jump of {jump.duration:g} s is too long to be flown: at most {MOST_PERIODS * PERIOD:g} s")
    return jump
