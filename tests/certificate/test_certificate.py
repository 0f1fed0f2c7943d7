"""What the certificate proves, refutes and leaves undecided."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import proof_reference as reference
import pytest
from places import URDF
from proof_plans import draw_coefficients, example_a, example_b, make_plan, unlimited
from proof_records import certify_record, finding

from floatplan.certificate.certificate import shapes_of
from floatplan.errors import InputError
from floatplan.robot.robot import Robot

GROUND = {"kind": "half-plane", "point": [0.0, 0.0], "normal": [0.0, 2.0], "margin": 0.0}
CIRCLE = {"kind": "circle", "center": [1.485, 3.342], "radius": 0.2, "margin": 0.0}


@pytest.fixture(scope="module")
def plan_a():
    return example_a()


@pytest.fixture(scope="module")
def plan_b():
    """Example B with the ground that the foot leaves and the hand reaches."""
    return example_b(obstacles=[GROUND, CIRCLE], grounded=True)


def with_limits(record, **limits):
    return replace(record, problem=record.problem | {"limits": record.problem["limits"] | limits})


def with_obstacles(record, *obstacles):
    robot = Robot.from_urdf(record.robot.urdf)
    ends = [min(max(end, 0.0), record.duration) for obstacle in obstacles for end in obstacle.get("window") or ()]
    dense = reference.evaluate(robot, record, np.unique([*np.linspace(0.0, record.duration, 2001), *ends]))
    clear = min(reference.clearance(robot, record, dense, obstacle).min() for obstacle in obstacles)
    problem = record.problem | {"obstacles": list(obstacles)}
    return replace(record, problem=problem, clearance_min=float(clear) if np.isfinite(clear) else None)


def test_example_a_is_proved(plan_a):
    certificate = certify_record(unlimited(plan_a))
    assert certificate.verdict == "proved"
    low, high = certificate.orientation_end
    assert low <= plan_a.orientation["end"] + 1e-12
    assert high >= plan_a.orientation["end"] - 1e-12
    assert high - low < 1e-11
    assert certificate.clearance_min is None
    assert certificate.subintervals < 200


def test_to_dict_holds_the_documented_keys(plan_b):
    values = certify_record(plan_b).to_dict()
    assert set(values) == {
        *("verdict", "orientation_end", "clearance_min", "torque_peak", "velocity_peak", "motor_torque_peak"),
        *("findings", "subintervals", "seconds", "attitude_bound"),
    }
    json.dumps(values, allow_nan=False)
    assert {"label", "verdict", "bound", "instant"} <= set(values["findings"][0])


def test_contact_with_the_ground_at_both_ends_is_proved(plan_b):
    certificate = certify_record(plan_b)
    assert certificate.verdict == "proved"
    assert -1e-10 < finding(certificate, "obstacles[0]").bound <= 1e-12


def test_sinking_into_the_ground_is_refuted(plan_b):
    lifted = with_obstacles(plan_b, GROUND | {"point": [0.0, 1e-6]})
    certificate = certify_record(lifted)
    assert certificate.verdict == "refuted"
    found = finding(certificate, "obstacles[0]")
    assert found.bound == pytest.approx(-1e-6, rel=1e-3)
    assert found.instant in (0.0, lifted.duration)


@pytest.mark.parametrize(
    ("name", "seed", "size"),
    [
        ("gymnast", 1, 0.3),
        pytest.param("acrobat", 2, 0.4, marks=pytest.mark.long),
        pytest.param("high_jumper", 3, 0.2, marks=pytest.mark.long),
        pytest.param("chain10", 4, 0.12, marks=pytest.mark.long),
    ],
)
def test_bounds_are_true_and_sharp(name, seed, size):
    """Proved clearance within 0.2 mm and torque peaks within 0.1 % of what 20 001 instants show."""
    robot = Robot.from_urdf(URDF / f"{name}.urdf")
    rng = np.random.default_rng(seed)
    obstacles = [
        {"kind": "circle", "center": [2.5, 2.6], "radius": 0.2, "margin": 0.0},
        {"kind": "capsule", "start": [-3.0, 1.0], "end": [-3.0, 2.0], "radius": 0.1, "margin": 0.0},
        {
            "kind": "circle",
            "center": [6.0, 2.0],
            "radius": 0.2,
            "velocity": [-2.0, 0.3],
            "window": [0.3, 0.6],
            "margin": 0,
        },
    ]
    coefficients = draw_coefficients(rng, len(robot.joints), 1.2, size)
    record = make_plan(robot, coefficients, duration=1.2, obstacles=obstacles, instants=20001, slack=1.01)
    certificate = certify_record(record)
    assert [item.label for item in certificate.findings if item.verdict != "proved"] == []
    dense = reference.evaluate(robot, record, np.linspace(0.0, 1.2, 20001))
    for index, obstacle in enumerate(obstacles):
        seen = reference.clearance(robot, record, dense, obstacle).min()
        assert seen - 1e-4 <= finding(certificate, f"obstacles[{index}]").bound <= seen + 1e-12
    for bound, seen in (
        (certificate.torque_peak, record.torque_peak),
        (certificate.velocity_peak, record.velocity_peak),
    ):
        assert (bound >= seen * (1 - 1e-12)).all()
        assert (bound <= seen * (1 + 1e-4)).all()


@pytest.mark.parametrize("quantity", ["torque", "velocity"])
def test_limits_active_to_a_millionth_are_decided(plan_a, quantity):
    peak = getattr(certify_record(plan_a), f"{quantity}_peak")
    assert certify_record(with_limits(plan_a, **{quantity: (peak * (1 + 1e-7)).tolist()})).verdict == "proved"
    refuted = certify_record(with_limits(plan_a, **{quantity: (peak * (1 - 3e-6)).tolist()}))
    assert refuted.verdict == "refuted"
    for joint, value in zip(plan_a.robot.joints, peak, strict=True):
        found = finding(refuted, f"{quantity} {joint}")
        assert found.verdict == "refuted"
        assert found.bound == pytest.approx(value, rel=1e-5)
        dense = reference.evaluate(Robot.from_urdf(plan_a.robot.urdf), plan_a, [0.0, max(found.instant, 1e-300)])
        seen = {"torque": dense.torques, "velocity": dense.velocities}[quantity]
        index = plan_a.robot.joints.index(joint)
        assert abs(seen[-1, index]) == pytest.approx(found.bound, rel=1e-6)


def test_orientation_rate_limit(plan_a):
    rate = plan_a.problem["limits"]["orientation_rate"] / 1.05
    assert certify_record(with_limits(plan_a, orientation_rate=rate * 1.0001)).verdict == "proved"
    assert (
        finding(certify_record(with_limits(plan_a, orientation_rate=rate * 0.999)), "orientation_rate").verdict
        == "refuted"
    )


def test_motor_limit(plan_a):
    dense = reference.evaluate(Robot.from_urdf(plan_a.robot.urdf), plan_a, np.linspace(0.0, 1.1, 8001))
    stall = (np.abs(dense.torques) + 0.3 * np.abs(dense.velocities)).max(0)

    def motor(factor):
        return {"q2": {"stall": float(stall[1] * factor), "slope": 0.3}}

    assert certify_record(with_limits(plan_a, motor=motor(1.0001))).verdict == "proved"
    assert finding(certify_record(with_limits(plan_a, motor=motor(0.9999))), "motor q2").verdict == "refuted"


def test_an_obstacle_counts_only_in_its_window(plan_b):
    hit = CIRCLE | {"center": [1.35, 3.0]}
    robot = Robot.from_urdf(plan_b.robot.urdf)
    dense = reference.evaluate(robot, plan_b, np.linspace(0.0, plan_b.duration, 8001))
    inside = dense.times[reference.clearance(robot, plan_b, dense, hit) < 0.0]
    assert certify_record(with_obstacles(plan_b, hit)).verdict == "refuted"
    before, after = float(inside.min()), float(inside.max())
    for window in ([0.0, before - 1e-3], [after + 1e-3, plan_b.duration], [after + 1e-3, 9.0]):
        assert certify_record(with_obstacles(plan_b, hit | {"window": window})).verdict == "proved"
    assert certify_record(with_obstacles(plan_b, hit | {"window": [-1.0, 0.0]})).verdict != "refuted"
    for window in (
        [0.0, before + 1e-3],
        [after - 1e-3, plan_b.duration],
        [0.5 * (before + after) - 1e-9, 0.5 * (before + after)],
    ):
        assert certify_record(with_obstacles(plan_b, hit | {"window": window})).verdict == "refuted"


def test_a_moving_obstacle_is_met_where_it_is(plan_b):
    """It stands in the way at t = 0.7 and nowhere near at t = 0; moving the other way it is never met."""
    robot = Robot.from_urdf(plan_b.robot.urdf)
    dense = reference.evaluate(robot, plan_b, np.linspace(0.0, plan_b.duration, 2001))
    body = reference.com(plan_b, dense.times)[1000]
    chaser = CIRCLE | {"center": [body.real + 2.1, body.imag], "velocity": [-3.0, 0.0]}
    assert certify_record(with_obstacles(plan_b, chaser)).verdict == "refuted"
    assert certify_record(with_obstacles(plan_b, chaser | {"velocity": [5.0, 0.0]})).verdict == "proved"


@pytest.mark.parametrize("window", [None, [0.0, 0.2]])
def test_a_thin_bar_across_a_link_from_the_start_is_refuted(plan_b, window):
    """No end of either segment is near the other: only their crossing tells."""
    hip = 0.2 * np.exp(1j * plan_b.orientation["start"])
    across = 1j * hip / abs(hip)
    start, end = hip - 0.3 * across, hip + 0.3 * across
    bar = {"kind": "capsule", "start": [start.real, start.imag], "end": [end.real, end.imag], "radius": 0.0}
    bar |= {"velocity": list(plan_b.com["velocity0"]), "window": window}
    assert finding(certify_record(with_obstacles(plan_b, bar)), "obstacles[0]").verdict == "refuted"


def test_self_clearance():
    robot = Robot.from_urdf(URDF / "chain10.urdf")
    coefficients = draw_coefficients(np.random.default_rng(6), 10, 1.0, 0.1)
    record = make_plan(robot, coefficients, duration=1.0)
    dense = reference.evaluate(robot, record, np.linspace(0.0, 1.0, 8001))
    links = [robot.tree.names[0], robot.tree.names[4]]
    ends = [reference.segments(robot, record, dense, [link])[:2] for link in links]
    nearest = reference.segment_segment(*(end[:, 0] for pair in ends for end in pair)).min()
    assert nearest > 0.01
    for margin, verdict in ((nearest - 1e-5, "proved"), (nearest + 1e-5, "refuted")):
        problem = record.problem | {"self_clearance": [{"links": links, "margin": float(margin)}]}
        certificate = certify_record(replace(record, problem=problem))
        assert finding(certificate, "self_clearance").verdict == verdict
        assert certificate.clearance_min is None


def test_a_robot_with_collision_elements_needs_shapes(plan_b, tmp_path):
    text = Path(plan_b.robot.urdf).read_text()
    collision = '<link name="body1"><collision><geometry><sphere radius="0.1"/></geometry></collision>'
    path = tmp_path / "clothed.urdf"
    path.write_text(text.replace('<link name="body1">', collision))
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    record = replace(plan_b, robot=replace(plan_b.robot, sha256=sha256))
    with pytest.raises(InputError, match="collision"):
        certify_record(record, path)
    assert (
        certify_record(replace(unlimited(record), problem=record.problem | {"obstacles": []}), path).clearance_min
        is None
    )


def test_capsules_of_a_quadruped():
    """A robot of example-robot-data, left and right legs coupled, with the capsules around its collision geometry."""
    sides, parts = (("FR", "FL"), ("RR", "RL")), ("thigh", "calf")
    coupled = {f"{right}_{part}_joint": f"{left}_{part}_joint" for right, left in sides for part in parts}
    robot = Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", coupled=coupled)
    limits = robot.position_limits
    obstacles = [
        {"kind": "circle", "center": [0.9, 2.4], "radius": 0.1},
        {"kind": "half-plane", "point": [0.0, -1.0], "normal": [0.1, 1.0]},
        {"kind": "capsule", "start": [-0.9, 0.0], "end": [-0.9, 1.0], "radius": 0.1},
    ]
    record = make_plan(
        robot,
        draw_coefficients(np.random.default_rng(3), 4, 0.8, 1.0),
        duration=0.8,
        angular_momentum=3.0,
        orientation=0.0,
        centre=limits.mean(1),
        amplitude=0.5 * np.ptp(limits, axis=1),
        obstacles=obstacles,
        instants=8001,
    )
    certificate = certify_record(record, shapes=shapes_of(robot))
    assert [item for item in certificate.findings if item.verdict == "undecided"] == []
    dense = reference.evaluate(robot, record, np.linspace(0.0, 0.8, 8001))
    for index, obstacle in enumerate(obstacles):
        seen = reference.clearance(robot, record, dense, obstacle).min()
        assert seen - 1e-4 <= finding(certificate, f"obstacles[{index}]").bound <= seen + 1e-9
    assert (np.abs(certificate.torque_peak / record.torque_peak - 1.0) < 1e-3).all()


def test_a_spent_budget_leaves_the_proof_undecided():
    robot = Robot.from_urdf(URDF / "gymnast.urdf")
    record = make_plan(robot, draw_coefficients(np.random.default_rng(1), 2, 1.1, 1.5), obstacles=[CIRCLE])
    certificate = certify_record(record, budget=24)
    assert certificate.verdict == "undecided"
    assert certificate.subintervals == 24
    undecided = [item for item in certificate.findings if item.verdict == "undecided"]
    assert undecided
    assert all("gap" in item.to_dict() for item in undecided)
    json.dumps(certificate.to_dict(), allow_nan=False)
    assert certify_record(record).verdict == "proved"


def test_another_urdf_is_refused(plan_a, tmp_path):
    path = tmp_path / "other.urdf"
    path.write_text(Path(plan_a.robot.urdf).read_text() + "\n")
    with pytest.raises(InputError, match="SHA-256"):
        certify_record(plan_a, path)
    with pytest.raises(InputError, match="no such file"):
        certify_record(plan_a, tmp_path / "none.urdf")
