"""What is in the way of a jump in space: the limits that bind where the search ended."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp
from floatplan.jumps.spatial.conflicts import BindingLimit, binding_limits, binding_sentence, touchdown_sentence
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.planner import MARGINS, Start, solved_start
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.setup import spatial_setup

LABELS = (
    "balance of forces (takeoff)",
    "torque of knee (takeoff)",
    "friction of foot (takeoff)",
    "torque of hip (flight)",
)


def program(required: float) -> SpatialProgram:
    """``3 x0 + x1 = required``, where x0 is a knee's torque, x1 a friction force, x2 a hip's torque: 1 at most each."""
    x = ca.MX.sym("x", 3)
    parameters = ca.MX.sym("p", 4)
    rows = ca.vertcat(3 * x[0] + x[1], x[0], x[1], x[2])
    assembly = SimpleNamespace(
        first_derivatives={"jac_g": ca.Function("jac_g", [x, parameters], [rows, ca.jacobian(rows, x)])},
        low=np.array([required, -1.0, -np.inf, -1.0]),
        high=np.array([required, 1.0, 1.0, 1.0]),
        labels=LABELS,
        weights=np.ones(3),
    )
    fake = SimpleNamespace(
        assembly=assembly,
        size=3,
        box=(np.full(3, -np.inf), np.full(3, np.inf)),
        begins=np.zeros(1, int),
        phases=(),
        arrival=SimpleNamespace(feet=()),
        model=SimpleNamespace(size=0, robot=SimpleNamespace(joints=())),
        height=1.0,
    )
    return cast("SpatialProgram", fake)


def test_the_limit_that_leaves_most_comes_first() -> None:
    """Of ``(3 x0 + x1 - 5)^2 / 2`` at (1, 1) the derivatives by both bounds are -3 and -1; x2 has none."""
    limits = binding_limits(program(5.0), np.array([1.0, 1.0, 1.0]))
    assert [limit.label for limit in limits] == [LABELS[1], LABELS[2]]
    assert [limit.kind for limit in limits] == ["torque", "friction"]
    assert [limit.weight for limit in limits] == pytest.approx([3.0, 1.0])


def test_a_limit_that_is_far_does_not_bind() -> None:
    limits = binding_limits(program(5.0), np.array([1.0, 0.5, 0.0]))
    assert [limit.label for limit in limits] == [LABELS[1]]


def test_what_pushes_the_other_way_does_not_bind() -> None:
    """Too much at the upper bounds: less torque and less friction would do, and nothing forbids it."""
    assert binding_limits(program(3.0), np.array([1.0, 1.0, 0.0])) == []


def test_where_all_rows_hold_nothing_binds() -> None:
    assert binding_limits(program(4.0), np.array([1.0, 1.0, 1.0])) == []


@pytest.fixture(scope="module")
def quarter_turn(root: Path) -> fp.Problem:
    return fp.load_problem(root / "problems" / "jumps" / "space" / "go2_quarter_turn.toml")


def test_the_explanation_names_limits(quarter_turn: fp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that ends where it begins, with rates at their limits."""
    slow = (1e-3 * np.asarray(quarter_turn.velocity_limits)).tolist()
    problem = replace(quarter_turn, limits=replace(quarter_turn.limits, velocity=slow))

    def end_at_once(program: SpatialProgram, raw: Any, is_near: bool = False) -> Any:
        low, high = program.box
        rates = slice(program.model.size + 6, 2 * program.model.size)
        raw = np.clip(raw, low, high)
        for begin in program.begins[:-1]:
            raw[begin:][rates] = high[begin:][rates]
        return program.solution(raw, 0, False)

    starts: list[Start] = []

    def solved_once(*arguments: Any) -> Start:
        """The start of the first search, in the second too."""
        if not starts:
            starts.append(solved_start(*arguments))
        return starts[0]

    monkeypatch.setattr("floatplan.jumps.spatial.planner.solved_start", solved_once)
    monkeypatch.setattr(SpatialProgram, "solve", end_at_once)
    monkeypatch.setattr("floatplan.jumps.spatial.planner.MARGINS", replace(MARGINS, refinement=0.25))
    result = fp.jump(problem, starts=1)
    assert not result.ok
    assert "No jump was found in 1 start. In the nearest this is farthest from what is required: " in result.explanation
    named = re.search(r" In the way: .*rate of (\w+) \([^)]*\), with all of the (\S+) rad/s", result.explanation)
    assert named is not None, result.explanation
    limit = quarter_turn.velocity_limits[problem.robot.joints.index(named[1])]
    assert float(named[2]) == pytest.approx(0.88e-3 * limit, rel=5e-3)
    assert fp.jump(problem, starts=1, helps=False).explanation == "No jump was found in 1 start."


