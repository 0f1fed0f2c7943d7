"""A plan in, a certificate out: the plan may be alive, a record, or a file.

What is proved depends on the record, the URDF and its meshes alone. A loaded robot is needed only for the capsules
around collision geometry, which the certificate takes as given.
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from pathlib import Path

from floatplan.arguments import optional, whole
from floatplan.arguments import path as as_path
from floatplan.certificate.certificate import BUDGET, prove
from floatplan.certificate.planar.shapes import LinkShape
from floatplan.errors import naming
from floatplan.plans.reading import Recorded, check_meshes, checked, find_urdf, recorded, recorded_robot
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Certificate
from floatplan.pool.threads import one_thread
from floatplan.robot.robot import LinkCapsule, Robot
from floatplan.robot.urdf.example_robots import urdf_path
from floatplan.tables import Range

MOST_CELLS = whole(Range(0, 2**63 - 1, ""))


@one_thread
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
        The plan, its URDF or a collision mesh is missing, damaged, or they do not belong together.
    """
    urdf, budget = optional(as_path)(urdf, "urdf"), MOST_CELLS(budget, "budget")
    record, file, robot = recorded(plan)
    with naming(file):
        path = urdf_path(find_urdf(record.robot.urdf, file) if urdf is None else urdf)
        record = checked(record)
        if not record.asks_clearance:
            return prove(record, path, budget=budget)
        robot = robot or recorded_robot(record.robot, file, path)
        check_meshes(robot, record.robot, file)
        unknown = sorted(set(robot.meshes) - set(record.robot.meshes))
        shapes = hulls = None
        if "<collision" in robot.xml:
            flight = record.problem["flight"]
            standing = [str(flight[end]["frame"]) for end in ("takeoff", "landing")]
            shapes, hulls = shapes_of(robot), shapes_of(robot, robot.hulls(standing, robot.limb_ends))
        return prove(record, path, shapes=shapes, hulls=hulls, unknown_meshes=unknown, budget=budget)


def shapes_of(robot: Robot, capsules: Sequence[LinkCapsule] | None = None) -> list[LinkShape]:
    """Shapes of a loaded robot, left out the capsules around its collision geometry, as ``certify`` takes them."""
    found: list[LinkShape] = []
    for shape in robot.shapes if capsules is None else capsules:
        origin = robot.frames[shape.link].local
        turn = cmath.exp(1j * robot.tree.turn * float(robot.tree.offsets[shape.body]))
        start, end = ((place - origin) * turn for place in (shape.start, shape.end))
        found.append((shape.link, (start.real, start.imag), (end.real, end.imag), shape.radius))
    return found
