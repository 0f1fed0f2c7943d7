"""Legs that are straight where they stand together: their joints cannot follow, and no exception leaves a search."""

import numpy as np
import pytest

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.planner import jump_of_solution
from floatplan.jumps.setup import jump_setup, solve_in_rounds
from floatplan.problem.parts import Flight

INERTIA = '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'


def table(folder, knees=(-2.4, 2.4), axis=1):
    """A body on a straight leg in front and one behind."""

    def link(name, mass, at, shape=""):
        inertia = INERTIA.format(i=0.004 * mass)
        return (
            f'<link name="{name}"><inertial><origin xyz="0 0 {at}"/><mass value="{mass}"/>{inertia}</inertial>'
            f"{shape}</link>"
        )

    def joint(name, parent, child, place, low, high):
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{place}"/><axis xyz="0 {axis} 0"/>'
            f'<limit lower="{low}" upper="{high}" effort="70" velocity="26"/></joint>'
        )

    foot = '<collision><origin xyz="0 0 -0.23"/><geometry><sphere radius="0.02"/></geometry></collision>'
    parts = [link("body", 9.5, 0.0)]
    for name, at in (("rear", -0.22), ("front", 0.22)):
        parts += [link(f"{name}_thigh", 0.8, -0.11), link(f"{name}_shank", 0.3, -0.12, foot)]
        parts.append(joint(f"{name}_hip", "body", f"{name}_thigh", f"{at} 0 0", -1.8, 1.8))
        parts.append(joint(f"{name}_knee", f"{name}_thigh", f"{name}_shank", "0 0 -0.22", *knees))
        parts.append(
            f'<link name="{name}_foot"/><joint name="{name}_end" type="fixed"><parent link="{name}_shank"/>'
            f'<child link="{name}_foot"/><origin xyz="0 0 -0.23"/></joint>'
        )
    path = folder / "table.urdf"
    path.write_text(f'<robot name="table">{"".join(parts)}</robot>')
    return fp.Robot.from_urdf(path, plane="xz")


def hop(robot, **takeoff):
    posture = fp.Posture(0.0, robot.resting)
    flight = Flight(0.25, angular_momentum="free", takeoff=fp.Takeoff("rear_foot"))
    both = ("rear_foot", "front_foot")
    request = fp.JumpRequest(
        takeoff=fp.JumpTakeoff(contacts=[both, both[:1]], **takeoff),
        landing=fp.JumpLanding(contacts=[both[1:], both]),
    )
    limits = fp.Limits(velocity="urdf", torque="urdf")
    return fp.Problem(robot, posture, posture, flight, fp.Motion(objective="torque"), limits, jump=request)


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    """A hop's program, from standing on legs that are straight in the file, and its solution."""
    problem = hop(table(tmp_path_factory.mktemp("table")))
    assert problem.jump is not None
    setup = jump_setup(problem, problem.jump)
    first = setup.program(planner.MARGINS)
    return (setup, *solve_in_rounds(first, first.guess()))


def test_from_straight_legs_it_stands_bent_and_a_jump_is_found(solution):
    setup = solution[0]
    knees = [1 + setup.problem.robot.joints.index(f"{name}_knee") for name in ("rear", "front")]
    assert np.abs(setup.ends[:, knees]).min() > 0.4
    found = jump_of_solution(*solution, seed=0)
    assert found.ok, found.explanation
