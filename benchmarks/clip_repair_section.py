"""Recorded motions repaired: drawn hops that were spoiled, flights with twists, a long clip of many flights."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from clip_section import drawn
from drawn_hops import Hop, clip_of, draw_hops, drifted, in_a_row, noisy, shifted, stretched
from drawn_twists import draw_twist, slowly
from measuring import Counts, heading, table
from scipy.spatial.transform import Rotation

from floatplan.clips.check import check_clip
from floatplan.clips.clip import Clip
from floatplan.clips.fall import fit_fall
from floatplan.clips.judge import FlightJudgement
from floatplan.clips.repair import ClipRepair, FlightRepair, repair_clip
from floatplan.clips.repaired_flight import plan_flight_anew
from floatplan.clips.repaired_motion import RepairedMotion
from floatplan.motion.spatial.kinematics import body_poses, centre_of_mass

GRAVITY = 9.81  # [m/s^2]
NOISE = (0.1, 5e-4)  # [degree, m] in every frame
NEAR = 1e-9  # [s] to either side of a seam, where configurations are compared
BOUNDS = {
    "fall - g, m/s^2": "95 % < 1e-9",
    "h, relative": "95 % < 1e-6",
    "T of stretched ones, %": "95 % < 1",
    "joints rms, degree": "95 % < 0.5",
    "share of a limit": "90 % <= 1",
    "feet, mm": "95 % < 10",
    "jump of q at a seam": "all < 1e-6",
    "one plan, CPU s": "median 0.05, 95 % < 0.2",
    "whole call, CPU s": "median 0.05, 95 % < 0.2",
}


@dataclass(frozen=True)
class Spoiled:
    """A drawn hop that was spoiled: what was done, and the factor in time where that is it."""

    kind: str
    clip: Clip
    factor: float = 1.0


def spoiled(hop: Hop, fps: float, number: int, rng: np.random.Generator) -> Spoiled:
    """Spoil a hop, in turns: stretched, drifted, shifted, stretched with noise."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    factor = float(rng.uniform(1.1, 1.5))
    kind = ("stretched", "drifted", "shifted", "stretched, noisy")[number % 4]
    if kind == "drifted":
        return Spoiled(kind, drifted(hop, fps, float(rng.uniform(6.0, 12.0)), axis))
    if kind == "shifted":
        return Spoiled(kind, shifted(hop, fps, float(rng.uniform(0.05, 0.1)), axis))
    clip = stretched(hop, fps, factor)
    return Spoiled(kind, clip if kind == "stretched" else noisy(clip, rng, *NOISE), factor)


