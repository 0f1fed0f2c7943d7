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
from floatplan.arrays import Array
from floatplan.certificate.certificate import BUDGET
from floatplan.certificate.spatial.flight import fly
from floatplan.certificate.spatial.robot import kept_robot
from floatplan.robot.urdf.packages import robot_content
from floatplan.simulation.reduced_model import reduced_model
from floatplan.simulation.spatial_motion import RecordedSpatialMotion, angle_between

TIGHTEST = 2.3e-14  # [-] error of a step, the least that DOP853 takes
LINKS = 12  # joints of a chain
CHAINS = 8  # files, each of which several flights are drawn for
TORQUES = 1e-5  # [-] of the largest torque, that a proved peak may be above the true one


@dataclass(frozen=True)
class Drawn:
    """A class of flights: what draws so many problems, and the bars for seconds and for the bound, rad, by s."""

    problems: Callable[[int], Iterator[fp.Problem]]
    seconds: float
    bound: Callable[[float], float]


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


def proof_of(plan: fp.Plan) -> Proof:
    """Prove a plan, and fly it by DOP853 over Pinocchio's dynamics."""
    began = time.process_time()
    certificate = fp.certify(plan)
    seconds = time.process_time() - began
    record = plan.record
    path = plan.robot.path
    with np.errstate(all="ignore"):
        enclosed = fly(kept_robot(robot_content(path), path, record.robot), record, BUDGET)
    motion = RecordedSpatialMotion(record, reduced_model(plan.robot, float(record.com["gravity"])))
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
        classes = {
            "Go2: rolls, flips, spins; h free, limits": Drawn(stunts, 0.3, lambda s: 1e-10),
            "Panda and UR5 on 50 kg: 45 to 90 degrees; limits": Drawn(arms, 0.3, lambda s: 1e-10),
            "diver: 1 or 2 somersaults, 1/2 to 2 twists": Drawn(twists, 3.0, lambda s: max(1e-8, 2e-11 * s)),
            "cat: where drawn motions lead": Drawn(cats, 3.0, lambda s: max(1e-8, 2e-11 * s)),
            f"chains of {LINKS} joints: where drawn motions lead": Drawn(
                partial(chains, Path(folder)), 1.0, lambda s: 1e-8
            ),
        }
        rows = []
        for name, drawn in classes.items():
            rows.append(_row(name, drawn, count))
    head = [
        "class",
        "plans",
        "proved",
        "within bars",
        "s of the processor, median",
        "worst",
        "bound, rad, median",
        "worst",
    ]
    table([*head, "s, median", "worst", "true error over bound, worst", "DOP853 within", "torque off, worst"], rows)


def _row(name: str, drawn: Drawn, count: int) -> list[object]:
    """A class in one line."""
    found: list[Proof] = []
    for problem in drawn.problems(count):
        plan = fp.plan(problem)
        if plan.ok:
            found.append(proof_of(plan))
    outside = []
    for number, proof in enumerate(found):
        if (
            proof.seconds > drawn.seconds
            or proof.bound > drawn.bound(proof.amplification)
            or proof.torque_off > TORQUES
        ):
            outside.append(number)
            print(f"  {name}, plan {number}: {proof}")
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
    of_all: Array = np.array(values)
    return [float(np.median(of_all)), float(of_all.max())]
