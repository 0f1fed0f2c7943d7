"""Whole jumps: from many guesses, to takeoffs that are known to be within reach, flown with contact."""

from __future__ import annotations

import hashlib
import itertools
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Literal

import capsule_world
import numpy as np
from drawn_stances import drawn_hops, drawn_stances
from measuring import PROBLEMS, ROOT, Counts, heading, table

import floatplan as fp
from floatplan.jumps.check import sentences_on
from floatplan.jumps.planner import MARGINS
from floatplan.jumps.setup import jump_setup
from floatplan.jumps.spatial.planner import Start, checked_jump, solved_start
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.simulation.gains import gains_by_phase

ARMATURES = (0.0, 0.0045)  # [kg m^2] nothing, and what a rotor of the Go2's file is behind its gear
FEET: tuple[Literal["points", "rolling"], ...] = ("points", "rolling")
PERTURBED, GRIP, GAINS = "mass=5%,friction=17%,noise=0.1deg,delay=4ms", 0.85, (40.0, 1.0)  # kp, kd
# Stiffness, damping, and armature that is unknown, kg m^2, by robot; besides these, gains of each joint from a
# bandwidth. A Solo12's shanks turn 0.0003 kg m^2.
GAINS_IN_SPACE = dict.fromkeys(("a1", "go1", "go2"), ((40.0, 1.0), 0.005)) | {"solo12": ((4.0, 0.1), 0.0005)}
FEEDBACK = 100.0  # [rad/s]
HEADER_IN_SPACE = ("jump", "gains", "armature kg m^2", "corrected", "stand", "on feet alone", "attitude deg", "at most")
GUESSED = ("go2_roll", "go2_quarter_turn")
BAR, JUMP_BAR = 5.0, 6.0  # [s] of the processor for a launch, and for a jump in all


def launch_section(counts: Counts) -> None:
    """``launch`` for takeoffs of stances that are known: no false no, and every yes holds at 2 kHz."""
    drawn, seeds = drawn_stances(counts.takeoffs)
    heading(f"launch: {len(drawn)} takeoffs of stances drawn with seeds 0 to {seeds - 1}; limits 5 % above their needs")
    seconds, ratios, missed, broken = [], [], 0, 0
    for index, each in enumerate(drawn):
        began = time.process_time()
        found = fp.launch(each.plan, each.request)
        seconds.append(time.process_time() - began)
        if not found.ok:
            missed += 1
            print(f"  no, though one is known: {index}, {each.plan.robot.name}: {' '.join(found.sentences)}")
            continue
        ratios.append(found.ratio)
        shares = {"torque", "torque_speed", "velocity"}
        figures = {name: value for name, value in found.figures.items() if name not in shares}
        broken += bool(sentences_on(each.request, figures)[0]) or max(found.figures[name] for name in shares) > 1
    header = ["false no", "yes that fails", "s of the processor", "at most", f"over {BAR:g} s", "factor", "at most"]
    late = sum(each > BAR for each in seconds)
    middle, most = (statistics.median(ratios), max(ratios)) if ratios else (np.nan, np.nan)
    table(header, [[missed, broken, statistics.median(seconds), max(seconds), late, middle, most]])


def hops(counts: Counts) -> None:
    """``jump`` for jumps straight up that are known to be possible, with limits 5 % above what they need."""
    problems, seeds = drawn_hops(counts.hops)
    heading(
        f"hops: {len(problems)} jumps drawn with seeds 0 to {seeds - 1}; limits 5 % above what they need with margins"
    )
    found, seconds = 0, []
    for index, problem in enumerate(problems):
        began = time.process_time()
        answer = fp.jump(problem)
        seconds.append(time.process_time() - began)
        found += answer.ok
        if not answer.ok:
            print(f"  not found: {index}, {problem.robot.name}: {answer.explanation}")
    table(
        ["found", "of", "s of the processor", "at most"],
        [[found, len(problems), statistics.median(seconds), max(seconds)]],
    )


def contact(counts: Counts) -> None:
    """The Go2's backflip in MuJoCo with contact: springs and dampers on the joints, late and noisy.

    The plan knows the rotors that fly; its feet are points, or the circles that touch the ground in MuJoCo.
    """
    heading(f"contact: {counts.landings} flights of the Go2's backflip, friction {GRIP}, {PERTURBED}")
    path, rows = PROBLEMS / "jumps" / "go2.toml", []
    for feet, armature in itertools.product(FEET, ARMATURES):
        with tempfile.TemporaryDirectory() as folder:
            known = Path(folder, path.name)
            known.write_text(path.read_text().replace("[robot]\n", f"[robot]\narmature = {armature}\n"))
            problem = fp.load_problem(known)
        found = fp.jump(problem, replace(problem.jump or fp.JumpRequest(), feet=feet))
        flown = fp.replay_jump(
            found, perturb=PERTURBED, flights=counts.landings, friction=GRIP, gains=GAINS, budget=None
        ).uncorrected
        touched = ", ".join(f"{link} {count}" for link, count in flown.links.most_common(3)) or "none"
        turned = float(np.rad2deg(flown.pitch_rms))
        rows.append([feet, armature, int(flown.stands.sum()), int(flown.clean.sum()), turned, touched])
    table(
        ["feet", "armature kg m^2", "stand", "on feet alone", "error at touchdown deg", "other links that touched"],
        rows,
    )