def clip_repair(counts: Counts) -> None:
    """How many spoiled hops fly again, how near to the clip, and how quickly."""
    heading("Recorded motions: repaired")
    figures: dict[str, list[float]] = {name: [] for name in BOUNDS}
    by_kind: dict[str, list[str]] = {}
    verdicts: Counter[str] = Counter()
    lines = []
    unchanged = 0
    for number, (name, hop, fps, rng) in enumerate(drawn(counts.repairs)):
        true = clip_of(hop, fps)
        unchanged += repair_clip(true)[0] is true
        case = spoiled(hop, fps, number, rng)
        begin = time.process_time()
        new, told = repair_clip(case.clip)
        seconds = time.process_time() - begin
        outcome = "solved" if told.ok and told.changed else "not"
        by_kind.setdefault(case.kind, []).append(outcome)
        if outcome == "solved":
            figures["whole call, CPU s"].append(seconds)
            verdicts.update(judged.verdict for judged in check_clip(new).flights)
            for key, value in measures(case, new, told):
                figures[key].append(value)
        else:
            reasons = "; ".join(each.repaired.reason for each in told.flights if each.repaired) or "left as it is"
            lines.append(f"{name}, seed {number}, {fps:g} Hz, {case.kind}: {reasons}")
    table(
        ["spoiled", "clips", "solved"],
        [[kind, len(found), found.count("solved")] for kind, found in by_kind.items()],
    )
    _print_figures(figures)
    print(f"judged again: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.items())}")
    print(f"true hops that come back as they are: {unchanged} of {counts.repairs}")
    for line in lines:
        print(line)
    _twists(max(1, counts.repairs // 5))
    for name in ("go2", "g1"):
        _long_clip(name, min(counts.repairs, 40))
    print()


def measures(case: Spoiled, new: Clip, told: ClipRepair) -> Iterator[tuple[str, float]]:
    """What is measured of a clip that was repaired, flight by flight."""
    for number, each in enumerate(told.flights):
        if each.repaired is None or each.repaired.plan is None:
            continue
        plan = each.repaired.plan
        motion = RepairedMotion(case.clip, {number: plan})
        begin = motion.begins[number]
        yield "fall - g, m/s^2", abs(fall_of_frames(new, begin, begin + plan.duration) - GRAVITY)
        yield "h, relative", momentum_spread(case.clip, each)
        if case.factor > 1 and each.repaired.choice == "retime":
            expected = each.flight.duration / case.factor
            yield "T of stretched ones, %", 100 * abs(each.repaired.duration / expected - 1)
        yield "joints rms, degree", float(np.rad2deg(each.repaired.joints_rms))
        for share in (each.repaired.rate_share, each.repaired.torque_share):
            if share is not None:
                yield "share of a limit", share[0]
        yield "feet, mm", 1e3 * each.seam_foot
        for instant in (begin, begin + plan.duration):
            before, after = motion.configurations(instant + np.array([-NEAR, NEAR]))
            yield "jump of q at a seam", float(np.abs(before - after).max())
        yield "one plan, CPU s", plan_seconds(case.clip, told.before.flights[number])


def fall_of_frames(clip: Clip, begin: float, end: float) -> float:
    """At which acceleration, m/s^2, the centre of mass falls in the frames from one time to another."""
    frames = slice(int(np.ceil(begin * clip.fps)), int(end * clip.fps) + 1)
    attitudes = Rotation.from_quat(clip.base_quaternion[frames]).as_matrix()
    poses = body_poses(clip.robot, clip.base_position[frames], attitudes, clip.positions[frames])
    return fit_fall(clip.times[frames], centre_of_mass(clip.robot, poses)).fall


def momentum_spread(clip: Clip, each: FlightRepair) -> float:
    """By how much h changes in a flight, relative to the largest: by Pinocchio, from configurations and velocities."""
    assert each.repaired is not None
    plan = each.repaired.plan
    assert plan is not None
    times = np.linspace(0.0, plan.duration, 21)
    motion = plan.full_motion(times)
    q = np.concatenate((motion.base_position, motion.base_quaternion, motion.positions), axis=1)
    v = np.concatenate((motion.base_twist, motion.velocities), axis=1)
    model = clip.robot.model
    data = model.createData()
    momenta = []
    for configuration, velocity in zip(q, v, strict=True):
        pin.ccrba(model, data, configuration, velocity)
        momenta.append(data.hg.angular.copy())
    h = np.array(momenta)
    return float(np.abs(h - h.mean(axis=0)).max() / np.abs(h).max())


def plan_seconds(clip: Clip, judged: FlightJudgement) -> float:
    """Processor time, s, of planning one flight again, with whatever is prepared once for a clip."""
    begin = time.process_time()
    plan_flight_anew(clip, judged)
    return time.process_time() - begin


def _print_figures(figures: dict[str, list[float]]) -> None:
    rows = []
    for name, values in figures.items():
        middle, ninety, high, most = np.percentile(values, [50, 90, 95, 100]).tolist() if values else [np.nan] * 4
        rows.append([name, middle, ninety, high, most, BOUNDS[name]])
    table(["of the solved ones", "median", "90 %", "95 %", "largest", "bar"], rows)


def _twists(count: int) -> None:
    """Flights with half and full twists, played too slowly: how many fly again."""
    solved = planned = 0
    lines = []
    seconds = []
    for seed in range(count):
        plan = draw_twist(seed)
        if not plan.ok:
            continue
        planned += 1
        rng = np.random.default_rng(1000 + seed)
        clip = slowly(plan, float(rng.uniform(1.1, 1.5)), 50.0)
        begin = time.process_time()
        _, told = repair_clip(clip)
        seconds.append(time.process_time() - begin)
        solved += told.ok and told.changed
        lines += [
            f"twist, seed {seed}: {each.repaired.reason}" for each in told.flights if each.repaired and not told.ok
        ]
    print(f"half and full twists: {solved} of {planned} fly again, processor time {np.median(seconds):.2f} s (median)")
    for line in lines:
        print(line)


def _long_clip(name: str, count: int) -> None:
    """A clip of many hops of a robot in a row, its flights stretched."""
    clip = in_a_row(draw_hops(name, count), 30.0, 1.2, stance=0.12, between=0.1)
    begin = time.process_time()
    new, told = repair_clip(clip)
    seconds = time.process_time() - begin
    verdicts = [judged.verdict for judged in check_clip(new).flights]
    fine, _ = repair_clip(clip, rate=200.0)
    at_200 = [judged.verdict for judged in check_clip(fine).flights]
    repaired = sum(each.repaired is not None and each.repaired.repairable for each in told.flights)
    print(
        f"{name}, {clip.frames} frames with {len(told.flights)} flights: {repaired} repaired in {seconds:.1f} s of "
        f"processor time; then physical {verdicts.count('physical')} of {len(verdicts)} at 30 Hz, "
        f"{at_200.count('physical')} of {len(at_200)} at 200 Hz"
    )
    feet = [1e3 * each.seam_foot for each in told.flights]
    print(f"feet within {np.percentile(feet, 95):.2g} mm (95 %) of the clip's")
    for each in told.flights:
        if each.repaired is not None and each.repaired.reason:
            print(f"  {each.flight.begin:.2f} s: {each.repaired.reason}")
