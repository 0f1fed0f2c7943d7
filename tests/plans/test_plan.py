"""A plan as a motion: its states against Pinocchio called directly, its peaks against dense evaluation."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pinocchio as pin
import proof_reference
import pytest
from flight_reference import drawn_plan, random_coefficients
from independent import Look
from long_cases import cases
from proof_plans import example_b
from robot_free_flyer import relative_error
from robot_samples import CHAIN_NAMES, URDF_FOLDER
from scipy.integrate import simpson

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.motion.dynamics import Ballistics
from floatplan.plans.plan import rebuild

DURATION = 1.3
TIMES = np.linspace(0, DURATION, 8)
PATH = Ballistics(read_only([0.3, 1.1]), read_only([-0.4, 5.0]), 9.81)


def drawn(robot, seed=1, size=0.5):
    plan = drawn_plan(robot, random_coefficients(seed, len(robot.joints), size=size), -1.4, DURATION, 0.6)
    return replace(plan, ballistics=PATH)


def full_states(plan, state):
    """Configuration and velocity (nv,) of the planar model at each instant, the base where the plan has it."""
    robot = plan.robot
    for k in range(len(state.times)):
        full = robot.reference + robot.selection @ state.positions[k]
        full[:3] = *state.base_position[k], state.orientation[k]
        velocity = robot.selection @ state.velocities[k]
        velocity[2] = state.orientation_rate[k]
        yield full, velocity


class TestState:
    def test_joints_move_by_12(self, any_robot):
        plan = drawn(any_robot)
        state = plan.at(TIMES)
        expected = Look(plan, TIMES).joints
        for have, want in zip((state.positions, state.velocities, state.accelerations), expected, strict=True):
            assert relative_error(have, want) < 1e-13

    def test_center_of_mass_flies_freely(self, gymnast):
        state = drawn(gymnast).at(TIMES)
        assert state.com_position[:, 0] == pytest.approx(0.3 - 0.4 * TIMES)
        assert state.com_position[:, 1] == pytest.approx(1.1 + 5.0 * TIMES - 9.81 / 2 * TIMES**2)
        assert state.com_velocity == pytest.approx(np.stack((0 * TIMES - 0.4, 5.0 - 9.81 * TIMES), axis=1))

    @pytest.mark.parametrize("name", CHAIN_NAMES)
    def test_torques_move_the_robot_so(self, name):
        """Forward dynamics (Pinocchio's ABA, base free) under the torques gives the accelerations."""
        robot = fp.Robot.from_urdf(URDF_FOLDER / f"{name}.urdf")
        plan, data = drawn(robot), robot.model.createData()
        state = plan.at(TIMES)
        for k, (full, velocity) in enumerate(full_states(plan, state)):
            torques = robot.selection @ state.torques[k]
            accelerations = pin.aba(robot.model, data, full, velocity, torques)[3:]
            assert relative_error(accelerations, state.accelerations[k]) < 1e-9


class TestTimes:
    def test_one_time_and_many(self, gymnast):
        plan = drawn(gymnast)
        one, two, grid = (vars(plan.at(times)) for times in (0.5, [0.2, 0.5], np.full((2, 3), 0.5)))
        for name, values in one.items():
            size = () if name in ("times", "orientation", "orientation_rate", "angular_momentum") else values.shape[-1:]
            assert values.shape == size
            assert two[name].shape == (2, *size)
            assert grid[name].shape == (2, 3, *size)
            assert two[name][1] == pytest.approx(values, rel=1e-9, abs=1e-9)
            assert grid[name][1, 2] == pytest.approx(values, rel=1e-9, abs=1e-9)
        assert one["torques"].shape == (2,)
        assert not grid["torques"].flags.writeable

    @pytest.mark.parametrize("times", ["0.5", [0.5, "x"], None, 0.5j, [[0.1], [0.1, 0.2]], {}, True])
    def test_that_are_no_numbers_are_refused(self, gymnast, times):
        plan = drawn(gymnast)
        for function in (plan.at, plan.q):
            with pytest.raises(fp.InputError, match="must be a number or an array of numbers"):
                function(times)

    @pytest.mark.parametrize("times", [-0.01, DURATION + 0.01, [0.1, np.nan], np.inf, [0.5, -1e-6]])
    def test_outside_the_flight_are_refused(self, gymnast, times):
        with pytest.raises(fp.InputError, match=r"outside the flight, \[0, 1\.3\] s") as caught:
            drawn(gymnast).at(times)
        assert caught.value.element == "times"

    def test_states_are_read_only(self, gymnast):
        plan = drawn(gymnast)
        arrays = [value for value in vars(plan.at(TIMES)).values() if isinstance(value, np.ndarray)]
        assert len(arrays) == 12
        assert not any(array.flags.writeable for array in (*arrays, plan.peaks.torque, plan.peaks.velocity))
        with pytest.raises(FrozenInstanceError):
            plan.ok = False


def dense_peaks(values):
    """Largest magnitudes (n,) of values (N, n), with a parabola through the largest and its neighbours."""
    magnitudes = np.abs(values)
    at = np.clip(magnitudes.argmax(axis=0), 1, len(values) - 2)
    before, here, after = (magnitudes[at + k, np.arange(values.shape[1])] for k in (-1, 0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = here - (after - before) ** 2 / (8 * (after - 2 * here + before))
    return np.where(here >= np.maximum(before, after), vertex, np.maximum(before, after))


class TestPeaks:
    """Against Newton and Euler's equations of the bodies at 20001 instants; see proof_reference.py."""

    def assert_dense(self, plan):
        dense = proof_reference.evaluate(plan.robot, plan.record, np.linspace(0, plan.duration, 20001))
        assert plan.peaks.torque == pytest.approx(dense_peaks(dense.torques), rel=1e-6)
        assert plan.peaks.velocity == pytest.approx(dense_peaks(dense.velocities), rel=1e-6)

    @pytest.mark.parametrize(("seed", "size"), [(0, 0.5), (1, 0.5), (1, 2.0), (4, 2.0)])
    def test_of_torque_and_rate_are_those_of_a_dense_evaluation(self, gymnast, seed, size):
        self.assert_dense(drawn(gymnast, seed, size))

    def test_of_positions_are_a_share_of_the_range(self, gymnast):
        plan = drawn(gymnast, 0, 0.5)
        least, most = plan.problem.position_limits.T
        for index, used in enumerate(sorted(plan.utilisation, key=lambda use: use.joint)):
            share = (used.position_high - used.position_low) / (most - least)[index]
            assert used.range_used == pytest.approx(share)
            assert used.position_high == pytest.approx(plan.peaks.position[index].max())


OBSTACLES = {
    "circle": [{"kind": "circle", "center": [1.485, 3.342], "radius": 0.2}],
    "moving": [{"kind": "circle", "center": [0.0, 3.0], "radius": 0.1, "velocity": [1.5, 1.0]}],
    "wall": [{"kind": "half-plane", "point": [3.5, 0.0], "normal": [-1.0, 0.2]}],
    "bar": [{"kind": "capsule", "start": [1.5, 0.5], "end": [1.5, 1.4], "radius": 0.05}],
    "moving wall": [{"kind": "half-plane", "point": [3.5, 0.0], "normal": [-1.0, 0.2], "velocity": [0.2, -0.7]}],
    "moving bar": [{"kind": "capsule", "start": [1.5, 0.5], "end": [1.5, 1.4], "radius": 0.05, "velocity": [0.4, 0.1]}],
    "a point": [{"kind": "capsule", "start": [1.5, 0.5], "end": [1.5, 0.5], "radius": 0.05}],
    "window": [{"kind": "circle", "center": [1.2, 4.5], "radius": 0.05, "window": [0.21, 0.63]}],
    "two": [
        {"kind": "circle", "center": [1.2, 5.5], "radius": 0.1},
        {"kind": "capsule", "start": [0.5, 0.1], "end": [1.5, 0.1], "radius": 0.05, "window": [0.3, 2.0]},
    ],
}


class TestClearance:
    @pytest.mark.parametrize("name", cases(OBSTACLES, {"moving", "bar", "a point"}))
    def test_is_that_of_a_dense_evaluation(self, name):
        record = example_b(obstacles=OBSTACLES[name])
        plan = rebuild(record)
        times = np.linspace(0, plan.duration, 14001)  # 0.1 ms: ends of windows among them
        dense = proof_reference.evaluate(plan.robot, record, times)
        distances = [proof_reference.clearance(plan.robot, record, dense, item) for item in OBSTACLES[name]]
        expected = np.min(distances, axis=0)
        found = plan.clearances(times)
        assert np.isfinite(found).tolist() == np.isfinite(expected).tolist()
        apart = np.isfinite(expected) & (expected > 0)
        assert np.abs(found[apart] - expected[apart]).max() < 1e-9
        assert plan.peaks.clearance <= expected.min() + 1e-9
        assert plan.peaks.clearance == pytest.approx(expected.min(), abs=1e-6)

    def test_does_not_exist_without_obstacles(self, gymnast):
        plan = drawn(gymnast)
        assert plan.peaks.clearance is None
        assert np.isinf(plan.clearances(TIMES)).all()


class TestObjective:
    @pytest.mark.parametrize("name", ["coefficients", "torque", "acceleration"])
    def test_value_is_the_norm_or_the_integral_of_squares(self, gymnast, name):
        plan = drawn(gymnast)
        problem = plan.problem
        asked = fp.Problem(
            gymnast, problem.start, problem.goal, problem.flight, fp.Motion(objective=name), problem.limits
        )
        plan = replace(plan, problem=asked)
        times = np.linspace(0, DURATION, 2001)
        state = plan.at(times)
        expected = {
            "coefficients": np.sqrt((plan.coefficients**2).sum()),
            "torque": simpson((state.torques**2).sum(axis=1), x=times),
            "acceleration": simpson((state.accelerations**2).sum(axis=1), x=times),
        }
        assert plan.objective_value == pytest.approx(expected[name], rel=1e-8)
        assert plan.record.objective == {"name": name, "value": plan.objective_value}
