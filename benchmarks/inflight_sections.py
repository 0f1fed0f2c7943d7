"""Corrections in flight: where perturbed robots land with them and without, and what a correction takes."""

from __future__ import annotations

import math

import numpy as np
from measuring import PROBLEMS, Counts, heading, table

import floatplan as fp
from floatplan.robot.urdf.tree import robots_folder

PERTURBED = "h=10%,inertia=5%,noise=0.11deg,rate_noise=1.15deg/s,delay=5ms"
RATE = 200.0  # [Hz]
SEED = 2026
FLOWN = {
    "gymnast's somersault": "somersault",
    "Go2's backflip": "gallery/go2",
    "B, obstacle": "obstacle",
    "Go2's barrel roll": "space/go2_barrel_roll",
    "Go2's half twist": "space/go2_half_twist",
}


def inflight(counts: Counts) -> None:
    """Fly perturbed robots by forward dynamics."""
    heading(f"inflight: {counts.flights} flights each, {PERTURBED}, corrected at {RATE:g} Hz or not")
    rows = []
    for name, file in FLOWN.items():
        if "go2" in file and robots_folder() is None:
            print(f"  example-robot-data is not installed: {name} left out")
            continue
        plan = fp.plan(fp.load_problem(PROBLEMS / f"{file}.toml"))
        flown = fp.closed_loop(plan, RATE, perturb=PERTURBED, flights=counts.flights, seed=SEED, budget=None)
        for how, ends in (("corrected", flown.corrected), ("not", flown.uncorrected)):
            off = np.abs(ends.orientation)
            peak = ends.torque_peak.max(axis=1)
            rows.append(
                [
                    name,
                    how,
                    math.degrees(np.median(off)),
                    math.degrees(off.max()),
                    math.degrees(ends.joints.max()),
                    float(np.median(peak) / flown.plan_torque_peak.max()),
                    float((ends.torque_peak / flown.effort).max()),
                    int((ends.clearance < 0).sum()),
                    *(flown.update_milliseconds if how == "corrected" else ["-"] * 2),
                ]
            )
    titles = ["flight", "", "median deg", "worst deg", "joints deg", "torque / plan", "/ effort", "touched"]
    table([*titles, "update ms", "p99 ms"], rows)
