"""What is shown of a plan, measured where it was planned."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

import floatplan as fp
from floatplan.arrays import ComplexArray
from floatplan.plans.measures import PlanWarning, Utilisation
from floatplan.view.outlines import Poses, body_poses, postures

POSE_RATE = 60.0  # [Hz]
MOST_POSES = 1200  # [-] of a long flight
TRAIL = 81  # [-] points of a path


@dataclass(frozen=True, eq=False)
class Flown:
    """A plan with what the page shows of it.

    Attributes
    ----------
    plan : Plan
        Where none was found, the nearest motion.
    certificate : Certificate or None
    settled : bool
        Whether ``floatplan plan`` would answer so; else a quick search did.
    poses : Poses
    com, takeoff, landing : (N,) complex, m; paths of the centre of mass and of the frames that take off and land
    utilisation, warnings : of the plan
    clearance : m, or None without obstacles
    seconds : from the question to this answer
    """

    plan: fp.Plan
    certificate: fp.Certificate | None
    settled: bool
    poses: Poses
    com: ComplexArray
    takeoff: ComplexArray
    landing: ComplexArray
    utilisation: tuple[Utilisation, ...]
    warnings: tuple[PlanWarning, ...]
    clearance: float | None
    seconds: float

    @property
    def problem(self) -> fp.Problem:
        """What was asked."""
        return self.plan.problem

    @property
    def largest_use(self) -> float | None:
        """Largest share of a limit that a motor uses; None without limits."""
        return largest_use(self.utilisation)

    def complete_plan(self) -> fp.Plan:
        """The plan with its certificate, as ``floatplan plan`` writes it."""
        if self.certificate is None:
            return self.plan
        return self.plan.with_record(self.plan.record.with_checks(certificate=self.certificate.to_dict()))


def flown(plan: fp.Plan, settled: bool, asked: float) -> Flown:
    """Measure a plan; ``asked`` is when ``time.perf_counter`` was read before it was planned."""
    count = min(int(np.ceil(plan.duration * POSE_RATE)) + 1, MOST_POSES)
    state = plan.at(np.linspace(0.0, plan.duration, count))
    com = state.com_position[:, 0] + 1j * state.com_position[:, 1]
    paths = postures(plan, np.linspace(0.0, plan.duration, TRAIL))
    return Flown(
        plan=replace(plan),  # without what it caches
        certificate=plan.certificate,
        settled=settled,
        poses=body_poses(plan.robot, state.orientation, state.positions, com),
        com=paths.com,
        takeoff=paths.takeoff,
        landing=paths.landing,
        utilisation=plan.utilisation,
        warnings=plan.warnings,
        clearance=plan.peaks.clearance,
        seconds=time.perf_counter() - asked,
    )


def largest_use(rows: tuple[Utilisation, ...]) -> float | None:
    """Largest share of a limit that a motor uses; None where none has a limit."""
    limited = [row for row in rows if any((row.torque_limit, row.velocity_limit, row.acceleration_limit))]
    return max((row.worst for row in limited), default=None)
