"""A plan in, a certificate out: the plan may be alive, a record, or a file.

What is proved depends on the record and the URDF alone. A loaded robot is needed only for the capsules around collision
geometry, which the certificate takes as given.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from floatplan.plan_record import PlanRecord, load_record
from floatplan.proof.certificate import BUDGET, Certificate
from floatplan.proof.certificate import certify as prove
from floatplan.proof.shapes import LinkShape, shapes_of
from floatplan.recorded_robot import find_urdf, recorded_robot
from floatplan.robot.example_robots import urdf_path
from floatplan.robot.robot import Robot


class Recorded(Protocol):
    """A plan with its record and its robot, such as :class:`floatplan.Plan`."""

    @property
    def record(self) -> PlanRecord:
        """The plan as data."""

    @property
    def robot(self) -> Robot:
        """The robot that flies."""


def certify(
    plan: Recorded | PlanRecord | str | Path, *, urdf: str | Path | None = None, budget: int = BUDGET
) -> Certificate:
    """Prove or refute a plan for every instant of its flight.

    Parameters
    ----------
    plan : Plan, PlanRecord, or path of a plan file
    urdf : path, optional
        The robot's file, where it is no longer where the plan says. Its SHA-256 has to be the recorded one.
    budget : int
        Most cells of time; with fewer than it needs, the proof may end undecided.

    Returns
    -------
    Certificate
        Its ``verdict`` is "proved", "refuted" or "undecided"; see ``docs/certificate.md`` for the statement.

    Raises
    ------
    InputError
        The plan or its URDF is missing, damaged, or they do not belong together.
    """
    if isinstance(plan, PlanRecord):
        record, file, robot = plan, None, None
    elif isinstance(plan, str | Path):
        record, file, robot = load_record(plan), plan, None
    else:
        record, file, robot = plan.record, None, plan.robot
    path = urdf_path(find_urdf(record.robot.urdf, file) if urdf is None else urdf)
    return prove(record, path, shapes=_shapes(record, path, robot), budget=budget)


def _shapes(record: PlanRecord, urdf: Path, robot: Robot | None) -> list[LinkShape] | None:
    """The robot's capsules, where the plan has something to keep clear of and the file has collision geometry."""
    if not any(record.problem.get(key) for key in ("obstacles", "self_clearance", "ground")):
        return None
    robot = robot or recorded_robot(record.robot, urdf=urdf)
    return shapes_of(robot) if "<collision" in robot.xml else None
