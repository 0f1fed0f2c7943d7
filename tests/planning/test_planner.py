"""plan(): every problem file, generated problems, what cannot be flown and why; invariances."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import proof_reference
import pytest
from generated_problems import mixed_problem, random_problem
from independent import Look
from long_cases import cases
from robot_samples import GYMNAST, URDF_FOLDER, flipped_axes, other_plane

import floatplan as fp
from floatplan.planning import search
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.search import Search

PROBLEMS = sorted(path.stem for path in (URDF_FOLDER.parent / "problems").glob("*.toml"))
PATIENT = 60  # s, where nothing but a neighbour's load could use up the default budget
CIRCLE = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)  # that of example B, where DESIGN.md has it


def assert_meets_its_ends(plan: fp.Plan) -> None:
    """Boundary conditions (13), and the goal's orientation by an independent integration."""
    problem = plan.problem
    look = Look(plan, np.array([0.0, plan.duration]))
    for index, state in enumerate((problem.initial, problem.final)):
        found = [each[index] for each in look.joints]
        assert np.abs(np.subtract(found, (state.positions, state.velocities, state.accelerations))).max() < 1e-10
    assert abs(look.orientation[1] - problem.final.orientation) < 1e-9


@lru_cache(maxsize=8)
def dense(plan: fp.Plan) -> proof_reference.Dense:
    """The flight at 20001 instants by Newton and Euler's equations of the bodies."""
    return proof_reference.evaluate(plan.robot, plan.record, np.linspace(0, plan.duration, 20_001))


def change(problem: fp.Problem, **changes) -> fp.Problem:
    """The problem with some of its parts, or some values of its flight, replaced."""
    names = ("robot", "start", "goal", "flight", "motion", "limits", "obstacles", "self_clearances", "name")
    parts = {name: getattr(problem, name) for name in names}
    flight = {key: changes.pop(key) for key in list(changes) if key not in parts}
    parts["flight"] = replace(problem.flight, **flight)
    return fp.Problem(**(parts | changes))


@pytest.fixture(scope="session")
def example_a(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "new_configuration.toml")


@pytest.fixture(scope="session")
def handstand(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="session")
def example_b(handstand) -> fp.Problem:
    return change(handstand, obstacles=(CIRCLE,))


@pytest.fixture(scope="session")
def gentle(example_a) -> fp.Plan:
    """Example A by the least accelerations."""
    return fp.plan(change(example_a, motion=fp.Motion(7, "acceleration")), budget=PATIENT)


@pytest.mark.parametrize("name", PROBLEMS)
class TestProblemFiles:
    def test_plans(self, planned, name):
        plan = planned(name)
        assert plan.ok
        assert plan.status in ("optimal", "feasible")
        assert plan.explanation
        assert_meets_its_ends(plan)

    def test_starts_and_ends_where_it_is_asked_to(self, planned, name):
        plan = planned(name)
        state, problem = plan.at([0, plan.duration]), plan.problem
        assert state.orientation == pytest.approx([problem.initial.orientation, problem.final.orientation], abs=1e-9)
        for values, attribute in ((state.positions, "positions"), (state.velocities, "velocities")):
            expected = [getattr(end, attribute) for end in (problem.initial, problem.final)]
            assert values == pytest.approx(np.stack(expected), abs=1e-10)

    def test_momentum_is_constant(self, planned, name):
        plan = planned(name)
        state = plan.at(np.linspace(0, plan.duration, 101))
        size = max(
            abs(plan.angular_momentum),
            np.abs(plan.dynamics.momentum_map(state.positions)[:, 1:] * state.velocities).max(),
        )
        assert np.abs(state.angular_momentum - plan.angular_momentum).max() < 1e-11 * size

    def test_joints_stay_in_their_ranges(self, planned, name):
        plan = planned(name)
        positions, _, _ = plan.joint_motion(np.linspace(0, plan.duration, 2001))
        low, high = plan.problem.position_limits.T
        assert (positions >= low - 1e-12).all()
        assert (positions <= high + 1e-12).all()


