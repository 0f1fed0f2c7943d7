"""Gains by joint from a bandwidth: critical afloat, enough to stand with, and bounded by the delay of measurements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from jumps import backflip, roll

import floatplan as fp
from floatplan.errors import InputError
from floatplan.simulation.contact.shapes import feet_spheres
from floatplan.simulation.gains import (
    _bandwidth_inertia,
    _joint_inverse,
    fastest_bandwidth,
    gains_by_phase,
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
@pytest.mark.parametrize("by_phase", [False, True])
def test_joints_said_to_ring_do(jump: Callable[[], fp.Jump], by_phase: bool) -> None:
    """Errors of the robot that floats, of its whole mass matrix, 4 ms late and constant in periods, grow or vanish."""
    flown = jump()
    flight = [phase.kind for phase in flown.phases].index("flight")
    times = flown.takeoff_time + np.linspace(0.0, flown.timed_flights[0].plan.duration, 33)
    masses = [mass_matrix(flown, posture) for posture in flown.at(times).positions]
    count = len(flown.problem.robot.model_joints)
    mobility = np.mean([np.linalg.inv(mass)[-count:, -count:] for mass in masses], axis=0)
    of_phase = gains_by_phase(flown, 0.7 * fastest_bandwidth(4e-3, PERIOD))[flight]
    gains = of_phase if by_phase else np.repeat([[40.0], [1.0]], count, axis=1)
    told = []
    for share in (0.05, 0.2, 0.5, 0.8, 1.0, 1.5, 2.0, 5.0):
        ringing = ringing_joints(flown, share * gains, 4e-3, PERIOD)
        growth, largest = simulated_growth(mobility, share * gains)
        if abs(np.log(growth)) > 1.0:  # near the limit periods of 2 ms are no delay of 1 ms
            assert (growth > 1.0) == bool(ringing), (share, growth, ringing)
            told.append(bool(ringing))
        if growth > 1e3:
            assert flown.problem.robot.model_joints[largest] in ringing
    assert True in told
    assert False in told


def simulated_growth(mobility: np.ndarray, gains: np.ndarray) -> tuple[float, int]:
    """Of the largest error, from the first to the last fifth of 1.5 s; and the joint whose error that is at the end."""
    late = round(4e-3 / PERIOD)
    position = np.random.default_rng(0).standard_normal(len(mobility))
    rate = np.zeros_like(position)
    seen = [(position, rate)] * late
    errors = []
    for _ in range(round(1.5 / PERIOD)):
        seen.append((position, rate))
        old_position, old_rate = seen[-1 - late]
        acceleration = -mobility @ (gains[0] * old_position + gains[1] * old_rate)
        position = position + PERIOD * rate + PERIOD**2 / 2 * acceleration
        rate = rate + PERIOD * acceleration
        errors.append(np.abs(position))
    sizes = np.max(errors, axis=1)
    fifth = len(sizes) // 5
    return float(sizes[-fifth:].max() / sizes[:fifth].max()), int(np.argmax(errors[-1]))


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
    """With ten times the damping of a light shank; not where nothing is late."""
    flown = fp.replay_jump(roll(), perturb="delay=4ms", friction=0.85, gains=(40.0, 4.0))
    assert not flown.landed
    assert {"FL_calf_joint", "RR_calf_joint"} <= set(flown.ringing)
    assert "; measured 4 ms late, FL_hip_joint, " in flown.control
    assert " more ring with these gains" in flown.control
    assert "[robot] armature" in flown.control
    assert flown.to_dict()["control"]["ringing"] == list(flown.ringing)
    assert not fp.replay_jump(roll(), friction=0.85, gains=(40.0, 0.5)).ringing
