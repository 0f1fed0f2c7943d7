"""Recorded motions repaired with planned stances: how many spoiled hops have both, and what these ask of the robot."""

from __future__ import annotations

import time

import numpy as np
from clip_landings import RATE, ROBOTS, STRETCH, SWING, swung
from drawn_hops import draw_hops
from measuring import Counts, heading, table

from floatplan.clips.repair import repair_clip

SHOWN = ("torque", "velocity", "friction", "ground")


def clip_stances(counts: Counts) -> None:
    """Hops as in the section clip-landings: both stances planned, and checked 2000 times a second."""
    heading("Recorded motions: repaired with planned stances")
    print(f"stretched by {STRETCH:g}, the base swung by {SWING:g} degrees; worst figures of both stances")
    rows = []
    reasons = []
    both = 0
    for name in ROBOTS:
        for number, hop in enumerate(draw_hops(name, counts.clip_stances)):
            angle = 2.0 * np.pi * number / counts.clip_stances
            clip = swung(hop, 50.0, STRETCH, SWING, np.array([np.cos(angle), np.sin(angle), 0.0]))
            begin = time.process_time()
            _, result = repair_clip(clip, rate=RATE, stances="planned")
            seconds = time.process_time() - begin
            (flight,) = result.flights
            facts = flight.to_dict()
            stances = flight.stances
            words = ["planned" if stance.planned else "none" for stance in stances] or ["-", "-"]
            both += len(stances) == 2 and all(stance.planned for stance in stances)
            figures = [stance.to_dict()["figures"] for stance in stances]
            worst = []
            for figure in SHOWN:
                values = [of_stance[figure] for of_stance in figures if figure in of_stance]
                worst.append((min if figure == "ground" else max)(values, default=np.nan))
            joints = np.rad2deg(facts.get("joints_rms") or np.nan)
            bent = facts.get("stance") or {}
            told = [bent.get("vertical_least", np.nan), bent.get("friction") or np.nan]
            rows.append([name, number, *words, facts.get("choice", "-"), joints, *worst, *told, seconds])
            reasons += [f"{name} {number}, {one.side}: {one.reason}" for one in stances if not one.planned]
            if not facts.get("repairable", True):
                reasons.append(f"{name} {number}: {facts['reason']}")
            print(*rows[-1], flush=True)
    names = [
        "robot",
        "hop",
        "takeoff",
        "landing",
        "choice",
        "joints rms",
        *SHOWN,
        "vertical",
        "friction of all",
        "CPU s",
    ]
    table(names, rows)
    print(f"of {len(rows)} hops {both} have both stances, found and checked")
    for line in reasons:
        print(line)
    print()
