"""Replay of whole jumps: perturbed robots fly one in MuJoCo with contact, with corrections in flight and without."""

import itertools
import math
import time as clock
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from floatplan.arguments import SEED, function, made, number, optional, positive, whole
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.jumps.jump import Jump
from floatplan.jumps.reading import load_jump
from floatplan.pool import one_thread
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.simulation.contact.tracked_motion import PERIOD
from floatplan.simulation.gains import (
    FASTEST,
    Gains,
    fastest_bandwidth,
    gains_by_phase,
    gains_of_jump,
    joint_inertia,
    ringing_joints,
)
from floatplan.simulation.jump_run import JumpControl
from floatplan.simulation.limits import BUDGET, MOST_FLIGHTS
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.simulation.results import JumpLandings, JumpReplay, SimulatedRun
from floatplan.simulation.simulated_jump import SimulatedJump
from floatplan.tables import Range

MULTIPLES = (1.1, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5)  # [-] of gains
MASSES = (0.95, 1.05)  # [-] of the plan's, as far off as with mass=5%, with which replays and the bench are documented


def search_gains(jump: Jump, progress: Callable[[str, int, int], None] | None = None) -> tuple[Array, int]:
    """Return gains (2, J) with which robots land whose measurements are late, and how many gains were tried.

    Low gains lag behind heavy rotors and let the robot fall, high gains ring with light rotors. Gains with which every
    simulated robot lands may still be next to either limit. So each of some multiples of :func:`gains_of_jump` is
    simulated with the extremes: no rotors and the heaviest, all bodies lighter and heavier, with corrections in flight
    and without. Of each two neighbouring multiples it is counted how many of these robots land with nothing but their
    feet on the ground. The result is the middle of the range of multiples whose pairs have the highest count; of
    several such ranges that of most multiples, and of equal ones that in which bases stay nearest to their planned
    attitude from the landing on (mean square).
    """
    first = gains_of_jump(jump)
    control = JumpControl(jump, first, rate=250.0)  # Hz of corrections, as in the replays of the documentation
    # Armature that may be there, over the least inertia that a joint accelerates where the robot stands.
    heaviest = 2.5 * float(joint_inertia(control.robot.model, control.planned.positions[0]).min())
    late = Perturbation(noise=math.radians(0.1), delay=4e-3)
    friction = jump.request.friction + 0.2  # more than planned: gains, not the ground, are compared
    bodies = np.ones(control.robot.model.njoints)
    fallen = 1.0  # [rad] of tilt: more is no worse
    seed = 977  # of all these runs, an arbitrary one
    scores = []
    for trial, multiple in enumerate(MULTIPLES, start=1):
        control.gains = multiple * first
        of_multiple = []
        for rotors, mass, correct in itertools.product((0.0, heaviest), MASSES, (False, True)):
            masses = mass * bodies
            run = control.run_jump(late, friction, seed, 0, correct, armature=rotors, mass=masses, inertia=masses)
            on_feet = run.landing["stands"] and not run.landing["touched"]
            of_multiple.append((on_feet, -(min(run.landing["tilt"], fallen) ** 2)))
        scores.append(np.sum(of_multiple, axis=0))
        if progress is not None:
            progress("gains", trial, len(MULTIPLES))
    return middle_of_the_widest(np.array(scores)) * first, len(MULTIPLES)


def middle_of_the_widest(scores: Array) -> float:
    """Return the middle of the multiples with which most robots land, by scores (M, 2); see :func:`search_gains`.

    The first column is the number of robots that land, the second minus the sum of squared tilts, rad^2.
    """
    pairs = scores[:-1] + scores[1:]
    best = pairs[:, 0].max()
    ranges = []
    for is_best, group in itertools.groupby(range(len(pairs)), lambda pair: pairs[pair, 0] == best):
        if is_best:
            same = list(group)
            middle = (MULTIPLES[same[0]] + MULTIPLES[same[-1] + 1]) / 2
            ranges.append((len(same), pairs[same, 1].max(), middle))
    return float(max(ranges)[2])


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
        Corrections in flight per second at most, Hz, whole periods apart: each robot then runs with and without them.
    perturb : str or Perturbation
        Such as ``"mass=5%,friction=20%,armature=0.01,torque=5%,noise=0.1deg,delay=4ms"``. Delays are rounded to 2 ms.
    flights, seed : int
        Number of runs, each of one robot through the whole jump. The same seed, the same robots and the same noise.
    friction : float, optional
        Of the ground; left out, the one that the jump is planned for.
    gains : two floats or mappings, or one float, optional
        Stiffness and damping, of all joints or of some by name: :func:`gains_of_jump`; or a bandwidth, rad/s:
        :func:`gains_by_phase`. Left out they are searched: :func:`search_gains`.
    budget : float, optional
        Time, s, after which no new run begins. None: no end.
    progress : callable, optional
        Called with what is counted ("gains" that are tried, or "flight": a run), how many are done, and of how many.

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
    perturbation = _perturbation_of_jump(perturb)
    jump = _jump_to_fly(jump)
    friction = jump.request.friction if friction is None else number("friction")(friction, "friction")
    control, tried = _control(jump, gains, replan, perturbation, progress)
    corrected: list[SimulatedRun[SimulatedJump]] = []
    uncorrected: list[SimulatedRun[SimulatedJump]] = []
    for run in range(flights):
        if budget is not None and run and clock.perf_counter() - start_time > budget:
            break
        uncorrected.append(control.run_jump(perturbation, friction, seed, run, correct=False, record=not run))
        if replan is not None:
            corrected.append(control.run_jump(perturbation, friction, seed, run, correct=True, record=not run))
        if progress is not None:
            progress("flight", run + 1, flights)
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
        ringing=ringing_joints(jump, control.gains, round(perturbation.delay / PERIOD), PERIOD),
        rate=replan,
        uncorrected=JumpLandings.of([run.landing for run in uncorrected]),
        corrected=JumpLandings.of([run.landing for run in corrected]) if corrected else None,
        statuses=dict(sum((run.statuses for run in corrected), Counter[str]())),
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
        of_joints, tried = search_gains(jump, progress) if gains == (None, None) else (gains_of_jump(jump, gains), 0)
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


def _perturbation_of_jump(perturb: str | Perturbation) -> Perturbation:
    """The perturbation; an error where it is one of takeoffs."""
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a jump's takeoff is what its stance makes of it", "leave it out")
    return perturbation


def _jump_to_fly(jump: Jump | str | Path) -> Jump:
    """The jump, or that of a file; an error where its check does not hold."""
    jump = made(Jump)(jump, "jump") if not isinstance(jump, str | Path) else load_jump(jump)
    jump.refuse_unless_ok("fly")
    return jump
