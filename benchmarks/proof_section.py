"""Proofs of flights in space: how many, how soon, how sharp, and whether DOP853 ends within what is proved."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from measuring import Counts, heading, table
from space_chains import chain_file
from space_sections import URDF, arms, drawn_goal, stunts, twists

import floatplan as fp
from floatplan.certificate.certificate import BUDGET
from floatplan.certificate.spatial.flight import fly
from floatplan.certificate.spatial.robot import cached_robot
from floatplan.robot.urdf.packages import robot_content
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.spatial_motion import SpatialPlanMotion, angle_between

TIGHTEST = 2.3e-14  # [-] error of a step, the least that DOP853 takes
LINKS = 12  # joints of a chain
CHAINS = 8  # files, each of which several flights are drawn for
TORQUES = 1e-5  # [-] of the largest torque, that a proved peak may be above the true one


@dataclass(frozen=True)
class Proof:
    """A proof of one plan: processor seconds; the bound, rad, and s of the theorem, and the error that it is about.

    ``off`` is the angle, rad, between where the flight ends by DOP853 and by the approximation that the bound is of;
    ``torque_off`` by how much the proved torques are above the measured peaks, relative to the largest.
    """

    verdict: str
    seconds: float
    bound: float
    amplification: float
    off: float
    torque_off: float


@dataclass(frozen=True)
class FlightClass:
    """Flights drawn by seed, ``problems``, and the bars of their proofs: seconds, and the bound, rad, for an s."""

    problems: Callable[[int], Iterator[fp.Problem]]
    seconds: float
    bound: Callable[[float], float]

    def is_within(self, proof: Proof) -> bool:
        """Whether a proof is as quick and as sharp as its bars, and its torques too."""
        sharp = proof.bound <= self.bound(proof.amplification) and proof.torque_off <= TORQUES
        return sharp and proof.seconds <= self.seconds


def proof_of(plan: fp.Plan) -> Proof:
    """Prove a plan, and fly it by DOP853 over Pinocchio's dynamics."""
    began = time.process_time()
    certificate = fp.certify(plan)
    seconds = time.process_time() - began
    record = plan.record
    path = plan.robot.path
    with np.errstate(all="ignore"):
        enclosed = fly(cached_robot(robot_content(path), path, record.robot), record, (), BUDGET)
    motion = SpatialPlanMotion(record, reduced_model(plan.robot, float(record.com["gravity"])))
    attitude = motion.attitudes(np.asarray(record.angular_momentum), TIGHTEST)
    return Proof(
        verdict=certificate.verdict,
        seconds=seconds,
        bound=enclosed.attitude.bound,
        amplification=enclosed.attitude.amplification,
        off=angle_between(attitude(plan.duration), enclosed.quaternions[-1].sum(axis=0)),
        torque_off=float(np.abs(certificate.torque_peak - plan.peaks.torque).max() / plan.peaks.torque.max()),
    )


def cats(count: int) -> Iterator[fp.Problem]:
    """Of Kane and Scher's cat: where drawn motions lead, from rest in every second, else with some momentum."""
    robot = fp.Robot.from_urdf(URDF / "cat.urdf", base="free-flyer")
    low, high = robot.position_limits.T
    for seed in range(count):
        rng = np.random.default_rng(seed)
        ends = low + (high - low) * rng.uniform(0.2, 0.8, (2, 2))
        h = (seed % 2) * 0.1 * rng.normal(size=3)
        yield drawn_goal(robot, ends, h, 0.5, rng)[0]


def chains(folder: Path, count: int) -> Iterator[fp.Problem]:
    """Of serial chains of twelve joints about random axes: where drawn motions lead, within a second."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        robot = fp.Robot.from_urdf(chain_file(folder, LINKS, seed % CHAINS), base="free-flyer")
        ends = rng.uniform(-0.6, 0.6, (2, LINKS))
        yield drawn_goal(robot, ends, rng.normal(size=3), 1.0, rng)[0]


def proofs(counts: Counts) -> None:
    """How many of the plans of drawn flights are proved, and what these proofs claim."""
    count = counts.proofs
    heading(f"proofs in space: {count} flights of each class, seeds 0 to {count - 1}")
    with tempfile.TemporaryDirectory() as folder:
        of_acrobats = partial(FlightClass, seconds=3.0, bound=lambda s: max(1e-8, 2e-11 * s))
        of_machines = partial(FlightClass, seconds=0.3, bound=lambda s: 1e-10)
        classes = {
            "Go2: rolls, flips, spins; h free, limits": of_machines(stunts),
            "Panda and UR5 on 50 kg: 45 to 90 degrees; limits": of_machines(arms),
            "diver: 1 or 2 somersaults, 1/2 to 2 twists": of_acrobats(twists),
            "cat: where drawn motions lead": of_acrobats(cats),
            "chains of 12 joints: where drawn motions lead": FlightClass(
                partial(chains, Path(folder)), seconds=1.0, bound=lambda s: 1e-8
            ),
        }
        rows = [_row(name, flights, count) for name, flights in classes.items()]
    head = ["class", "plans", "proved", "within bars", "s of the processor", "at most", "bound, rad", "at most"]
    table([*head, "s", "at most", "error / bound", "within", "torque off"], rows)
    print("  medians, then the worst; the error is DOP853's end beside the middle of the bound\n")


def _row(name: str, flights: FlightClass, count: int) -> list[object]:
    """A class in one line; what is outside its bars is printed."""
    plans = [plan for plan in map(fp.plan, flights.problems(count)) if plan.ok]
    found = [proof_of(plan) for plan in plans]
    outside = [number for number, proof in enumerate(found) if not flights.is_within(proof)]
    for number in outside:
        print(f"  {name}, plan {number}: {found[number]}")
    return [
        name,
        len(found),
        sum(proof.verdict == "proved" for proof in found),
        len(found) - len(outside),
        *_middle_and_worst([proof.seconds for proof in found]),
        *_middle_and_worst([proof.bound for proof in found]),
        *_middle_and_worst([proof.amplification for proof in found]),
        max(proof.off / proof.bound for proof in found),
        sum(proof.off <= proof.bound for proof in found),
        max(proof.torque_off for proof in found),
    ]


def _middle_and_worst(values: list[float]) -> list[float]:
    return [float(np.median(values)), max(values)]
