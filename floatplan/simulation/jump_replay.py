"""Replay of whole jumps: perturbed robots fly one in MuJoCo with contact, with corrections in flight and without."""

from __future__ import annotations

import math
import time as clock
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, made, number, optional, positive, whole
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.pool import one_thread
from floatplan.simulation.closed_loop import BUDGET, MOST_FLIGHTS, MOST_PERIODS
from floatplan.simulation.forward import Gain, given_gains
from floatplan.simulation.jump_flight import Flown, JumpControl
from floatplan.simulation.jump_landings import AFTER, PERIOD, JumpLandings, JumpReplay
from floatplan.simulation.mujoco_model import import_mujoco
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.stance.jump import Jump, load_jump
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import BASE
from floatplan.tables import Range

DAMPED = 0.15  # [-] damping over stiffness and sqrt(height / gravity)
MULTIPLES = ((1.0, 1.0), (1.5, 1.5), (0.7, 0.7), (1.5, 2.0), (0.7, 1.0), (2.0, 2.0), (0.5, 0.5), (3.0, 3.0))
TRIALS, SEARCH = 4, 977  # [-] flights, and their seed
TO_SPARE = 0.2  # [-] of friction
STRAIGHT = 0.1  # [rad]
ROTORS = 4e-4  # [s^2] armature that may be there, over stiffness: 0.02 kg m^2 of a Go2


def first_gains(jump: JumpMotion) -> tuple[float, float]:
    """Stiffness, N m/rad, and damping, N m s/rad, from the robot's weight, and its height where it stands."""
    robot, gravity = jump.problem.robot, jump.problem.flight.gravity
    begin = jump.at(0.0).positions[0]
    height = float(
        (pin.centerOfMass(robot.model, robot.model.createData(), begin) @ robot.plane.vertical) - jump.ground
    )
    stiffness = robot.mass * gravity * height
    return float(f"{stiffness:.2g}"), float(f"{DAMPED * stiffness * math.sqrt(height / gravity):.2g}")


def search_gains(control: JumpControl) -> int:
    """Give a controller the gains with which robots land that measure late and have rotors that nobody knows.

    Multiples of :func:`first_gains`, each flown ``TRIALS`` times without corrections: the first with which all land on
    their feet alone, ``STRAIGHT`` at touchdown, or else those with which most do. Returns how many were tried.
    """
    friction = control.jump.request.friction + TO_SPARE
    first, found = np.array(first_gains(control.jump)), list[tuple[tuple[float, ...], Array]]()
    perturbation = Perturbation(mass=0.05, armature=ROTORS * first[0], noise=math.radians(0.1), delay=4e-3)
    for factors in MULTIPLES:
        control.gains = np.repeat((first * factors)[:, None], len(control.joints), axis=1)
        flown = [control.fly(perturbation, friction, (SEARCH, trial), correct=False) for trial in range(TRIALS)]
        ends = _landings(flown)
        found.append(((int(ends.clean.sum()), int(ends.stands.sum()), -ends.pitch_rms), control.gains))
        if ends.clean.all() and ends.pitch_rms < STRAIGHT:
            break
    control.gains = max(found, key=lambda each: each[0])[1]
    return len(found)


@one_thread
def replay_jump(
    jump: Jump | str | Path,
    replan: float | None = None,
    *,
    perturb: str | Perturbation = "",
    flights: int = 1,
    seed: int = 0,
    friction: float | None = None,
    gains: tuple[Gain | None, Gain | None] = (None, None),
    budget: float | None = BUDGET,
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
        Stiffness, N m/rad, and damping, N m s/rad, of all joints or of some by name. Without any they are searched:
        :func:`search_gains`.
    budget : float, optional
        Time, s, after which no new flight begins. None: no end.

    Raises
    ------
    InputError
        No jump was found, a number is wrong, a perturbation makes no sense, or MuJoCo is not installed.
    """
    began = clock.perf_counter()
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    replan = optional(positive(1 / PERIOD, "Hz"))(replan, "replan")
    seed, budget = SEED(seed, "seed"), optional(positive(unit="s"))(budget, "budget")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a jump's takeoff is what its stance makes of it", "leave it out")
    jump = made(Jump)(jump, "jump") if not isinstance(jump, str | Path) else load_jump(jump)
    if jump.flight is None:
        raise InputError("no jump was found, so there is nothing to fly", source=jump.problem.name, element="status")
    if jump.duration + AFTER > MOST_PERIODS * PERIOD:
        raise InputError(f"a jump of {jump.duration:g} s is too long to be flown: at most {MOST_PERIODS * PERIOD:g} s")
    friction = jump.request.friction if friction is None else number(Range(0.0, 10.0, ""))(friction, "friction")
    import_mujoco()
    joints = tuple(jump.problem.robot.model.names)[BASE + 1 :]
    control, tried = JumpControl(jump, np.zeros((2, len(joints))), replan), 0
    usual = zip(gains, ("kp", "kd"), first_gains(jump), strict=True)
    control.gains = np.array(
        [given_gains(joints, each, name, np.full(len(joints), gain)) for each, name, gain in usual]
    )
    if gains == (None, None):
        tried = search_gains(control)
    kp, kd = control.gains
    corrected: list[Flown] = []
    uncorrected: list[Flown] = []
    for flight in range(flights):
        if budget is not None and flight and clock.perf_counter() - began > budget:
            break
        for correct, ends in ((False, uncorrected), *([(True, corrected)] if replan is not None else [])):
            ends.append(control.fly(perturbation, friction, (seed, flight), correct, record=not flight))
    return JumpReplay(
        flights=len(uncorrected),
        asked=flights,
        seed=seed,
        perturbation=perturbation,
        friction=friction,
        joints=joints,
        kp=read_only(kp),
        kd=read_only(kd),
        tried=tried,
        rate=replan,
        uncorrected=_landings(uncorrected),
        corrected=_landings(corrected) if corrected else None,
        statuses=dict(sum((each.statuses for each in corrected), Counter[str]())),
        motion=(corrected or uncorrected)[0].motion,
        seconds=clock.perf_counter() - began,
    )


def _landings(flown: Sequence[Flown]) -> JumpLandings:
    touched = tuple(each.touched for each in flown)
    columns = [
        [each.stands for each in flown],
        *([getattr(each, name) for each in flown] for name in ("pitch", "torque", "slid")),
    ]
    stands, *others = map(read_only, columns)
    return JumpLandings(stands.astype(bool), touched, *others)