def test_limits_are_those_of_the_program_s_request(quarter_turn: fp.Problem) -> None:
    """A flight that a single stance meets has no request of a jump in its problem."""
    problem = replace(quarter_turn, jump=None)
    request = fp.JumpRequest(friction=0.05, margin={"torque": 0.5, "velocity": 1.0})
    limits = {
        "friction of FL_foot": ("friction", " that are allowed", 0.05),
        "torque of FL_calf_joint": ("torque", " N m that are allowed", 0.5 * problem.motor_torque_limits[2]),
        "rate of FL_calf_joint": ("velocity", " rad/s that are allowed", problem.velocity_limits[2]),
    }
    for label, (kind, unit, most) in limits.items():
        sentence = binding_sentence(BindingLimit(f"{label} (takeoff)", kind, 1.0, 1.0), problem, request)
        assert sentence == f"{label} (takeoff), with all of the {most:.3g}{unit}"


def test_a_leeway_and_a_least_force_bind_as_they_were_asked_for(quarter_turn: fp.Problem) -> None:
    assert quarter_turn.jump is not None
    request = replace(quarter_turn.jump, leeway=0.125, least_force=0.0625)
    tight = spatial_setup(replace(quarter_turn, jump=request), request).program(replace(MARGINS, refinement=0.4))
    said = set()
    for index in range(1, tight.nodes - 1, 6):
        raw = guess(tight)
        begin = int(tight.begins[index])
        raw[begin + 3] = tight.box[1][begin + 3]
        raw[begin + 3 * tight.model.size + 2 :: 3][: len(tight.kinds[index].bearing)] = request.least_force
        raw[begin + 2 * tight.model.size + 2] = -20.0  # m/s^2, faster than it falls: forces would have to pull
        limits = binding_limits(tight, raw)
        said |= {binding_sentence(limit, quarter_turn, request).partition(" (")[0] for limit in limits}
    assert "leeway of the base's first angle" in said
    assert any(sentence.startswith("least force of ") for sentence in said)
    limit = BindingLimit("leeway of the base's last angle (flight)", "leeway", 6.4, 1.0)  # of a roll, near its goal
    sentence = binding_sentence(limit, quarter_turn, request)
    assert sentence == "leeway of the base's last angle (flight), with all of the 0.125 rad that are allowed"
    limit = BindingLimit("least force of FL_foot (landing)", "least force", 0.0625, 1.0)
    sentence = binding_sentence(limit, quarter_turn, request)
    assert sentence == "least force of FL_foot (landing), which ends at 0.0625 of the weight"


def test_the_tilt_of_the_base_binds(quarter_turn: fp.Problem) -> None:
    """Where its middle angle, in flight, is as large as it may be, either way, and has the rate to become larger."""
    assert quarter_turn.jump is not None
    margins = replace(MARGINS, refinement=0.4, tilt=0.375)
    program = spatial_setup(quarter_turn, quarter_turn.jump).program(margins)
    node = (program.flight_nodes.start + program.flight_nodes.stop) // 2
    for way in (-1.0, 1.0):
        raw = guess(program)
        raw[program.begins[node] + 4] = way * 0.375
        raw[program.begins[node - 1] + program.model.size + 4] = way * 20.0  # rad/s, at the node before
        (limit,) = binding_limits(program, raw)
        sentence = binding_sentence(limit, quarter_turn, quarter_turn.jump)
        assert sentence == "tilt of the base's middle angle (flight), with all of the 0.375 rad that are allowed"


