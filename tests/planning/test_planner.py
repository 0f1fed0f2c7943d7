"""plan(): every problem file, generated problems, what cannot be flown and why; invariances."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import proof_reference
import pytest
from generated_problems import mixed_problem
from independent import Look
from long_cases import cases
from robot_samples import GYMNAST, URDF_FOLDER

import floatplan as fp

PROBLEMS = sorted(path.stem for path in (URDF_FOLDER.parent / "problems").glob("*.toml"))
PATIENT = 60  # s, where nothing but a neighbour's load could use up the default budget
CIRCLE = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)  # that of example B, where DESIGN.md has it


def assert_meets_its_ends(plan):
    """Boundary conditions (13), and the goal's orientation by an independent integration."""
    problem = plan.problem
    look = Look(plan, np.array([0.0, plan.duration]))
    for index, state in enumerate((problem.initial, problem.final)):
        found = [each[index] for each in look.joints]
        assert np.abs(np.subtract(found, (state.positions, state.velocities, state.accelerations))).max() < 1e-10
    assert abs(look.orientation[1] - problem.final.orientation) < 1e-9


@lru_cache(maxsize=8)
def dense(plan):
    """The flight at 20001 instants by Newton and Euler's equations of the bodies."""
    return proof_reference.evaluate(plan.robot, plan.record, np.linspace(0, plan.duration, 20_001))


def change(problem, **changes):
    """The problem with some of its parts, or some values of its flight, replaced."""
    names = ("robot", "start", "goal", "flight", "motion", "limits", "obstacles", "self_clearances", "name")
    parts = {name: getattr(problem, name) for name in names}
    flight = {key: changes.pop(key) for key in list(changes) if key not in parts}
    parts["flight"] = replace(problem.flight, **flight)
    return fp.Problem(**(parts | changes))


@pytest.fixture(scope="session")
def example_a(root):
    return fp.load_problem(root / "problems" / "new_configuration.toml")


@pytest.fixture(scope="session")
def handstand(root):
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="session")
def example_b(handstand):
    return change(handstand, obstacles=(CIRCLE,))


@pytest.fixture(scope="session")
def gentle(example_a):
    """Example A by the least accelerations."""
    return fp.plan(change(example_a, motion=fp.Motion(7, "acceleration")), budget=PATIENT)


@pytest.mark.parametrize("seed", cases(range(60), range(10, 60)))
def test_generated_problem_is_solved(seed):
    """The first 60 of the 300; every third one moves at its ends. Defaults, but for the clock of a busy machine."""
    plan = fp.plan(mixed_problem(seed), budget=PATIENT)
    assert plan.ok, plan.explanation
    assert_meets_its_ends(plan)


class TestObjectives:
    @pytest.mark.parametrize("name", ["torque", "acceleration"])
    def test_are_lower_where_they_are_asked_for(self, planned, example_a, name):
        best = fp.plan(change(example_a, motion=fp.Motion(7, name)))
        assert best.ok
        assert_meets_its_ends(best)
        other = replace(planned("new_configuration"), problem=best.problem)
        assert best.objective_value < 0.999 * other.objective_value