class TestExamples:
    def test_a_is_the_optimum_known(self, planned):
        assert np.linalg.norm(planned("new_configuration").coefficients) == pytest.approx(25.0411, abs=5e-5)
        assert planned("new_configuration").status == "optimal"

    def test_b_without_its_obstacle_is_no_worse_than_every_solver_s(self, planned):
        assert np.linalg.norm(planned("handstand").coefficients) < 30.1308

    def test_b_with_its_obstacle(self, plain):
        plan = plain
        assert plan.ok
        assert np.linalg.norm(plan.coefficients) <= 29.48
        assert plan.peaks.clearance >= 0.02 - 1e-7
        assert plan.clearances(np.linspace(0, 1.4, 20_001)).min() >= 0.02 - 1e-7
        assert_meets_its_ends(plan)

    def test_b_without_it_would_have_collided(self, planned, example_b):
        assert replace(planned("handstand"), problem=example_b).peaks.clearance < 0.01


@pytest.mark.parametrize("seed", cases(range(60), range(10, 60)))
def test_generated_problem_is_solved(seed):
    """The first 60 of the 300; every third one moves at its ends. Defaults, but for the clock of a busy machine."""
    plan = fp.plan(mixed_problem(seed), budget=PATIENT)
    assert plan.ok, plan.explanation
    assert_meets_its_ends(plan)


class TestDeterminism:
    def test_the_same_seed_gives_the_same_plan(self):
        """From random starts: the plain one does not do here."""
        problem = random_problem(5, 2)
        first, second = (fp.plan(problem, seed=3, budget=PATIENT) for _ in range(2))
        assert first.solver["starts"] > 1
        assert first.coefficients.tobytes() == second.coefficients.tobytes()
        assert first.angular_momentum == second.angular_momentum
        assert {**first.solver, "seconds": 0} == {**second.solver, "seconds": 0}

    def test_another_seed_solves_it_too(self):
        plan = fp.plan(random_problem(5, 2), seed=1, budget=PATIENT)
        assert plan.ok
        assert plan.solver["seed"] == 1
        assert_meets_its_ends(plan)

    def test_more_starts_are_no_worse(self, handstand):
        quick, thorough = (fp.plan(handstand, starts=starts, budget=PATIENT) for starts in (1, 4))
        assert thorough.solver["solved"] >= 4
        assert np.linalg.norm(thorough.coefficients) <= np.linalg.norm(quick.coefficients) + 1e-6


class TestFreeMomentum:
    def test_is_at_least_as_good_as_the_midpoint(self, planned, example_a):
        free = fp.plan(change(example_a, angular_momentum="free"))
        assert free.ok
        assert_meets_its_ends(free)
        low, high = free.angular_momentum_bounds
        assert low <= free.angular_momentum <= high
        midpoint = np.linalg.norm(planned("new_configuration_midpoint").coefficients)
        assert np.linalg.norm(free.coefficients) <= midpoint + 1e-6


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

    def test_of_ground_touched_at_both_ends(self, example_b):
        """Clearance 0 of the foot at takeoff and of the hand at landing."""
        plan = fp.plan(change(example_b, obstacles=(CIRCLE, fp.HalfPlane())))
        assert plan.ok, plan.explanation
        clearance = plan.clearances(np.linspace(0, 1.4, 20_001))
        assert clearance[[0, -1]] == pytest.approx(0, abs=1e-9)
        assert clearance.min() > -1e-7


