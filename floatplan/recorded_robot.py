"""The robot of a plan file: found again, read as it was read, and the same file as then."""

from __future__ import annotations

from pathlib import Path

from floatplan.errors import InputError
from floatplan.plan_record import RobotRecord, plain
from floatplan.robot.example_robots import PREFIX
from floatplan.robot.robot import Coupling, Robot


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
    robot = Robot.from_urdf(
        find_urdf(record.urdf, plan_file) if urdf is None else urdf,
        plane=record.plane,
        joints=record.joints,
        coupled={name: Coupling(**values) for name, values in record.coupled.items()},
        locked=dict(record.locked),
    )
    if robot.sha256 != record.sha256:
        raise InputError(
            "the URDF has changed since the plan was made",
            source=plan_file,
            element=f"robot.sha256 of {urdf or record.urdf}",
            advice="plan again, or bring the old file back",
        )
    return robot


def find_urdf(urdf: str, plan_file: str | Path | None) -> str:
    """Return where the URDF of a plan is: as recorded, else beside the plan file, else as recorded from its folders.

    A path is recorded from where the plan was made, such as two folders above ``runs/handstand/plan.json``.

    Raises
    ------
    InputError
        It is in none of these places.
    """
    if urdf.startswith(PREFIX) or Path(urdf).is_file() or plan_file is None:
        return urdf
    folders = Path(plan_file).absolute().parents
    for path in (folders[0] / Path(urdf).name, *(folder / urdf for folder in folders)):
        if path.is_file():
            return str(path)
    raise InputError("no such file", source=plan_file, element=f"robot.urdf {urdf}", advice="--urdf says where it is")


def robot_record(robot: Robot) -> RobotRecord:
    """Return which robot this is and how it was read, for a plan file."""
    return RobotRecord(
        urdf=robot.source if robot.source.startswith(PREFIX) else str(robot.path or robot.name),
        sha256=robot.sha256,
        joints=robot.joints,
        plane=robot.plane.name,
        coupled={name: plain(vars(coupling)) for name, coupling in robot.coupled.items()},
        locked=dict(robot.locked),
    )
