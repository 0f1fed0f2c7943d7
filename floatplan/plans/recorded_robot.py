"""The robot of a plan file: found again, read as it was read, and the same file as then."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from floatplan.errors import InputError
from floatplan.files import is_file, plain
from floatplan.plans.reading import load_record
from floatplan.plans.record import PlanRecord, RobotRecord
from floatplan.robot.robot import Coupling, Robot, robot_as_asked
from floatplan.robot.urdf.example_robots import PREFIX


class Recorded(Protocol):
    """A plan with its record and its robot, such as :class:`floatplan.Plan`."""

    @property
    def record(self) -> PlanRecord:
        """The plan as data."""

    @property
    def robot(self) -> Robot:
        """The robot that flies."""


def recorded(plan: Recorded | PlanRecord | str | Path) -> tuple[PlanRecord, str | Path | None, Robot | None]:
    """Return a plan's record; the file that it was read from, and its robot, where there is one.

    Raises
    ------
    InputError
        It is no plan, nor the path of one; or its file is wrong.
    """
    if isinstance(plan, PlanRecord):
        return plan, None, None
    if isinstance(plan, str | Path):
        return load_record(plan), plan, None
    if not isinstance(getattr(plan, "record", None), PlanRecord):
        raise InputError(f"{plan!r} is neither a Plan nor the path of one", element="plan")
    return plan.record, None, plan.robot


def recorded_robot(record: RobotRecord, plan_file: str | Path | None = None, urdf: str | Path | None = None) -> Robot:
    """Load the robot that a plan is for.

    Parameters
    ----------
    record : RobotRecord
    plan_file : path, optional
        The plan's file, beside which the URDF may lie too.
    urdf : path, optional
        The robot's file, where it is elsewhere.

    Raises
    ------
    InputError
        The URDF is missing, or is not what it was when the plan was made.
    """
    choices = {
        "plane": record.plane,
        "joints": record.joints,
        "coupled": {name: Coupling(**values) for name, values in record.coupled.items()},
        "locked": dict(record.locked),
    }
    place = find_urdf(record.urdf, plan_file) if urdf is None else urdf
    robot = robot_as_asked(place, choices, plan_file, "robot.")
    if robot.sha256 != record.sha256:
        raise InputError(
            "the URDF has changed since the plan was made",
            source=plan_file,
            element=f"robot.sha256 of {urdf or record.urdf}",
            advice="plan again, or bring the old file back",
        )
    return robot


def check_meshes(robot: Robot, record: RobotRecord, plan_file: str | Path | None = None) -> None:
    """Refuse collision meshes that are not what they were when the plan was made; those of no known hash pass.

    Raises
    ------
    InputError
        A mesh has changed, or is no longer there; or the collision geometry is of a kind that is not read.
    """
    try:
        robot.check_shapes()
    except InputError as error:
        raise error.within(source=plan_file or error.source) from None
    for filename, digest in record.meshes.items():
        if robot.meshes.get(filename) != digest:
            raise InputError(
                "the collision mesh has changed since the plan was made",
                source=plan_file,
                element=f"robot.meshes of {filename}",
                advice="plan again, or bring the old file back",
            )


def find_urdf(urdf: str, plan_file: str | Path | None) -> str:
    """Return where the URDF of a plan is: as recorded, or beside or relative to the plan file.

    Raises
    ------
    InputError
        It is in none of these places.
    """
    if plan_file is None or urdf.startswith(PREFIX) or is_file(Path(urdf)):
        return urdf
    for name in (Path(urdf).name, urdf):
        path = Path(plan_file).parent / name
        if is_file(path):
            return str(path)
    raise InputError("no such file", source=plan_file, element=f"robot.urdf {urdf}", advice="--urdf says where it is")


def robot_record(robot: Robot) -> RobotRecord:
    """Return which robot this is and how it was read, for a plan file."""
    return RobotRecord(
        urdf=robot.source if robot.source.startswith(PREFIX) else str(robot.path.resolve()),
        sha256=robot.sha256,
        joints=robot.joints,
        plane=robot.plane.name,
        coupled={name: plain(vars(coupling)) for name, coupling in robot.coupled.items()},
        locked=dict(robot.locked),
        meshes=dict(robot.meshes),
    )