@pytest.fixture(scope="session")
def impossible(example_a, handstand, planned):
    """Problems that no motion solves: name -> (problem, what the explanation must say)."""
    peaks = planned("new_configuration").peaks
    half_way = fp.plan(handstand).at(0.7).com_position
    turned = abs(example_a.final.orientation - example_a.initial.orientation) / example_a.flight.duration
    moved = np.abs(example_a.final.positions - example_a.initial.positions) / example_a.flight.duration

    def limited(**limits):
        return change(example_a, limits=fp.Limits("full", **limits))

    def beside(**obstacle):
        return change(handstand, obstacles=(fp.Circle(**obstacle),))

    crossing = {"center": tuple(half_way), "radius": 1.6, "window": (0.65, 0.75)}
    return {
        "obstacle over the start": (beside(center=(0.1, 0.2), radius=0.2), "At takeoff the start itself is impossible"),
        "obstacle over the goal": (beside(center=(2.8, 0.5), radius=0.4), "At landing the goal itself is impossible"),
        "obstacle that cannot be passed": (beside(**crossing), "cannot be passed whatever the posture"),
        "links that touch": (
            change(handstand, self_clearances=(fp.SelfClearance(("body0", "body1"), 0.05),)),
            "clearance of body0 to body1",
        ),
        "a tenth of the torque": (limited(torque=0.1 * peaks.torque), "torque of q1 is violated"),
        "half the rate": (limited(velocity=0.5 * moved), "velocity of q1 is violated"),
        "half the orientation rate": (limited(orientation_rate=0.5 * turned), "orientation rate is violated"),
        "motors too weak": (
            limited(motor={"q1": fp.Motor(0.1 * float(peaks.torque[0]), 0.01)}),
            "speed-dependent torque of q1 is violated",
        ),
        "h far outside (9)": (
            change(handstand, angular_momentum=40.0),
            "lies outside the interval of motions that do not turn back",
        ),
        "degree 5": (change(example_a, motion=fp.Motion(5)), "Degree 5 leaves nothing free to steer with"),
    }


IMPOSSIBLE = (
    "obstacle over the start",
    "obstacle over the goal",
    "obstacle that cannot be passed",
    "links that touch",
    "a tenth of the torque",
    "half the rate",
    "half the orientation rate",
    "motors too weak",
    "h far outside (9)",
    "degree 5",
)


class TestImpossible:
    @pytest.mark.usefixtures("little_work")
    @pytest.mark.parametrize("name", IMPOSSIBLE)
    def test_is_said_to_be_and_why(self, impossible, name, tmp_path):
        problem, reason = impossible[name]
        plan = fp.plan(problem)
        assert (plan.ok, plan.status) == (False, "infeasible")
        assert reason in plan.explanation
        again = fp.load_plan(plan.save(tmp_path / "plan.json"))
        assert (again.ok, again.explanation) == (False, plan.explanation)

    @pytest.mark.usefixtures("little_work")
    def test_violation_is_as_large_as_it_says(self, impossible):
        problem, _ = impossible["a tenth of the torque"]
        plan = fp.plan(problem)
        said = re.search(r"torque of (q\d) is violated by ([\d.]+) N m at t = ([\d.]+) s", plan.explanation)
        joint, amount, time = int(said[1][1]) - 1, float(said[2]), float(said[3])
        torque = np.abs(plan.at(time).torques[joint])
        assert torque - problem.torque_limits[joint] == pytest.approx(amount, rel=1e-3)

    def test_missing_the_orientation_is_as_much_as_it_says(self, impossible):
        plan = fp.plan(impossible["degree 5"][0])
        said = float(re.search(r"misses the goal's orientation by ([-+\d.e]+) rad", plan.explanation)[1])
        end = Look(plan, np.array([plan.duration])).orientation[0]
        assert end - plan.problem.final.orientation == pytest.approx(said, rel=1e-4)

    @pytest.mark.usefixtures("little_work")
    @pytest.mark.parametrize("h", [-40.0, 3.0, 10.0])
    def test_what_is_called_a_plan_is_one(self, handstand, h):
        """Far outside (9) the search once met the goal on its 256 quadrature nodes, and nowhere between."""
        plan = fp.plan(change(handstand, angular_momentum=h))
        if plan.ok:
            assert_meets_its_ends(plan)