def test_the_speed_of_an_impact_binds_as_it_was_asked_for(quarter_turn: fp.Problem) -> None:
    """So do rates of joints just before it."""
    assert quarter_turn.jump is not None
    landing = replace(quarter_turn.jump.landing, impact=0.375)
    request = replace(quarter_turn.jump, landing=landing)
    program = spatial_setup(replace(quarter_turn, jump=request), request).program(replace(MARGINS, refinement=0.4))
    raw = guess(program)
    raw[program.arrival.rates[2]] = -2.0  # m/s, with all of its feet, faster than they may land
    raw[program.arrival.rates[8]] = program.bounds.velocity[2]
    said = [binding_sentence(limit, quarter_turn, request) for limit in binding_limits(program, raw)]
    assert any(
        re.fullmatch(r"impact of \w+ \(touchdown\), with all of the 0.375 m/s that are allowed", one) for one in said
    )
    limit = BindingLimit("rate of FL_calf_joint (touchdown)", "velocity", 1.0, 1.0)
    assert "rad/s" in binding_sentence(limit, quarter_turn, request)


def test_how_fast_all_feet_let_it_come_down(root: Path) -> None:
    """As fast as a calf folds, by Pinocchio's Jacobians; a jump that is no deeper than that fall is not warned of."""
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "go2_down.toml")
    robot = problem.robot
    request = problem.jump
    assert request is not None

    def sentence(height: float) -> str:
        changed = replace(request, takeoff=replace(request.takeoff, height=height))
        return touchdown_sentence(spatial_setup(problem, changed))

    words = re.search(
        r"with 13\.8 rad/s of (\w+), .* with (\S+) m/s .* a fall of (\S+) m; let it jump down less, or land",
        sentence(0.25),
    )
    assert words is not None
    data = robot.model.createData()
    q = robot.configuration(spatial_setup(problem, request).ends.y[1, 6:])
    pin.computeJointJacobians(robot.model, data, q)
    pin.updateFramePlacements(robot.model, data)
    rates = np.empty(0)
    for index, leg in enumerate(("FL", "FR", "RL", "RR")):
        frame = robot.model.getFrameId(f"{leg}_foot")
        own = pin.getFrameJacobian(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        rates = np.append(rates, np.linalg.solve(own[:, 6 + 3 * index : 9 + 3 * index], own[:, 2]))
    speed = (0.88 * problem.velocity_limits / np.abs(rates)).min()
    assert robot.joints[int(np.argmax(np.abs(rates) / problem.velocity_limits))][2:] == words[1][2:]
    assert float(words[2]) == pytest.approx(speed, abs=0.05)
    assert float(words[3]) == pytest.approx(speed**2 / (2 * 9.81), abs=0.005)
    assert sentence(0.95 * speed**2 / (2 * 9.81)) == ""


@pytest.mark.long
def test_what_was_made_too_small_binds(quarter_turn: fp.Problem) -> None:
    """A robot whose joints are four times as slow does not rise fast enough for a flight as long as is required."""
    slow = (0.25 * np.asarray(quarter_turn.velocity_limits)).tolist()
    problem = replace(quarter_turn, limits=replace(quarter_turn.limits, velocity=slow))
    assert problem.jump is not None
    coarse = spatial_setup(problem, problem.jump).program(replace(MARGINS, refinement=0.25))
    solution = coarse.solve(guess(coarse), tight_solves=1)  # more of them end where it does
    assert not solution.converged
    limits = binding_limits(coarse, solution.raw)
    kinds = [limit.kind for limit in limits]
    assert "velocity" in kinds, limits
    assert "friction" not in kinds, limits
