"""Gains by joint from a bandwidth: critical afloat, enough to stand with, and bounded by the delay of measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import GO2, backflip, roll

import floatplan as fp
from floatplan.errors import InputError
from floatplan.simulation.contact.shapes import feet_spheres
from floatplan.simulation.gains import (
    _bandwidth_inertia,
    _joint_inverse,
    fastest_bandwidth,
    gains_by_phase,
    held_modes,
    ringing_joints,
)
from floatplan.simulation.jump_run import PERIOD

BANDWIDTH = 90.0  # [rad/s]


def mass_matrix(jump: fp.Jump, posture: np.ndarray) -> np.ndarray:
    model = jump.problem.robot.model
    upper = np.triu(pin.crba(model, model.createData(), posture))
    return np.asarray(upper + np.triu(upper, 1).T)


@pytest.mark.parametrize("jump", [roll, backflip])
def test_the_fastest_mode_afloat_has_the_bandwidth(jump: object) -> None:
    """By another way than the gains': the mass matrix of the whole robot, with springs on its joints."""
    flown = jump()  # type: ignore[operator]
    posture = flown.at(flown.takeoff_time + 0.1).positions[0]
    stiffness = BANDWIDTH**2 * _bandwidth_inertia(_joint_inverse(flown.problem.robot.model, posture))
    mass = mass_matrix(flown, posture)
    springs = np.zeros_like(mass)
    base = len(mass) - len(stiffness)
    springs[base:, base:] = np.diag(stiffness)
    fastest = np.linalg.eigvals(np.linalg.solve(mass, springs)).real.max()
    assert fastest == pytest.approx(BANDWIDTH**2, rel=1e-9)


@pytest.mark.parametrize("jump", [roll, backflip])
def test_feet_that_stand_bear_the_joints(jump: object) -> None:
    """Accelerations for torques where feet stay in place: those of the equations with the feet's forces as unknowns."""
    flown = jump()  # type: ignore[operator]
    model = flown.problem.robot.model
    posture = flown.at(0.0).positions[0]
    spots = [(joint, place) for joint, place, _ in feet_spheres(flown).values()]
    mass = mass_matrix(flown, posture)
    data = model.createData()
    pin.computeJointJacobians(model, data, posture)
    pin.updateFramePlacements(model, data)
    rows = []
    for joint, place in spots:
        # In the world's axes, by the velocity field of the joint's body.
        jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMi[joint].rotation @ place
        rows.append(jacobian[:3] + np.cross(jacobian[3:].T, arm).T)
    held = np.concatenate(rows)
    count = len(held)
    equations = np.block([[mass, held.T], [held, np.zeros((count, count))]])
    inverse = _joint_inverse(model, posture, spots)
    base = len(mass) - len(inverse)
    torque = np.random.default_rng(0).standard_normal(len(inverse))
    right = np.concatenate((np.zeros(base), torque, np.zeros(count)))
    solved = np.linalg.lstsq(equations, right, rcond=None)[0][base : len(mass)]
    np.testing.assert_allclose(inverse @ torque, solved, rtol=1e-6, atol=1e-6 * np.abs(solved).max())


def test_gains_of_each_phase() -> None:
    """Critical in flight; legs that stand have enough not to fall over, the weight times its height; others less."""
    jump = roll()
    kinds = [phase.kind for phase in jump.phases]
    gains = gains_by_phase(jump, BANDWIDTH)
    in_air = gains[kinds.index("flight")]
    robot = jump.problem.robot
    np.testing.assert_allclose(in_air[1] / in_air[0], 2 / BANDWIDTH)
    assert (gains >= in_air).all()
    com = pin.centerOfMass(robot.model, robot.model.createData(), jump.at(0.0).positions[0])[2] - jump.ground
    falls_over = robot.mass * 9.81 * com
    shanks = [robot.model_joints.index(f"{leg}_calf_joint") for leg in ("FL", "FR", "RL", "RR")]
    for phase, (stiffness, _) in zip(jump.phases, gains, strict=True):
        stands = [f"{leg}_foot" in phase.contacts for leg in ("FL", "FR", "RL", "RR")]
        assert (stiffness[shanks] > falls_over).tolist() == stands