class TestArguments:
    @pytest.mark.parametrize(("name", "value"), [("starts", 0), ("budget", 0), ("budget", -1.0)])
    def test_that_are_not_positive_are_refused(self, example_a, name, value):
        with pytest.raises(fp.InputError) as caught:
            fp.plan(example_a, **{name: value})
        assert caught.value.element == name

    @pytest.mark.usefixtures("little_work")
    def test_progress_is_told(self, impossible, monkeypatch):
        monkeypatch.setattr(search, "ANNOUNCED_EVERY", 0.0)
        told = []
        fp.plan(impossible["a tenth of the torque"][0], progress=told.append)
        assert told
        assert "starts tried" in told[-1]

    def test_interruption_keeps_the_best_so_far(self, impossible, monkeypatch):
        attempts = Search.follow_numbered

        def interrupted(self, degrees, given, numbers, *rest):
            if numbers.start:
                raise KeyboardInterrupt
            return attempts(self, degrees, given, numbers, *rest)

        monkeypatch.setattr(Search, "follow_numbered", interrupted)
        problem = impossible["h far outside (9)"][0]
        plan = fp.plan(
            replace(problem, limits=replace(problem.limits, torque=1e3))
        )  # else the kernel follows all at once
        assert not plan.ok
        assert (plan.status, plan.explanation[:26]) == ("interrupted", "The search was interrupted")
        assert plan.solver["starts"] == 1


@pytest.fixture(scope="session")
def plain(example_b) -> fp.Plan:
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

    def test_joint_axes_flipped(self, example_b, plain, tmp_path):
        """About the opposite normal, all angles have the other sign."""
        robot = written(tmp_path, flipped_axes(GYMNAST))
        assert robot.plane.turn == -1
        flipped = change(
            example_b,
            robot=robot,
            start=fp.Posture(-example_b.initial.orientation, -example_b.initial.positions),
            goal=fp.Posture(-example_b.final.orientation, -example_b.final.positions),
        )
        plan = fp.plan(flipped)
        assert plan.coefficients == pytest.approx(-plain.coefficients, abs=1e-9)
        times = np.linspace(0, 1.4, 5)
        assert plan.clearances(times) == pytest.approx(plain.clearances(times), abs=1e-9)

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

    def test_other_plane(self, example_b, plain, tmp_path):
        robot = written(tmp_path, other_plane(GYMNAST))
        assert robot.plane.name == "yz"
        plan = fp.plan(change(example_b, robot=robot))
        assert plan.coefficients == pytest.approx(plain.coefficients, abs=1e-9)
        assert plan.peaks.torque == pytest.approx(plain.peaks.torque, rel=1e-9)


def written(folder, text) -> fp.Robot:
    path = folder / "robot.urdf"
    path.write_text(text)
    return fp.Robot.from_urdf(path)


@pytest.mark.usefixtures("little_work")
@pytest.mark.parametrize(
    ("seed", "joints", "degree", "duration"),
    [
        *((71, 2, 7, 1.0), (71, 5, 15, 0.02), (71, 9, 13, 20.0), (71, 2, 13, 90.0)),
        *((131593, 7, 11, 5.275), (31227, 3, 13, 3.3855)),  # wild motions, for which few nodes foretell too few
    ],
)
def test_b_is_that_of_the_motion_that_was_judged(seed, joints, degree, duration):
    """By whichever of the solvers, and where there is no plan too: of long flights b is far more than x can tell."""
    problem = random_problem(seed, joints)
    flight = replace(problem.flight, duration=duration * problem.flight.duration)
    problem = replace(problem, flight=flight, motion=replace(problem.motion, degree=degree))
    found = planned(problem, SearchOptions())
    variables, x = found.best.variables, found.best.x
    h = variables.angular_momentum(x)
    expected = variables.motion_class(h).powers_of_seconds(variables.free_coefficients(x))
    powers = problem.flight.duration ** np.arange(degree + 1)
    assert np.abs((found.plan.coefficients - expected) * powers).max() < 1e-9 * max(
        1.0, np.abs(expected * powers).max()
    )
    assert found.plan.ok == found.best.holds