class TestLimits:
    """What is asked is kept at 20001 instants; the plan without limits would not keep it, another known motion does."""

    @pytest.fixture
    def free(self, planned):
        return dense(planned("new_configuration"))

    @pytest.fixture
    def known(self, gentle):
        return dense(gentle)

    def assert_kept(self, problem, free, largest, limit):
        """``largest`` (n,) of a state, not above ``limit``."""
        plan = fp.plan(problem, budget=PATIENT)
        assert plan.ok, plan.explanation
        assert_meets_its_ends(plan)
        assert (largest(dense(plan)) <= np.multiply(limit, 1 + 1e-6)).all()
        assert (largest(free) > np.multiply(limit, 1.01)).any()

    def test_of_torque(self, planned, example_a, free):
        limit = 0.8 * planned("new_configuration").peaks.torque
        problem = change(example_a, limits=fp.Limits("full", torque=limit))
        self.assert_kept(problem, free, lambda state: np.abs(state.torques).max(axis=0), limit)
        assert np.linalg.norm(fp.plan(problem, budget=PATIENT).coefficients) < 27.0

    def test_of_velocity(self, example_a, free, known):
        def largest(state):
            return np.abs(state.velocities).max(axis=0)

        limit = 1.03 * largest(known)
        self.assert_kept(change(example_a, limits=fp.Limits("full", velocity=limit)), free, largest, limit)

    def test_of_orientation_rate(self, example_a, free, known):
        def largest(state):
            return np.abs(state.rate).max()

        limit = 1.03 * float(largest(known))
        self.assert_kept(change(example_a, limits=fp.Limits("full", orientation_rate=limit)), free, largest, limit)

    def test_of_motors(self, example_a, free, known):
        def largest(state):
            return (np.abs(state.torques) + 0.2 * np.abs(state.velocities)).max(axis=0)

        limit = 1.03 * largest(known)
        motors = {joint: fp.Motor(float(stall), 0.2) for joint, stall in zip(("q1", "q2"), limit, strict=True)}
        self.assert_kept(change(example_a, limits=fp.Limits("full", motor=motors)), free, largest, limit)


@pytest.fixture(scope="session")
def plain(example_b):
    return fp.plan(example_b, budget=PATIENT)


class TestInvariance:
    """Example B with its obstacle, written otherwise."""

    def test_translation(self, example_b, plain):
        x, y = 5.0, -3.0
        moved = change(
            example_b,
            takeoff=fp.Takeoff("foot", (x, y)),
            landing=fp.Landing("hand", y),
            obstacles=(replace(CIRCLE, center=(CIRCLE.center[0] + x, CIRCLE.center[1] + y)),),
        )
        plan = fp.plan(moved)
        assert plan.coefficients == pytest.approx(plain.coefficients, abs=1e-9)
        times = np.linspace(0, 1.4, 5)
        assert plan.at(times).com_position - [x, y] == pytest.approx(plain.at(times).com_position, abs=1e-9)

    def test_mirror_image(self, example_b, plain):
        """Left and right exchanged: angles from the other horizontal direction, the other way about."""

        def mirrored(state):
            return fp.Posture(np.pi - state.orientation, -state.positions)

        image = change(
            example_b,
            start=mirrored(example_b.initial),
            goal=mirrored(example_b.final),
            horizontal_velocity=-2.0,
            obstacles=(replace(CIRCLE, center=(-CIRCLE.center[0], CIRCLE.center[1])),),
        )
        plan = fp.plan(image)
        assert plan.coefficients == pytest.approx(-plain.coefficients, abs=1e-9)
        assert plan.angular_momentum == pytest.approx(-plain.angular_momentum, rel=1e-12)
        times = np.linspace(0, 1.4, 5)
        assert plan.at(times).torques == pytest.approx(-plain.at(times).torques, abs=1e-9)
        assert plan.at(times).com_position * [-1, 1] == pytest.approx(plain.at(times).com_position, abs=1e-9)

    def test_masses_scaled(self, example_b, plain, tmp_path):
        """The same motion, with as many times the angular momentum and the torques."""
        factor = 3.7

        def scaled(match):
            return f'{match[1]}="{float(match[2]) * factor!r}"'

        robot = written(tmp_path, re.sub(r'(value|i[xyz][xyz])="([^"]+)"', scaled, GYMNAST))
        assert robot.mass == pytest.approx(factor * 6.5)
        plan = fp.plan(change(example_b, robot=robot))
        assert plan.coefficients == pytest.approx(plain.coefficients, abs=1e-9)
        assert plan.angular_momentum == pytest.approx(factor * plain.angular_momentum, rel=1e-9)
        assert plan.peaks.torque == pytest.approx(factor * plain.peaks.torque, rel=1e-9)


def written(folder, text):
    path = folder / "robot.urdf"
    path.write_text(text)
    return fp.Robot.from_urdf(path)
