"""Plan files read: a record brought back to life beside the URDF that it names."""

from __future__ import annotations

from pathlib import Path

from floatplan.arguments import optional
from floatplan.arguments import path as as_path
from floatplan.arrays import read_only
from floatplan.errors import InputError, naming
from floatplan.motion.planar.ballistics import Ballistics
from floatplan.plans.plan import Plan
from floatplan.plans.reading import load_record
from floatplan.plans.record import PlanRecord
from floatplan.plans.recorded_robot import check_meshes, recorded_robot
from floatplan.plans.schema import check_asked
from floatplan.pool.threads import one_thread
from floatplan.problem.file import problem_from_dict


@one_thread
def rebuild(record: PlanRecord, source: str | Path | None = None, urdf: str | Path | None = None) -> Plan:
    """Bring a record back to life; the URDF, elsewhere if ``urdf`` says so, must still be what it was.

    Raises
    ------
    InputError
        The URDF is missing or has changed, the record's problem does not fit it, or its certificate is none.
    """
    with naming(source):
        check_asked(record)
    robot = recorded_robot(record.robot, source, urdf)
    if record.asks_clearance:
        check_meshes(robot, record.robot, source)
    if (record.clearance_min is None) == bool(record.problem.get("obstacles")):
        reason = (
            "is null although there are obstacles" if record.clearance_min is None else "is given without obstacles"
        )
        raise InputError(reason, source=source, element="clearance_min")
    problem = problem_from_dict(dict(record.problem), robot, source, written=record.problem_file)
    path = Ballistics(
        read_only(record.com["position0"]), read_only(record.com["velocity0"]), float(record.com["gravity"])
    )
    try:
        return Plan(
            problem=problem,
            centre=record.centre,
            amplitude=record.amplitude,
            coefficients=record.coefficients,
            angular_momentum=record.angular_momentum,
            angular_momentum_bounds=record.angular_momentum_bounds,
            ballistics=path,
            status=record.status,
            ok=record.ok,
            explanation=record.explanation,
            solver=record.solver,
            as_recorded=record,
        )
    except InputError as error:
        raise error.within(source=source) from None


def given_plan(plan: Plan | str | Path) -> Plan:
    """Return the plan that a function was given, or read its file; errors as :func:`load_plan`."""
    if isinstance(plan, Plan):
        return plan
    if not isinstance(plan, str | Path):
        raise InputError(f"{plan!r} is neither a Plan nor the path of one", element="plan")
    return load_plan(plan)


@one_thread
def load_plan(path: str | Path, urdf: str | Path | None = None) -> Plan:
    """Read a plan file and the URDF that it names, or another place of the same file.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    path, urdf = as_path(path, "path"), optional(as_path)(urdf, "urdf")
    return rebuild(load_record(path), path, urdf)