def test_faster_feedback_than_the_delay_allows_rings() -> None:
    """A joint of inertia 1 with critical gains, 4 ms late and constant in periods of 2 ms."""
    limit = fastest_bandwidth(4e-3, PERIOD)
    late = round(4e-3 / PERIOD)
    for share, rings in ((0.9, False), (1.1, True)):
        bandwidth = share * limit
        position, rate = 1.0, 0.0
        seen = [(0.0, 0.0)] * late
        swing = []
        for _ in range(600):
            seen.append((position, rate))
            old_position, old_rate = seen[-1 - late]
            torque = -(bandwidth**2) * old_position - 2 * bandwidth * old_rate
            position += PERIOD * rate + PERIOD**2 / 2 * torque
            rate += PERIOD * torque
            swing.append(abs(position))
        assert (max(swing[-100:]) > max(swing[:100])) is rings


@pytest.mark.parametrize("jump", [roll, backflip])
@pytest.mark.parametrize("late", [0, 1, 2, 5])
def test_modes_of_held_feedback_grow_as_errors_do(jump: Callable[[], fp.Jump], late: int) -> None:
    """By the robot's whole mass matrix, in small steps; gains and damping of each joint are drawn."""
    flown = jump()
    rng = np.random.default_rng(late)
    count = len(flown.problem.robot.model_joints)
    mass = mass_matrix(flown, flown.at(flown.takeoff_time + 0.1).positions[0])
    told = []
    for size in (0.3, 1.0, 4.0):
        gains = size * np.stack((rng.uniform(0.0, 80.0, count), rng.uniform(0.0, 1.0, count)))
        damping = rng.uniform(0.0, 0.1, count)
        factors, motions = held_modes(np.linalg.inv(mass)[-count:, -count:], damping, gains, late, PERIOD)
        growth, joint = simulated_growth(mass, damping, gains, late)
        assert growth == pytest.approx(factors.max(), rel=5e-3)
        assert factors.max() < 1.01 or motions[joint, np.argmax(factors)] > 0.3
        told.append(factors.max() > 1.0)
    assert True in told
    assert late > 2 or False in told


