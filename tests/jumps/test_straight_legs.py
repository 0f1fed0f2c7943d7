"""Legs that are straight where they stand together: their joints cannot follow, and no exception leaves a search."""

from pathlib import Path

import numpy as np
import pytest
from jumps import INSTALLED

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.check import _worst
from floatplan.jumps.contacts import contact_at, heights_over_com, with_bent_knees
from floatplan.jumps.exact import NoExactStanceError, StanceDynamics, may_fail
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.planner import completed
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.rounds import solve_in_rounds
from floatplan.jumps.setup import Setup, jump_setup
from floatplan.jumps.variables import JumpSolution
from floatplan.problem.parts import Flight

needs_casadi = pytest.mark.skipif(not INSTALLED, reason="CasADi or example-robot-data is not installed")
INERTIA = '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'


def table(folder: Path, knees: tuple[float, float] = (-2.4, 2.4), axis: int = 1) -> fp.Robot:
    """A body on a straight leg in front and one behind."""

    def link(name: str, mass: float, at: float, shape: str = "") -> str:
        inertia = INERTIA.format(i=0.004 * mass)
        return (
            f'<link name="{name}"><inertial><origin xyz="0 0 {at}"/><mass value="{mass}"/>{inertia}</inertial>'
            f"{shape}</link>"
        )

    def joint(name: str, parent: str, child: str, place: str, low: float, high: float) -> str:
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


def hop(robot: fp.Robot, **takeoff: object) -> fp.Problem:
    posture = fp.Posture(0.0, robot.resting)
    flight = Flight(0.25, angular_momentum="free", takeoff=fp.Takeoff("rear_foot"))
    both = ("rear_foot", "front_foot")
    request = fp.JumpRequest(
        takeoff=fp.JumpTakeoff(contacts=[both, both[:1]], **takeoff),  # type: ignore[arg-type]
        landing=fp.JumpLanding(contacts=[both[1:], both]),
    )
    limits = fp.Limits(velocity="urdf", torque="urdf")
    return fp.Problem(robot, posture, posture, flight, fp.Motion(objective="torque"), limits, jump=request)


@pytest.mark.parametrize(
    ("knees", "axis", "side"), [((-2.4, 2.4), 1, 1), ((-2.5, 0.4), 1, -1), ((-0.3, 2.2), -1, 1), ((-2.0, 0.0), -1, -1)]
)
def test_knees_that_would_be_straight_bend_to_the_wider_side(
    tmp_path: Path, knees: tuple[float, float], axis: int, side: int
) -> None:
    robot = table(tmp_path, knees, axis)
    straight = np.zeros(5)
    contacts = [contact_at(robot, f"{name}_foot", straight)[0] for name in ("rear", "front")]
    bent = with_bent_knees(robot, contacts, straight, np.asarray(robot.position_limits))
    joints = dict(zip(robot.joints, bent[1:].tolist(), strict=True))
    for name in ("rear", "front"):
        assert side * joints[f"{name}_knee"] > 0.5
        assert robot.position_limits[robot.joints.index(f"{name}_knee")][0] < joints[f"{name}_knee"]
    spots = [contact.spots[0] for contact in contacts]
    before, after = (heights_over_com(robot, spots, y).real for y in (straight, bent))
    np.testing.assert_allclose(np.diff(after), np.diff(before), atol=1e-9)  # feet stay below their hips
    np.testing.assert_array_equal(with_bent_knees(robot, contacts, bent, np.asarray(robot.position_limits)), bent)
    np.testing.assert_array_equal(with_bent_knees(robot, contacts[:1], straight, robot.position_limits), straight)


@pytest.fixture(scope="module")
def solution(tmp_path_factory: pytest.TempPathFactory) -> tuple[Setup, JumpProgram, JumpSolution]:
    """A hop's program, from standing on legs that are straight in the file, and its solution."""
    if not INSTALLED:
        pytest.skip("CasADi or example-robot-data is not installed")
    problem = hop(table(tmp_path_factory.mktemp("table")))
    assert problem.jump is not None
    setup = jump_setup(problem, problem.jump)
    first = setup.program(planner.MARGINS)
    return (setup, *solve_in_rounds(first, first.guess()))


def test_from_straight_legs_it_stands_bent_and_a_jump_is_found(
    solution: tuple[Setup, JumpProgram, JumpSolution],
) -> None:
    setup = solution[0]
    knees = [1 + setup.problem.robot.joints.index(f"{name}_knee") for name in ("rear", "front")]
    assert np.abs(setup.standing[:, knees]).min() > 0.4
    found = completed(*solution, seed=0)
    assert found.ok, found.explanation


@needs_casadi
def test_singular_closures_are_one_error(tmp_path: Path) -> None:
    problem = hop(table(tmp_path))
    assert problem.jump is not None
    setup = jump_setup(problem, problem.jump)
    dynamics = StanceDynamics(PlanarModel(setup.problem.robot), setup.phases[0], np.zeros(5))
    straight = np.zeros((5, 3))
    with pytest.raises(NoExactStanceError, match="bend its knee"), may_fail():
        dynamics.close(straight, straight, straight)


@pytest.mark.parametrize("stage", ["released", "exact_stances"])
def test_what_cannot_be_made_exact_is_not_found(
    solution: tuple[Setup, JumpProgram, JumpSolution], monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise NoExactStanceError("nothing fits")

    monkeypatch.setattr(planner, stage, fails)
    found = completed(*solution, seed=0)
    assert found.status == "not_found"
    assert "nothing fits" in found.explanation


@pytest.mark.parametrize("fault", [np.nan, np.inf, None])
def test_singular_equations_and_numbers_that_are_none_fail_the_start(
    solution: tuple[Setup, JumpProgram, JumpSolution], monkeypatch: pytest.MonkeyPatch, fault: float | None
) -> None:
    close = StanceDynamics.close

    def spoilt(self: StanceDynamics, *motion: np.ndarray) -> np.ndarray:
        if fault is None:
            np.linalg.solve(np.zeros((2, 2)), np.ones(2))
        closed = close(self, *motion)
        closed[0, -1, -1] = fault
        return closed

    monkeypatch.setattr(StanceDynamics, "close", spoilt)
    found = completed(*solution, seed=0)
    assert found.status == "not_found"
    assert ("a leg is straight" if fault is None else "no finite motion") in found.explanation


def test_what_cannot_be_measured_does_not_hold() -> None:
    figures = _worst([("torque", 0.2), ("torque", np.nan), ("ground", np.nan), ("ground", 0.1)])
    assert figures == {"torque": np.inf, "ground": -np.inf}