def contact_in_space(counts: Counts) -> None:
    """Jumps in space in a world of capsules, without corrections in flight and with them at 250 Hz."""
    paths = sorted((PROBLEMS / "jumps" / "space").glob("*.toml"))[: counts.stunts]
    heading(f"contact in space: {counts.landings} flights of each jump in {capsule_world.__name__}.py")
    rows = [row for path in paths for row in landings_in_space(path, counts.landings)]
    table(HEADER_IN_SPACE, rows)


def landings_in_space(path: Path, flights: int) -> list[list[object]]:
    """Rows of a jump's flights, without corrections and with them."""
    jump = planned_once(path)
    if jump is None:
        return [[path.stem, "not found", *[""] * (len(HEADER_IN_SPACE) - 2)]]
    constant, armature = GAINS_IN_SPACE.get(path.stem.partition("_")[0], (None, 0.005))
    choices = {f"{FEEDBACK:g} rad/s": gains_by_phase(jump, FEEDBACK)}
    if constant is not None:
        same = np.array(constant)[:, None]
        choices["kp {:g}, kd {:g}".format(*constant)] = np.broadcast_to(same, choices[f"{FEEDBACK:g} rad/s"].shape)
    assert jump.flight is not None
    replanner = fp.Replanner(jump.flight, 250.0)
    rows: list[list[object]] = []
    for (control, gains), correct in itertools.product(choices.items(), (False, True)):
        corrections = replanner if correct else None
        flown = [capsule_world.fly(jump, seed, gains, armature, corrections) for seed in range(flights)]
        errors = np.rad2deg([flight.error for flight in flown if np.isfinite(flight.error)])
        worst = float(errors.max(initial=0.0))
        landed = [sum(flight.stands for flight in flown), sum(flight.clean for flight in flown)]
        rows.append(
            [
                path.stem,
                control,
                armature,
                "yes" if correct else "no",
                *landed,
                float(np.sqrt(np.mean(errors**2))),
                worst,
            ]
        )
    return rows


def planned_once(path: Path) -> fp.Jump | None:
    """The jump of a problem file, planned once for the code that plans and that file; None where none is found."""
    digest = hashlib.sha256(path.read_bytes())
    rooms = ("jumps", "kernel", "motion", "planning", "plans", "problem", "robot")
    for room in rooms:
        for source in sorted((ROOT / "floatplan" / room).rglob("*.[ph][yp]*")):
            digest.update(source.read_bytes())
    cached = ROOT / "build" / "jumps" / f"{path.stem}_{digest.hexdigest()[:16]}.json"
    if not cached.exists():
        jump = fp.jump(path)
        if not jump.ok:
            return None
        cached.parent.mkdir(parents=True, exist_ok=True)
        jump.save(cached)
    return fp.load_jump(cached)


def guesses_in_space(counts: Counts) -> None:
    """Jumps in space from random guesses, one start each: found are those whose flight is planned and stances hold."""
    heading(f"guesses in space: seeds 1 to {counts.guesses_in_space} of each jump")
    rows = []
    for name in GUESSED:
        problem = fp.load_problem(PROBLEMS / "jumps" / "space" / f"{name}.toml")
        assert problem.jump is not None
        setup = spatial_setup(problem, problem.jump)
        solved = 0
        seconds = []
        start: Start | None = None
        for seed in range(1, counts.guesses_in_space + 1):
            began = time.process_time()
            start = solved_start(setup, seed, 1, start)
            solved += start.solution.converged
            found = start.solution.converged and checked_jump(start, seed=0).ok
            if found:
                seconds.append(time.process_time() - began)
            else:
                print(f"  not found: {name}, seed {seed}, solved: {start.solution.converged}", flush=True)
        of_found = [statistics.median(seconds), max(seconds)] if seconds else [np.nan, np.nan]
        rows.append([name, solved, len(seconds), counts.guesses_in_space, *of_found])
    table(["jump", "solved at nodes", "found", "of", "s of the processor", "at most"], rows)


def jump_section(counts: Counts) -> None:
    """The Go2's backflip from its generic guess, in all; and from random guesses, one start each."""
    path = PROBLEMS / "jumps" / "go2.toml"
    heading(f"jump: the Go2's backflip, with everything checked; then from random guesses, seeds 1 to {counts.guesses}")
    began = time.process_time()
    found = fp.jump(path)
    seconds, figures = time.process_time() - began, found.check.figures
    header = ["found", "s of the processor", "bar", "torque", "velocity", "residual", "seam"]
    seam = max(figures.get("takeoff_seam", np.nan), figures.get("landing_seam", np.nan))
    shown = [figures.get(name, np.nan) for name in ("torque", "velocity", "residual")]
    table(header, [[found.ok, seconds, JUMP_BAR, *shown, seam]])
    setup = jump_setup(found.problem, found.request)
    program, rows = setup.program(MARGINS), []
    for seed in range(1, counts.guesses + 1):
        began = time.process_time()
        solution = program.solve(program.guess(np.random.default_rng(seed)))
        rows.append(
            (solution.is_motion, solution.iterations, time.process_time() - began, float(sum(solution.durations)))
        )
    good = [row for row in rows if row[0]] or [(False, 0, np.nan, np.nan)]
    _, iterations, spent, lasts = zip(*good, strict=True)
    header = ["solved", "of", "iterations", "at most", "s of the processor", "at most", "jump lasts s", "at most"]
    numbers = [statistics.median(iterations), max(iterations), statistics.median(spent), max(spent)]
    table(header, [[sum(row[0] for row in rows), len(rows), *numbers, min(lasts), max(lasts)]])