def simulated_growth(mass: np.ndarray, damping: np.ndarray, gains: np.ndarray, late: int) -> tuple[float, int]:
    """Growth in a period, over the last half of many, and the joint that moves most in the last ones."""
    substeps = 10
    step = PERIOD / substeps
    count = len(damping)
    of_torque = np.linalg.inv(mass)[:, -count:]
    position = np.random.default_rng(0).standard_normal(count)
    rate = np.zeros(count)
    seen = [(position, rate)] * (late + 1)
    sizes = []
    moved = np.zeros(count)
    periods = 800
    scale = 0.0  # logarithm of what the errors were divided by
    for number in range(periods):
        seen = [*seen[1:], (position, rate)]
        feedback = -(gains[0] * seen[0][0] + gains[1] * seen[0][1])
        for _ in range(substeps):
            halfway = rate + step / 2 * (of_torque @ (feedback - damping * rate))[-count:]
            acceleration = (of_torque @ (feedback - damping * halfway))[-count:]
            position = position + step * rate + step**2 / 2 * acceleration
            rate = rate + step * acceleration
        size = max(np.abs(position).max(), PERIOD * np.abs(rate).max())
        sizes.append(scale + np.log(size))
        if number >= periods - 50:
            moved = np.maximum(moved, np.abs(position) * np.exp(scale - sizes[periods // 2]))
        if size > 1e50 or size < 1e-50:
            scale += np.log(size)
            position, rate = position / size, rate / size
            seen = [(old_position / size, old_rate / size) for old_position, old_rate in seen]
    half = periods // 2
    window = 100  # periods, in which every mode swings
    grown = max(sizes[-window:]) - max(sizes[half - window : half])
    return float(np.exp(grown / half)), int(np.argmax(moved))


def test_joints_that_ring_are_named() -> None:
    """By a calf's little damping, by too much of a thigh's, without delay, and none where joints damp themselves."""
    jump = roll()
    names = jump.problem.robot.model_joints

    def ringing(thigh: float, calf: float, late: int, of_jump: fp.Jump = jump) -> set[str]:
        damping = [{"thigh": thigh, "calf": calf}.get(name.split("_")[1], 0.5) for name in names]
        return set(ringing_joints(of_jump, np.array([[40.0] * len(names), damping]), late, PERIOD))

    calves = {f"{leg}_calf_joint" for leg in ("FL", "FR", "RL", "RR")}
    assert ringing(0.5, 0.3, late=2) == set()
    assert calves <= ringing(0.5, 2.0, late=2)
    assert calves & ringing(4.0, 0.3, late=2), "calves swing where thighs have too much"
    assert ringing(1.0, 1.0, late=0) == set()
    assert calves <= ringing(1.0, 4.0, late=0), "torques that are held ring too"
    assert ringing(0.5, 0.3, late=100) == ringing(0.5, 0.3, late=10) != set()
    assert ringing(0.8, 0.8, late=2)
    damped = fp.Robot.from_urdf(GO2, base="free-flyer", reference="standing", damping=0.5)
    assert damped.model_joints == names
    assert not ringing(0.8, 0.8, 2, replace(jump, problem=replace(jump.problem, robot=damped)))


@pytest.mark.parametrize(("jump", "feedback"), [pytest.param(roll, 100.0, marks=pytest.mark.long), (backflip, 50.0)])
def test_a_robot_lands_with_gains_by_phase(jump: Callable[[], fp.Jump], feedback: float) -> None:
    """Late and noisy, with rotors that nobody knows and without; the gains are told."""
    flown = fp.replay_jump(jump(), 250.0, perturb="noise=0.1deg,delay=4ms", friction=0.85, gains=feedback)
    assert flown.landed
    assert not flown.ringing
    assert flown.corrected is not None
    assert flown.corrected.clean.all()
    assert flown.corrected.torque.max() < 1  # nothing rings
    assert "in flight" in flown.control
    assert f"feedback of {feedback:g} rad/s" in flown.control
    control = flown.to_dict()["control"]
    assert control["feedback"] == feedback
    assert np.shape(control["phase_gains"]) == (len(jump().phases), 2, 12)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"gains": 140.0, "perturb": "delay=4ms"}, "feedback: 140 rad/s ring where measurements are 4 ms late"),
        ({"gains": -1.0}, "feedback: -1.0 rad/s is not positive"),
    ],
)
def test_what_is_refused(options: dict[str, object], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        fp.replay_jump(roll(), **options)  # type: ignore[arg-type]


def test_a_replay_that_falls_names_what_rings() -> None:
    """With four times the damping that a light shank bears late; nothing is said of robots that stand."""
    fallen = fp.replay_jump(roll(), perturb="delay=3.9ms", friction=0.85, gains=(40.0, 4.0))
    assert not fallen.landed
    assert {"FL_calf_joint", "RR_calf_joint"} <= set(fallen.ringing)
    assert "; these ring in flight where measurements are 4 ms late: FL_hip_joint, FL_calf_joint, " in fallen.control
    assert "[robot] armature" in fallen.control
    assert fallen.to_dict()["control"]["ringing"] == list(fallen.ringing)
    standing = fp.replay_jump(roll(), perturb="delay=4ms,armature=0.02", friction=0.85, gains=(40.0, 1.0))
    assert standing.landed
    assert standing.ringing, "with the plan's own rotors, which are none"
    assert "ring" not in standing.control
    assert not fp.replay_jump(roll(), friction=0.85, gains=(40.0, 1.0)).ringing
